"""How well the survey knows where the target is: many flights of the bundled vehicle, judged by its truth.

    python -m tests.bench.bench_locate --flights 200

One row a situation. Beyond GPS: error less the mean error of the reported positions over the same time, 95th
percentile. Band: share of flights whose squared error in units of the stated covariance (NEES) lies in its 95 % band.
The GPS wanders by 1.5 m with 60 s, which the survey does not know (it assumes 1.5 m and 100 s); wind 5 m/s with gusts
of 1 m/s.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import hypot, pi

import numpy as np

from circnav_mav.locate.estimator import Knowledge, Ranges, Track, locate
from circnav_mav.locate.place import Place
from sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG
from tests.locate.flown import Surveyed, nees, surveyed

BAND = (0.0506, 7.378)
"""95 % of chi-squared with two degrees of freedom."""
SPEED = 15.0
WORLD = (
    'sim.vehicle.dynamics="airborne"', "sim.wind.speed_mps=5", "sim.wind.gust_rms_mps=1", "sim.sensors.gps_error_m=1.5",
    "sim.start.random.range_m=[120, 200]", "sim.start.random.bearing_deg=[0, 360]", "limits.duration_s=1000",
)  # fmt: skip


@dataclass(frozen=True)
class Situation:
    """laps: that count, with the radius of each. bound: what the geometry allows, m, from ../shared/survey.md."""

    name: str
    radii: tuple[float, ...]
    changes: tuple[str, ...] = ()
    speed: float = 0.0


SITUATIONS = (
    Situation("one lap, .5 m", (100.0,)),
    Situation("one lap, LoRa", (100.0,), ('sim.ranging.preset="lora"', "ranging.sigma_m=2")),
    Situation("one lap, 10 % outliers", (100.0,), ("sim.ranging.outlier_fraction=0.1",)),
    Situation("two radii, .5 m", (100.0, 60.0)),
    Situation("target at 3 m/s, two laps", (100.0,), ("sim.target.velocity_east_mps=3",), speed=3.0),
)


@dataclass(frozen=True)
class Result:
    """error, gps: m. nees: of the place. up: error of the height, m; None: not claimed. speed: error, m/s; None: it is
    said to stand."""

    error: float
    gps: float
    sigma: float
    nees: float
    up: float | None
    speed: float | None


def fly(situation: Situation, seed: int) -> Result | None:
    """One flight; None where no place was found."""
    laps = [_lap(situation, radius, seed) for radius in situation.radii]
    flown, *_ = laps[-1]
    # the laps one after the other, as if flown so; each has its own stretch of the GPS error
    track, ranges, errors, shift = [], [], [], 0.0
    for lap, lap_track, lap_ranges, error in laps:
        began = lap_track[0, 0]
        assert lap.locator is not None and lap.locator.plane is not None
        assert flown.locator is not None and flown.locator.plane is not None
        origin = flown.locator.plane.to_metres(lap.locator.plane.latitude, lap.locator.plane.longitude)
        track.append(lap_track - [began - shift, -origin[0], -origin[1], 0])
        ranges.append(lap_ranges - [began - shift, 0, 0])
        errors.append(error)
        shift += lap_track[-1, 0] - began + 1.0
    locator = flown.locator
    assert locator is not None and locator.plane is not None
    known = Knowledge(up=locator._home, gps_sigma=1.5, bias_sigma=2.0)
    place = locate(locator.plane, Track(*np.vstack(track).T), Ranges(*np.vstack(ranges).T), known)
    if not isinstance(place, Place):
        return None
    place = replace(place, time=place.time - shift + 1.0 + laps[-1][1][-1, 0])
    truth = flown.vehicle.truth
    error = flown.error(place)
    velocity = np.array(place.velocity) - [situation.speed, 0.0]
    return Result(
        error=hypot(*error),
        gps=hypot(*np.mean(errors, axis=0)),
        sigma=place.sigma,
        nees=nees(flown, place),
        up=place.up - (584.0 - truth.target_down) if place.up_known else None,
        speed=hypot(*velocity) if place.moves else None,
    )


def _lap(situation: Situation, radius: float, seed: int) -> tuple[Surveyed, np.ndarray, np.ndarray, np.ndarray]:
    """A flight up to a lap on its circle, its positions and ranges of that lap, and their mean GPS error."""
    flown = surveyed(
        "quickstart", *WORLD, *situation.changes, f"orbit.radius_m={radius}", f"sim.seed={seed + round(radius)}",
        law="feedforward",
    )  # fmt: skip
    flown.solve_from = 1e9
    lap = 2 * pi * radius / SPEED * (2 if situation.speed else 1)
    flown.fly(45.0 + lap)
    locator = flown.locator
    assert locator is not None
    since = flown.now - lap
    track = np.array([one for one in locator._track if one[0] >= since])
    ranges = np.array([one for one in locator._ranges if one[0] >= since])
    times = np.array([one.time for one in flown.truths])
    plane = locator.plane
    assert plane is not None
    home = plane.to_metres(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG)
    true = [np.interp(track[:, 0], times, [getattr(one, way) for one in flown.truths]) for way in ("east", "north")]
    off = np.array([np.mean(track[:, 1 + at] - home[at] - true[at]) for at in (0, 1)])
    return flown, track, ranges, off


def row(situation: Situation, results: list[Result | None]) -> str:
    """A situation as a line of the table."""
    found = [one for one in results if one is not None]
    inside = np.mean([BAND[0] <= one.nees <= BAND[1] for one in found])
    below = np.mean([one.nees <= BAND[1] for one in found])
    beyond = np.percentile([one.error - one.gps for one in found], 95)
    heights = [abs(one.up) for one in found if one.up is not None]
    speeds = [one.speed for one in found if one.speed is not None]
    tall = f"{len(heights)}, {np.percentile(heights, 95):.2f} m" if heights else "0"
    fast = f"{len(speeds)}, {np.percentile(speeds, 95):.2f} m/s" if speeds else "0"
    sigma = np.median([one.sigma for one in found])
    return (
        f"| {situation.name} | {len(found)} of {len(results)} | {np.median([o.error for o in found]):.2f} | "
        f"{np.percentile([o.error for o in found], 95):.2f} | {beyond:.2f} | {sigma:.2f} | "
        f"{100 * inside:.0f} % ({100 * below:.0f} % below its top) | {tall} | {fast} |"
    )


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--situation", action="append", metavar="NAME", help="only these")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    print("| situation | places | error, m | 95 % | beyond GPS, 95 % | stated sigma | NEES in band | heights claimed, "
          "95 % | velocities, 95 % |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(options.processes) as pool:
        for situation in (one for one in SITUATIONS if not options.situation or one.name in options.situation):
            results = list(pool.map(partial(fly, situation), range(1, 1 + options.flights)))
            print(row(situation, results), flush=True)


if __name__ == "__main__":
    main()
