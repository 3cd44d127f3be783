"""Figures of `circnav plan`, compared with flights of random missions in lockstep on the bundled
vehicles.

    python -m tests.tools.bench.bench_plan --seeds 0 199 --keep flown.jsonl --minutes 240

The number of a mission (its seed) determines vehicle, speed, radius, wind, gusts, and noise and
rate of the radio, drawn at random. A mission that does not pass `circnav check` is drawn again.

Radius RMS: RMS error of the true radius over the last WINDOW seconds. Survey: standard deviation of
the place that `circnav locate` states for these seconds, and the error of the place.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf, nan

import numpy as np

from circnav_mav.extras.locate.forecast import position_sigma
from circnav_mav.extras.locate.place import Place
from circnav_mav.extras.plan.command import at_speed
from circnav_mav.extras.plan.radius_error import radius_rms
from circnav_mav.mav.check_result import PASS
from circnav_mav.mission.checks import check_mission, drift_allowed
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.mission.mission import Mission
from tests.extras.locate.flown import LocatingFlight, locating_flight
from tests.flight.lockstep import CONFIG, true_radius
from tests.tools import cells
from tests.tools.cells import Result

WINDOW = 240.0
SETTLING = 60.0
"""Evaluated time (WINDOW), and time before it to reach the circle (SETTLING), s."""
STRICT = ("turn rate", "drift", "margin", "rate error", "sampling", "gain")
"""Lines of `circnav check` that a drawn mission must pass."""
WITHIN = 0.3
"""Largest error of a planned figure, as a share of the flown figure."""
ON_CIRCLE = 0.1
"""Largest radius error of 20 s after which a flight is evaluated, as a share of the radius."""
HEAD = (
    "mission | vehicle | V, m/s | radius, m | wind, m/s | gust, m/s | sigma, m | rate, Hz | RMS, m"
    " | stated sigma, m | error, m | RMS / plan | sigma / plan | error / plan | ended"
)
SPEEDS = {"arduplane": (15.0, 27.0), "arducopter": (3.0, 8.0), "ardurover": (1.5, 5.0)}
SHARES = {"arduplane": 0.45, "arducopter": 0.4, "ardurover": 0.15}
MOST_TRIED = 200
"""Draws of a mission before the program gives up."""


@dataclass(frozen=True)
class Drawn:
    """A drawn mission. radius: m. speed, wind, gust: m/s. sigma: noise of the ranges, m. rate:
    ranges per second, Hz."""

    number: int
    vehicle: str
    speed: float
    radius: float
    wind: float
    gust: float
    sigma: float
    rate: float

    @property
    def overrides(self) -> tuple[str, ...]:
        """Return the mission as changes of the bundled one."""
        cruise = (
            (f"sim.vehicle.cruise_speed_mps={self.speed}",) if self.vehicle == "arduplane" else ()
        )
        return (
            *cruise,
            *at_speed(str(CONFIG / f"{self.vehicle}.toml"), self.speed),
            f"orbit.radius_m={self.radius}",
            f"ranging.sigma_m={self.sigma}",
            f"ranging.rate_hz={self.rate}",
            f"sim.ranging.rate_hz={self.rate}",
            f"sim.ranging.noise_m={self.sigma}",
            f"sim.wind.speed_mps={self.wind}",
            f"sim.wind.gust_rms_mps={self.gust}",
            f"sim.seed={self.number + 1}",
            f"sim.start.random.range_m=[{1.1 * self.radius}, {1.6 * self.radius}]",
            "sim.sensors.gps_error_m=1.5",
            "sim.start.random.bearing_deg=[0, 360]",
            "limits.duration_s=2000",
        )

    def mission(self) -> Mission:
        """Return the mission. Raises MissionError."""
        return load_mission(CONFIG / f"{self.vehicle}.toml", self.overrides)


def draw(number: int) -> Drawn:
    """Return mission `number`."""
    rng = np.random.default_rng([47, number])
    for _ in range(MOST_TRIED):
        vehicle = str(rng.choice(list(SHARES), p=list(SHARES.values())))
        speed = rng.uniform(*SPEEDS[vehicle])
        seconds = rng.uniform(2.0, 12.0)  # radius divided by speed, s
        wind = 0.0 if vehicle == "ardurover" else rng.uniform(0.0, 0.35) * speed
        gust = 0.0 if vehicle == "ardurover" else rng.uniform(0.0, 0.3) * wind
        sigma = float(np.exp(rng.uniform(np.log(0.1), np.log(2.0))))
        rate = float(rng.choice([4.0, 5.0, 10.0, 20.0]))
        values = (round(float(one), 2) for one in (speed, speed * seconds, wind, gust, sigma))
        drawn = Drawn(number, vehicle, *values, rate)
        try:
            mission = drawn.mission()
        except MissionError:
            continue
        sound = all(line.grade is PASS for line in check_mission(mission) if line.subject in STRICT)
        if sound and drift_allowed(mission) >= drawn.wind + 2 * drawn.gust:
            return drawn
    raise SystemExit(f"mission {number}: no draw of {MOST_TRIED} passes its checks")


def fly(row: str, number: int) -> Result:
    """Fly a mission. Return what was flown; sigma and error: stated deviation of the place, and its
    error, m. ended: outcome of a mission that ended too early."""
    drawn = draw(number)
    flown = locating_flight(drawn.vehicle, *drawn.overrides, law="auto")
    flown.solve_from = 1e9
    while flown.pilot.mission.engaged_at is None and flown.now < 60.0:
        flown.fly(flown.now + 1.0)
    flown.fly(flown.now + SETTLING)
    while flown.now < 400.0 and np.abs(_errors(flown, flown.now - 20.0, drawn)).max() >= ON_CIRCLE:
        flown.fly(flown.now + 5.0)
    begun = flown.now
    flown.fly(begun + WINDOW)
    error = drawn.radius * _errors(flown, begun, drawn)
    place = flown.solve_since(begun)
    located = isinstance(place, Place)
    return {
        "ended": str(flown.pilot.mission.outcome) if flown.pilot.done else "",
        "begun": begun,
        "rms": float(np.sqrt(np.mean(error**2))),
        "mean": float(error.mean()),
        "sigma": place.sigma if located else inf,
        "error": hypot(*flown.error(place)) if located else inf,
    }


def _errors(flown: LocatingFlight, since: float, drawn: Drawn) -> np.ndarray:
    """Return the radius errors since a time, as shares of the radius."""
    return np.array([true_radius(t) / drawn.radius - 1 for t in flown.truths if t.time >= since])


def planned(drawn: Drawn) -> tuple[float, float | None]:
    """Return the planned radius RMS and standard deviation of the place, m."""
    mission = drawn.mission()
    return radius_rms(mission, drawn.gust), position_sigma(mission, WINDOW)


def compared(flown: Result) -> tuple[float, float, float]:
    """Return the flown radius RMS, the stated deviation of the place and its error, divided by the
    planned values."""
    if flown["ended"]:
        return inf, nan, nan
    rms, sigma = planned(draw(flown["seed"]))
    if sigma is None:
        return flown["rms"] / rms, inf, inf
    return flown["rms"] / rms, flown["sigma"] / sigma, flown["error"] / sigma


def row(flown: Result, ratios: Sequence[float]) -> list[object]:
    """Return the line of the table for a flight."""
    drawn = draw(flown["seed"])
    conditions = (drawn.speed, drawn.radius, drawn.wind, drawn.gust, drawn.sigma, drawn.rate)
    figures = (flown["rms"], flown["sigma"], flown["error"])
    return [drawn.number, drawn.vehicle, *conditions, *figures, *ratios, flown["ended"]]


def main() -> None:
    """Print a line per flight, and the share of flights for which the error of the plan is below
    WITHIN."""
    options = cells.parser(__doc__, ("missions",), (0, 199)).parse_args()
    flights = cells.flown(fly, options)["missions"]
    ratios = [compared(one) for one in flights]
    rows = [row(*one) for one in zip(flights, ratios, strict=True)]
    print(cells.table(HEAD, rows))
    rms, *places = np.array(ratios).T
    stated, error = (ratio[~np.isnan(ratio)] for ratio in places)
    for name, ratio in (("radius RMS", rms), ("stated sigma of the place", stated)):
        inside = np.sum(np.abs(ratio - 1) <= WITHIN)
        print(
            f"{name}: {inside} of {len(ratio)} within {100 * WITHIN:.0f} % of the plan, median"
            f" {np.median(ratio):.2f}"
        )
    print(
        f"error of the place over the planned sigma: RMS {np.sqrt(np.mean(error**2)):.2f}"
        " (1.41 expected)"
    )


if __name__ == "__main__":
    main()
