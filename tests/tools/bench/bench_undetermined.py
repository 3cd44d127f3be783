"""Logs that do not determine the place: share of logs for which the locator gives a wrong place
without a warning.

    python -m tests.tools.bench.bench_undetermined --seeds 0 249

Kinds: a straight track; ranges of pure noise; a constant range; half a lap with 5 m of noise. The
vehicle's height above the target is 0 to 40 m, GPS errors are 1.5 m. A place is wrong if its error
exceeds 4 times its standard deviation in the direction of the error. A place from a log without a
true place is wrong, too.
"""

from collections import Counter
from collections.abc import Callable

import numpy as np

from circnav_mav.extras.locate.estimator import Knowledge, Ranges, Track, locate
from circnav_mav.extras.locate.place import Place, Plane
from tests.extras.locate.worlds import gps_error
from tests.tools import cells

PLANE = Plane(46.5, 7.0)
LIMIT = 4.0
"""Smallest error of a wrong place, in standard deviations."""
Log = tuple[Track, Ranges, np.ndarray | None]


def _flown(rng: np.random.Generator, way: np.ndarray, period: float, height: float) -> Track:
    """Return the reported track of a vehicle at these true positions."""
    time = period * np.arange(len(way))
    reported = way + gps_error(time, rng, 1.5)
    return Track(time, *reported.T, np.full(len(way), 500.0 + height))


def _ranges(track: Track, r: np.ndarray) -> Ranges:
    return Ranges(track.time, np.maximum(r, 0.1), np.ones(len(r)))


def straight(rng: np.random.Generator) -> Log:
    """Return a log of a walk or flight along a line, with the target beside the line."""
    speed = rng.uniform(1.2, 15.0)
    length = rng.uniform(60.0, 600.0)
    period = 1.0 if speed < 5 else 0.2
    along = np.arange(0.0, length, speed * period) - rng.uniform(0.1, 0.9) * length
    way = np.column_stack([along, np.full(len(along), rng.uniform(0.15, 1.0) * length)])
    height = rng.uniform(0.0, 40.0)
    noise = rng.choice([0.1, 0.5, 2.0, 4.0])
    r = np.hypot(np.hypot(*way.T), height) + rng.normal(0, noise, len(way))
    track = _flown(rng, way, period, height)
    return track, _ranges(track, r), np.zeros(2)


def _lawn(rng: np.random.Generator) -> np.ndarray:
    """Return a track of turns: a circle, a figure of eight or two legs."""
    size = rng.uniform(20.0, 150.0)
    angle = np.linspace(0, 4 * np.pi, 600)
    shape = rng.integers(2)
    if shape == 0:
        return np.column_stack([size * np.sin(angle), size * np.sin(2 * angle)])
    leg = np.linspace(0, size * 3, 300)
    zeros = np.zeros(300)
    return np.column_stack([np.r_[leg, zeros + size * 3], np.r_[zeros, leg]])


def noise(rng: np.random.Generator) -> Log:
    """Return a log with random ranges that do not depend on the position."""
    track = _flown(rng, _lawn(rng), 0.2, 0.0)
    mean = rng.uniform(30.0, 200.0)
    if rng.random() < 0.5:
        r = rng.uniform(0.5 * mean, 1.5 * mean, len(track.time))
    else:
        r = rng.normal(mean, rng.uniform(0.02, 0.3) * mean, len(track.time))
    return track, _ranges(track, r), None


def constant(rng: np.random.Generator) -> Log:
    """Return a log with a constant range: repeated exactly, or with the noise of a radio on a
    bench."""
    track = _flown(rng, _lawn(rng), 0.2, 0.0)
    spread = rng.choice([0.0, 0.05, 1.0])
    r = rng.uniform(10.0, 200.0) + rng.normal(0, 1, len(track.time)) * spread
    return track, _ranges(track, r), None


def half_lap(rng: np.random.Generator) -> Log:
    """Return a log of half a lap round the target with 5 m of range noise."""
    radius = rng.uniform(40.0, 150.0)
    angle = np.arange(0, np.pi, 15.0 * 0.2 / radius) + rng.uniform(0, 2 * np.pi)
    way = radius * np.column_stack([np.sin(angle), np.cos(angle)])
    height = rng.uniform(0.0, 40.0)
    r = np.hypot(np.hypot(*way.T), height) + rng.normal(0, 5.0, len(way))
    track = _flown(rng, way, 0.2, height)
    return track, _ranges(track, r), np.zeros(2)


KINDS: dict[str, Callable[[np.random.Generator], Log]] = {
    "straight": straight,
    "noise": noise,
    "constant": constant,
    "half a lap": half_lap,
}


def judged(kind: str, seed: int) -> str:
    """Return "not located", "right" or "WRONG" for one log."""
    track, ranges, truth = KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind)]))
    known = Knowledge(
        up=float(track.up.min()), up_sigma=50.0, delay_sigma=0.5, sigma_known=seed % 4 == 0
    )
    if known.sigma_known:
        ranges = Ranges(ranges.time, ranges.r, np.full(len(ranges.r), 1.0))
    place = locate(PLANE, track, ranges, known)
    if not isinstance(place, Place):
        return "not located"
    if truth is None:
        return "WRONG"
    off = np.array([place.east, place.north]) - truth
    return "right" if off @ np.linalg.solve(place.covariance, off) < LIMIT**2 else "WRONG"


def fly(kind: str, seed: int) -> cells.Result:
    return {"judged": judged(kind, seed)}


def main() -> None:
    """Print one line per kind, with the seeds of the wrong places."""
    options = cells.parser(__doc__, KINDS, (0, 49)).parse_args()
    for kind, logs in cells.flown(fly, options).items():
        wrong = [one["seed"] for one in logs if one["judged"] == "WRONG"]
        print(f"{kind}: {dict(Counter(one['judged'] for one in logs))}, wrong seeds {wrong}")


if __name__ == "__main__":
    main()
