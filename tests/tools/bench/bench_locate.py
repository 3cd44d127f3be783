"""Accuracy of the target localization: many flights of the bundled vehicle, judged by its truth.

    python -m tests.tools.bench.bench_locate --seeds 1 200

One row per situation. Beyond GPS: 95th percentile of the error minus the mean error of the reported
positions over the same time. Band: share of flights with a squared error in units of the stated
covariance (NEES) within its 95 % band. Bound: the Cramer-Rao bound of the ranges on the flown
tracks if the vehicle's positions had no error, as 95th percentiles of horizontal error and height
error. The GPS error has a standard deviation of 1.5 m and a correlation time of 60 s; the
localization assumes 1.5 m and 100 s. The wind is 5 m/s with gusts of 1 m/s.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import hypot

import numpy as np
from circnav_sim.sensor import CHARACTERS
from circnav_sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG

from circnav_mav.extras.locate.estimator import HEIGHT_UNKNOWN, Knowledge
from circnav_mav.extras.locate.locator import Locator
from circnav_mav.extras.locate.place import CHI95, Place
from circnav_mav.guidance.circle_change import CircleRequest
from tests.extras.locate.flown import LocatingFlight, laps, locating_flight, nees
from tests.tools import cells

BAND = (0.0506, 7.378)
"""Limits that contain 95 % of a chi-squared distribution with two degrees of freedom."""
SETTLED = 40.0
LONGEST = 400.0
"""Time after which the vehicle is on its circle (SETTLED), and longest duration of a flight
(LONGEST), s."""
WORLD = (
    'sim.vehicle.dynamics="airborne"',
    "sim.wind.speed_mps=5",
    "sim.wind.gust_rms_mps=1",
    "sim.sensors.gps_error_m=1.5",
    "sim.start.random.range_m=[120, 200]",
    "sim.start.random.bearing_deg=[0, 360]",
    "limits.duration_s=1000",
)


@dataclass(frozen=True)
class Situation:
    """Conditions of a row. laps: laps round the true target on the last circle, after which the
    flight is evaluated."""

    name: str
    changes: tuple[str, ...] = ()
    laps: float = 1.0
    speed: float = 0.0
    second: float | None = None
    """Radius of the second circle, m."""


TWO_CIRCLES = ("vehicle.max_turn_rate_deg_s=35",)
SITUATIONS = (
    Situation("one lap, 0.5 m"),
    Situation("one lap, LoRa", ('sim.ranging.preset="lora"', "ranging.sigma_m=3")),
    Situation("one lap, 10 % outliers", ("sim.ranging.outlier_fraction=0.1",)),
    Situation(
        "one lap, WiFi FTM (2 m, 10 % outliers, 30 % lost)",
        (
            "sim.ranging.noise_m=2",
            "ranging.sigma_m=2",
            "sim.ranging.outlier_fraction=0.1",
            "sim.ranging.dropout_fraction=0.3",
        ),
    ),
    Situation("two circles, 0.5 m", TWO_CIRCLES, second=60.0),
    Situation(
        "two circles, RTK (0.02 m)",
        (*TWO_CIRCLES, "sim.sensors.gps_error_m=0.02"),
        second=60.0,
    ),
    Situation(
        "target at 3 m/s, two laps", ("sim.target.velocity_east_mps=3",), laps=2.0, speed=3.0
    ),
)


@dataclass(frozen=True)
class Result:
    """Errors of one flight. error: of the position, m. gps: mean error of the reported positions,
    m. nees: squared position error in units of its covariance. bound: bounds of position and height
    error, m. up: height error, m; None: no height was estimated. speed: velocity error, m/s; None:
    the target was estimated at rest."""

    error: float
    gps: float
    sigma: float
    nees: float
    bound: tuple[float, float]
    up: float | None
    speed: float | None


def circled(flown: LocatingFlight, count: float, step: float) -> None:
    """Fly laps round the true target, from now on."""
    since = flown.now
    while flown.now < LONGEST and laps([t for t in flown.truths if t.time >= since]) < count:
        flown.fly(flown.now + step)


def fly(situation: Situation, seed: int) -> Result | None:
    """Fly once. Return None if no position was found. Only ranges from the first circle on are
    used."""
    changes = (*WORLD, *situation.changes, f"sim.seed={seed}")
    flown = locating_flight("quickstart", *changes, law="auto")
    flown.solve_from = 1e9
    flown.fly(SETTLED)
    begun = flown.now
    if situation.second is not None:
        circled(flown, 1.25, 1.0)
        flown.pilot.request_circle(CircleRequest(radius=situation.second, by="operator"), flown.now)
    circled(flown, situation.laps, 0.5)
    place = flown.solve_since(begun)
    if not isinstance(place, Place):
        return None
    assert flown.locator is not None
    truth = flown.vehicle.truth
    return Result(
        error=hypot(*flown.error(place)),
        gps=hypot(*_gps_error(flown, flown.locator)),
        sigma=place.sigma,
        nees=nees(flown, place),
        bound=bound(flown, flown.locator),
        up=place.up - (584.0 - truth.target_down) if place.up_known else None,
        speed=hypot(*(np.array(place.velocity) - [situation.speed, 0.0])) if place.moves else None,
    )


def bound(flown: LocatingFlight, locator: Locator) -> tuple[float, float]:
    """Return the Cramer-Rao bound of the used ranges, m: 95 % radius of the position, and 95 % of
    the height error. The states are east, north, up, bias and, for a moving target, its velocity,
    with the localization's priors of height and bias. A radio's drift is an AR(1) process."""
    radio = flown.vehicle._flight.config.ranging
    times = np.array(locator._ranges)[:, 0]
    kind = CHARACTERS[radio.preset]
    moves = flown.truths[0].target_east != flown.truths[-1].target_east
    true = np.array([(t.time, t.target_east - t.east, t.target_north - t.north,
                      t.down - t.target_down) for t in flown.truths])  # fmt: skip
    way = np.column_stack([np.interp(times, true[:, 0], part) for part in true[:, 1:].T])
    sight = way / np.linalg.norm(way, axis=1)[:, None]
    ahead = times - times[-1]
    slopes = np.column_stack(
        [sight, np.ones(len(times)), *([sight[:, 0] * ahead, sight[:, 1] * ahead] if moves else ())]
    )
    white = radio.noise_m if kind.white is None else kind.white
    drift = kind.drift**2 * np.exp(-np.abs(times[:, None] - times) / kind.drift_time)
    fisher = slopes.T @ np.linalg.solve(drift + white**2 * np.eye(len(times)), slopes)
    fisher[[2, 3], [2, 3]] += HEIGHT_UNKNOWN**-2, Knowledge(0.0).bias_sigma ** -2
    variances = np.diag(np.linalg.inv(fisher))
    return CHI95 * float(np.sqrt(variances[:2].mean())), 1.96 * float(np.sqrt(variances[2]))


def _gps_error(flown: LocatingFlight, locator: Locator) -> np.ndarray:
    """Return the mean error of the reported positions in the evaluated time, east and north, m."""
    assert locator.plane is not None
    track = np.array(locator._track)
    times = [one.time for one in flown.truths]
    home = locator.plane.to_metres(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG)
    true = [
        np.interp(track[:, 0], times, [getattr(one, way) for one in flown.truths])
        for way in ("east", "north")
    ]
    return np.array([np.mean(track[:, 1 + at] - home[at] - true[at]) for at in (0, 1)])


def row(situation: Situation, results: Sequence[Result | None]) -> str:
    """Return the line of the table for a situation."""
    found = [one for one in results if one is not None]
    errors = [one.error for one in found]
    inside = np.mean([BAND[0] <= one.nees <= BAND[1] for one in found])
    below = np.mean([one.nees <= BAND[1] for one in found])
    beyond = _p95([one.error - one.gps for one in found])
    sigma = np.median([one.sigma for one in found])
    least = np.median([one.bound for one in found], axis=0)
    return (
        f"| {situation.name} | {len(found)} of {len(results)} | {np.median(errors):.2f} |"
        f" {_p95(errors)} | {beyond} | {least[0]:.2f}, up {least[1]:.2f} | {sigma:.2f} |"
        f" {100 * inside:.0f} % ({100 * below:.0f} % below its top) |"
        f" {_known([one.up for one in found], 'm')} |"
        f" {_known([one.speed for one in found], 'm/s')} |"
    )


def _p95(values: list[float]) -> str:
    return f"{np.percentile(values, 95):.2f}"


def _known(values: list[float | None], unit: str) -> str:
    """Return the number of known values, and the 95th percentile of their sizes."""
    known = [abs(value) for value in values if value is not None]
    return f"{len(known)}, {_p95(known)} {unit}" if known else "0"


HEADER = (
    "| situation | places | error, m | 95 % | beyond GPS, 95 % | bound, 95 % | stated sigma"
    " | NEES in band | heights claimed, 95 % | velocities, 95 % |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)
ROWS = {one.name: one for one in SITUATIONS}


def cell(name: str, seed: int) -> cells.Result:
    """Fly a row once. The result is empty if no position was found."""
    found = fly(ROWS[name], seed)
    return {"found": found and asdict(found)}


def main() -> None:
    """Print the table."""
    print(HEADER)
    options = cells.parser(__doc__, ROWS, (1, 200)).parse_args()
    for name, flights in cells.flown(cell, options).items():
        found = [one["found"] and Result(**one["found"]) for one in flights]
        print(row(ROWS[name], found))


if __name__ == "__main__":
    main()
