"""Localization of a beacon by one vehicle: circnav compared with multilat-solver, GTSAM, a particle
filter and least squares, on real ranges and on synthetic logs.

    pip install -e '.[peers]'
    python -m tests.tools.bench.bench_plaza               # Plaza 1 and 2
    python -m tests.tools.bench.bench_plaza --logs 20     # synthetic logs, 20 of a kind

Plaza 1 and 2 (Djugash and Singh, Carnegie Mellon University): a robot mower with an RTK receiver
and a radio that measures 7 % too far, with four surveyed beacons each. The data come in the `gtsam`
wheel. Each method gets the measured ranges of one beacon and the true path of the mower. The beacon
is at the height of the path. "No scale" is GTSAM's own range factor. multilat-solver (with its
default solver, and at most 300 ranges) estimates neither bias nor scale, and states no covariance.
All other rows estimate a bias and a scale of the radio. All start without a prior of the place.

Synthetic logs: 300 ranges with 0.5 m of white noise; circles and figures of eight beside the
beacon, or one straight walk, whose ranges do not show the side of the beacon; positions with 0.05 m
of noise. The particle filter takes most of the time, and runs on Plaza alone.

Sigma: standard deviation along the long axis of the stated covariance, m. Inside: number of beacons
in the 95 % ellipse, of those with a stated covariance, with the interval of the share. Refused:
number of logs without a place.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from importlib.util import find_spec
from io import StringIO
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.optimize import least_squares

from circnav_mav.extras.locate.estimator import Knowledge, Place, Ranges, Track, locate
from circnav_mav.extras.locate.place import Array, Plane
from tests.tools.bench import intervals

NOISE = 0.5
HUBER = 1.345
"""NOISE: range noise for the methods that require it, m. HUBER: threshold of the Huber loss, in
standard deviations."""
BIAS = 2.0
SCALE = 0.1
"""Prior standard deviations of the radio's bias (m) and scale."""
INSIDE = 5.991
"""95th percentile of chi-squared with two degrees of freedom."""
PARTICLES = 3000
ROUGHENING = (0.02, 0.02, 0.01, 0.0005)
"""PARTICLES: number of particles. ROUGHENING: random walk between two ranges of the constant states
east, north, bias (m) and scale. Without this walk, resampling keeps only one particle."""


@dataclass(frozen=True)
class Beacon:
    """One beacon. true: true position, east and north, m. places: positions of the mower at the
    times of the ranges, m, (n, 2)."""

    name: str
    true: Array
    track: Track
    ranges: Ranges
    places: Array


Estimate = tuple[Array, Array | None]
"""East and north, m, and their covariance, m^2, or None."""


def beacons(folder: Path) -> Iterator[Beacon]:
    """Yield the eight beacons. folder: of the MATLAB files."""
    for plaza in (1, 2):
        table = loadmat(folder / f"Plaza{plaza}_.mat")
        when, east, north = table["GT"][:, :3].T
        for ident, *true in table["TL"]:
            rows = table["TD"][table["TD"][:, 2] == ident]
            ranges = Ranges(rows[:, 0], rows[:, 3], np.ones(len(rows)))
            places = np.column_stack([np.interp(ranges.time, when, way) for way in (east, north)])
            track = Track(when, east, north, np.zeros(len(when)))
            yield Beacon(f"Plaza {plaza}, {int(ident)}", np.array(true), track, ranges, places)


def synthetic(kind: str, seed: int) -> Beacon:
    """Return a synthetic log of a kind in KINDS."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    true = rng.uniform(-40.0, 40.0, 2)
    if kind == "straight walk":
        beside = rng.uniform(15.0, 60.0) * rng.choice([-1.0, 1.0])
        along = np.linspace(-1.0, 1.0, 300) * rng.uniform(50.0, 150.0)
        way = true + np.column_stack([along, np.full(300, beside)])
    else:
        size = rng.uniform(50.0, 120.0)
        angle = np.linspace(0, 3 * np.pi, 300)
        way = size * np.column_stack([np.sin(angle), np.sin((1 + seed % 2) * angle + np.pi / 2)])
    r = np.hypot(*(way - true).T)
    if kind == "7 % scale":
        r = 1.07 * r
    r = r + rng.normal(0, NOISE, len(r))
    if kind == "10 % outliers":
        # Reflected signals travel farther.
        r = r + (rng.random(len(r)) < 0.1) * rng.uniform(5.0, 50.0, len(r))
    times = np.arange(len(r), dtype=float)
    reported = way + rng.normal(0, 0.05, way.shape)
    track = Track(times, *reported.T, np.zeros(len(r)))
    ranges = Ranges(times, np.maximum(r, 0.1), np.ones(len(r)))
    return Beacon(f"{kind}, {seed}", true, track, ranges, reported)


KINDS = ("white noise", "7 % scale", "10 % outliers", "straight walk")
"""Kinds of synthetic logs."""


def ours(beacon: Beacon) -> Estimate | None:
    """Run `circnav locate --altitude 0 --gps-sigma 0.05`."""
    known = Knowledge(
        up=0.0, up_sigma=0.05, gps_sigma=0.05, bias_sigma=BIAS, delay_sigma=0.5, sigma_known=False
    )
    place = locate(Plane(40.4, -79.9), beacon.track, beacon.ranges, known)
    if not isinstance(place, Place):
        return None
    return np.array([place.east, place.north]), place.covariance


def _starts(beacon: Beacon) -> Iterator[Array]:
    """Yield eight points around the middle of the path, at the median range, as starting points of
    a method."""
    middle = beacon.places.mean(axis=0)
    reach = float(np.median(beacon.ranges.r))
    for angle in np.arange(8) * np.pi / 4:
        yield middle + reach * np.array([np.cos(angle), np.sin(angle)])


def multilat(beacon: Beacon) -> Estimate | None:
    """Estimate by multilat-solver, with the positions of the vehicle as its anchors."""
    from multilat_solver.core import multilateration

    chosen = np.unique(np.linspace(0, len(beacon.places) - 1, 300).astype(int)).tolist()
    ranges = {at: float(beacon.ranges.r[at]) for at in chosen}
    anchors = {at: (*beacon.places[at].tolist(), 0.0) for at in chosen}
    with redirect_stdout(StringIO()):  # the solver prints a line
        found = multilateration(ranges, anchors)
    return None if found is None else (np.array(found[:2], float), None)


def plain(beacon: Beacon) -> Estimate:
    """Estimate by non-robust least squares with bias and scale. The covariance is computed from the
    residuals."""

    def residuals(x: Array) -> Array:
        far = np.hypot(*(x[:2] - beacon.places).T)
        return np.asarray((1 + x[3]) * far + x[2] - beacon.ranges.r)

    fits = [
        least_squares(residuals, [*start, 0.0, 0.0], x_scale=[10, 10, 1, 0.01])
        for start in _starts(beacon)
    ]
    fit = min(fits, key=lambda one: float(one.cost))
    variance = 2 * fit.cost / (len(beacon.ranges.r) - 4)
    return fit.x[:2], (variance * np.linalg.inv(fit.jac.T @ fit.jac))[:2, :2]


def gtsam_batch(beacon: Beacon, *, scale: bool) -> Estimate:
    """Estimate by GTSAM: Levenberg-Marquardt over one factor per range, with a Huber loss. scale:
    True to estimate bias and scale as a second variable of a custom factor, because GTSAM's own
    range factor has neither."""
    import gtsam

    point = gtsam.symbol("l", 0)
    radio = gtsam.symbol("b", 0)
    noise = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(HUBER), gtsam.noiseModel.Isotropic.Sigma(1, NOISE)
    )
    graph = gtsam.NonlinearFactorGraph()

    def error(
        place: Array, reading: float, _: Any, values: Any, jacobians: list[Array] | None
    ) -> Array:
        way = values.atPoint2(point) - place
        far = max(hypot(*way), 1e-6)
        bias, stretch = values.atVector(radio) if scale else (0.0, 0.0)
        if jacobians is not None:
            jacobians[0] = ((1 + stretch) * way / far).reshape(1, 2)
            if scale:
                jacobians[1] = np.array([[1.0, far]])
        return np.array([(1 + stretch) * far + bias - reading])

    for place, reading in zip(beacon.places, beacon.ranges.r, strict=True):
        keys = [point, radio] if scale else [point]
        graph.add(gtsam.CustomFactor(noise, keys, partial(error, place, reading)))
    if scale:
        prior = gtsam.noiseModel.Diagonal.Sigmas(np.array([BIAS, SCALE]))
        graph.add(gtsam.PriorFactorVector(radio, np.zeros(2), prior))
    found = []
    for start in _starts(beacon):
        initial = gtsam.Values()
        initial.insert(point, start)
        if scale:
            initial.insert(radio, np.zeros(2))
        result = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
        found.append((graph.error(result), result))
    result = min(found, key=lambda one: one[0])[1]
    return result.atPoint2(point), gtsam.Marginals(graph, result).marginalCovariance(point)


def particles(beacon: Beacon) -> Estimate:
    """Estimate by Stone Soup's particle filter over place, bias and scale. The particles start on a
    ring with the radius of the first range."""
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVector, StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState
    from stonesoup.updater.particle import ParticleUpdater

    class Reported(NonLinearGaussianMeasurement):  # type: ignore[misc]
        """Measurement model: range reported by a radio with errors at a position of the vehicle."""

        translation_offset = None
        place = np.zeros(2)

        @property
        def ndim_meas(self) -> int:
            return 1

        def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
            x = np.asarray(state.state_vector, float)
            far = np.hypot(x[0] - self.place[0], x[1] - self.place[1])
            reading = ((1 + x[3]) * far + x[2]).reshape(1, -1)
            if isinstance(noise, bool):
                noise = self.rvs(num_samples=reading.shape[1]) if noise else 0
            return (StateVectors if reading.shape[1] > 1 else StateVector)(reading + noise)

    rng = np.random.default_rng(1)
    began = datetime(2026, 1, 1)
    np.random.seed(1)  # Stone Soup uses numpy's global random generator
    around = rng.uniform(0, 2 * np.pi, PARTICLES)
    far = beacon.ranges.r[0] + rng.normal(0, 5.0, PARTICLES)
    first = np.array([
        beacon.places[0, 0] + far * np.cos(around), beacon.places[0, 1] + far * np.sin(around),
        rng.normal(0, BIAS, PARTICLES), rng.normal(0, SCALE, PARTICLES),
    ])  # fmt: skip
    state = ParticleState(
        StateVectors(first), weight=np.full(PARTICLES, 1 / PARTICLES), timestamp=began
    )
    walk = CombinedLinearGaussianTransitionModel([RandomWalk(size**2) for size in ROUGHENING])
    predictor = ParticlePredictor(walk)
    updater = ParticleUpdater(None, SystematicResampler())
    for at, (place, reading) in enumerate(zip(beacon.places, beacon.ranges.r, strict=True)):
        model = Reported(ndim_state=4, mapping=(0, 1), noise_covar=np.array([[(2 * NOISE) ** 2]]))
        model.place = place
        # equal time steps, so that the random walk is per range and not per second
        when = began + timedelta(seconds=at + 1)
        detection = Detection(StateVector([reading]), timestamp=when, measurement_model=model)
        state = updater.update(
            SingleHypothesis(predictor.predict(state, timestamp=when), detection)
        )
    cloud = np.asarray(state.state_vector, float)[:2]
    weight = np.asarray(state.weight, float)
    mean = np.average(cloud, axis=1, weights=weight)
    return mean, np.cov(cloud, aweights=weight)


PARTICLE_FILTER = "Stone Soup particle filter"
METHODS: dict[str, Callable[[Beacon], Estimate | None]] = {
    "multilat-solver": multilat,
    "GTSAM batch, no scale": partial(gtsam_batch, scale=False),
    "plain least squares": plain,
    PARTICLE_FILTER: particles,
    "GTSAM batch, bias and scale": partial(gtsam_batch, scale=True),
    "circnav locate": ours,
}


HEADER = (
    "| method | error, m: median (95 % interval), worst | sigma, m: median, worst"
    " | inside (95 % interval) | refused | CPU s a beacon |"
)


def row(
    name: str, method: Callable[[Beacon], Estimate | None], given: list[Beacon], *, each: bool
) -> str:
    """Return the line of the table for a method. each: True to add the error of each beacon."""
    began = time.process_time()
    errors = list[float]()
    sigmas = list[float]()
    inside = 0
    for beacon in given:
        found = method(beacon)
        if found is None:
            continue
        off = np.asarray(found[0], float) - beacon.true
        errors.append(hypot(*off))
        if found[1] is not None:
            sigmas.append(float(np.linalg.eigvalsh(found[1])[-1]) ** 0.5)
            inside += float(off @ np.linalg.solve(found[1], off)) <= INSIDE
    seconds = (time.process_time() - began) / len(given)
    error = f"{intervals.median(errors)}, {max(errors):.2f}" if errors else "-"
    sigma = f"{np.median(sigmas):.2f}, {max(sigmas):.2f}" if sigmas else "none stated"
    line = (
        f"| {name} | {error} | {sigma} | {intervals.count(inside, len(sigmas))} |"
        f" {len(given) - len(errors)} of {len(given)} | {seconds:.2f} |"
    )
    return line + (" " + ", ".join(f"{error:.2f}" for error in errors) + " |" if each else "")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data", type=Path, metavar="DIR", help="Plaza1_.mat, Plaza2_.mat. [default: of gtsam]"
    )
    parser.add_argument(
        "--method", action="append", metavar="NAME", choices=METHODS, help="only these"
    )
    parser.add_argument("--logs", type=int, metavar="N", help="synthetic logs of a kind instead")
    options = parser.parse_args()
    if options.logs:
        for kind in KINDS:
            print(f"\n{kind}\n\n{HEADER}\n|---|---|---|---|---|---|")
            logs = [synthetic(kind, seed) for seed in range(1, 1 + options.logs)]
            for name in options.method or (one for one in METHODS if one != PARTICLE_FILTER):
                print(row(name, METHODS[name], logs, each=False), flush=True)
        return
    spec = find_spec("gtsam")
    if options.data is None and (spec is None or spec.origin is None):
        parser.error(
            "the data are in the wheel of gtsam: pip install -e '.[peers]', or give --data"
        )
    given = list(beacons(options.data or Path(str(spec and spec.origin)).parent / "Data"))
    print(HEADER + " each beacon, m |")
    print("|---|---|---|---|---|---|---|")
    for name in options.method or METHODS:
        print(row(name, METHODS[name], given, each=True), flush=True)


if __name__ == "__main__":
    main()
