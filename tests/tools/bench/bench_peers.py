"""Estimator of the product beside public filters, on the same recorded ranges and own motion.

    pip install -e '.[peers]'
    python -m tests.tools.bench.bench_peers               # the table
    python -m tests.tools.bench.bench_peers --tune        # process noises of the public filters

Recordings: point-mass flights of `circnav bench`, 150 s, ranges at 10 Hz, start within 100 to 300
m. The law of `auto` steers with the true position and drift: no estimator affects the path.

Public filters: bayesian-filters (the maintained fork of filterpy), Stone Soup, nrl-tracker (pytcl).
Their states are position relative to the target, drift, airspeed scale and a slowly varying range
error; the motion is the chord of the measured air path. They share no code with the product.

Tuning: the filters have the true noises of heading, airspeed and ranges, the gate of 5 sigma, and
the priors of drift and scale of the product. One Gaussian cannot represent the ring of the first
range: each filter starts as a bank of 64 directions, weighted by likelihood. The process noise of
the drift and the share of the slowly varying range error are chosen; --tune prints the errors of a
grid of them, on other seeds than the table. The product has its fixed noises.

Position, drift, range rate: RMS error of the last 60 s, median of the flights. NEES: of the
position, mean of the last 60 s and of the flights; in brackets its 95 % band for one instant of all
flights. Trust: time until the stated standard deviation of the position is below a quarter of the
range; *wrong*: flights whose error then exceeds three of these standard deviations. *lost*: flights
with a position error above 50 m. us: processor time of a range with its own motion, in the last 60
s.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import product
from math import cos, exp, hypot, inf, pi, sin
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from circnav_mav import Guidance, OwnMotion, RangeSample, tune
from circnav_mav.extras.bench.flight import FullInformation, MotionSensors, Radio, World
from circnav_mav.extras.bench.situations import ORBIT, SITUATIONS, TURN_LAG
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator

Array = NDArray[Any]
NAMES = (
    "calm", "wind 0.33 V", "gusts 1.5, wind 0.33 V", "target turns", "lora, wind 0.2 V",
    "uwb, wind 0.2 V", "10 % outliers of 20 m",
)  # fmt: skip
LATE = 60.0
"""Length of the evaluated last part of a recording, s."""
STARTS = 64
"""Number of directions in which a public filter starts."""
POSITION_PSD = 0.009
"""Process noise of the position, m^2/s: airspeed noise of 0.3 m/s and heading noise of 0.02 rad at
15 m/s, each independent at 20 Hz."""
BIAS_TIME = 3.0
"""Correlation time of the slowly varying range error of the public filters, s."""


class Truth(NamedTuple):
    """Position relative to the target (m), drift (m/s) and range rate (m/s)."""

    x: float
    y: float
    drift_x: float
    drift_y: float
    r_dot: float


class Step(NamedTuple):
    """One step of a recording."""

    own: OwnMotion
    sample: RangeSample | None
    truth: Truth


def record(name: str, seed: int) -> list[Step]:
    """Fly one recording with the true position and drift."""
    known = SITUATIONS[name]
    radio_errors = replace(known.ranging, every=2)
    situation = replace(known, start=(100.0, 300.0), duration=150.0, ranging=radio_errors)
    streams = [np.random.default_rng([seed, NAMES.index(name), part]) for part in range(4)]
    draws = streams[3].random(10)
    world = World(situation, draws, streams[0])
    radio = Radio(situation.ranging, None, streams[1])
    sensors = MotionSensors(situation, draws, streams[2])
    guidance = Guidance(ORBIT, tune(ORBIT, "drift", turn_lag=TURN_LAG), FullInformation(world))
    steps = []
    for number in range(round(situation.duration / situation.dt)):
        own = sensors.report(world, number * situation.dt)
        sample = radio.measure(world, number, situation.dt)
        steps.append(Step(own, sample, Truth(world.x, world.y, *world.drift, world.r_dot)))
        guidance.update_motion(own)
        if sample is not None:
            guidance.update_range(sample)
        command = guidance.command(own.time)
        world.step(situation.dt, ORBIT.steady_turn_rate if command is None else command.turn_rate)
    return steps


class Estimate(NamedTuple):
    """Estimate of a filter: position (m), its covariance, drift (m/s) and range rate (m/s)."""

    position: Array
    covariance: Array
    drift: Array
    r_dot: float


class Peer(Protocol):
    """An estimator under test."""

    def feed(self, own: OwnMotion, sample: RangeSample | None) -> None:
        """Process the own motion of one step, and its range if there is one."""

    def estimate(self) -> Estimate | None:
        """Return the estimate at the newest step, or None."""


class Product:
    """The product's estimator `auto`."""

    def __init__(self) -> None:
        self._auto = AutoEstimator(EstimatorSettings(ORBIT.speed, ORBIT.max_turn_rate))
        self._now = 0.0

    def feed(self, own: OwnMotion, sample: RangeSample | None) -> None:
        self._now = own.time
        self._auto.move(own)
        if sample is not None:
            self._auto.observe(sample)
            self._auto.at(own.time)

    def estimate(self) -> Estimate | None:
        found = self._auto.at(self._now)
        if found is None or found.relative is None or not self._auto.drift.ready:
            return None
        relative = found.relative
        tracking = self._auto.drift.filter.estimate
        if tracking is None:
            return None
        r = hypot(relative.x, relative.y)
        out = np.array([relative.x, relative.y]) / r
        to_plane = np.column_stack([out, r * np.array([-out[1], out[0]])])
        covariance = to_plane @ tracking.covariance[:2, :2] @ to_plane.T
        drift = np.array([relative.drift_x, relative.drift_y])
        return Estimate(np.array([relative.x, relative.y]), covariance, drift, found.r_dot)


@dataclass(frozen=True)
class Tuning:
    """Tuning of a public filter.

    drift_psd: process noise of the drift, m^2/s^3; an IMM has one mode for each value.
    slow: share of the variance of a range that varies slowly.
    """

    drift_psd: tuple[float, ...]
    slow: float


class Filter(Protocol):
    """One Gaussian filter of a package: state (x, y, drift_x, drift_y, scale, range error)."""

    x: Array
    P: Array

    def predict(self, F: Array, noises: list[Array]) -> None:
        """Predict with the transition matrix F. noises: process noise of each mode."""

    def update(self, z: float, R: float) -> None:
        """Add a range z with variance R."""


def expected(x: Array) -> Array:
    """Return the predicted range of a state, m, as an array (1,)."""
    return np.array([hypot(x[0], x[1]) + x[5]])


def slope(x: Array) -> Array:
    """Return the Jacobian of `expected`."""
    r = max(hypot(x[0], x[1]), 1e-6)
    return np.array([[x[0] / r, x[1] / r, 0.0, 0.0, 0.0, 1.0]])


def bayesian_ekf(x: Array, P: Array, modes: int) -> Filter:
    """Return the extended Kalman filter of bayesian-filters."""
    from bayesian_filters.kalman import ExtendedKalmanFilter

    class Ekf(ExtendedKalmanFilter):  # type: ignore[misc]
        def predict(self, F: Any = None, noises: Any = None) -> None:
            if noises is not None:
                self.F = F
                self.Q = noises[0]
            super().predict()

        def update(self, z: Any, R: Any = None) -> None:
            super().update(np.atleast_1d(z), slope, expected, R=R)

    made = Ekf(6, 1)
    made.x = x
    made.P = P
    return made  # type: ignore[no-any-return]


def bayesian_ukf(x: Array, P: Array, modes: int) -> Filter:
    """Return the unscented Kalman filter of bayesian-filters."""
    from bayesian_filters.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    class Ukf(UnscentedKalmanFilter):  # type: ignore[misc]
        def predict(self, F: Array, noises: list[Array]) -> None:
            self.Q = noises[0]
            self.P = (self.P + self.P.T) / 2
            super().predict(fx=lambda x, dt: F @ x)

        def update(self, z: float, R: float) -> None:
            super().update(np.array([z]), R=np.array([[R]]))

    points = MerweScaledSigmaPoints(6, alpha=0.5, beta=2.0, kappa=-3.0)
    made = Ukf(6, 1, 0.1, expected, None, points)
    made.x = x
    made.P = P
    return made  # type: ignore[no-any-return]


def bayesian_imm(x: Array, P: Array, modes: int) -> Filter:
    """Return the interacting multiple models of bayesian-filters, over extended Kalman filters."""
    from bayesian_filters.kalman import IMMEstimator

    class Imm(IMMEstimator):  # type: ignore[misc]
        def predict(self, F: Array, noises: list[Array]) -> None:
            for one, Q in zip(self.filters, noises, strict=True):
                one.F = F
                one.Q = Q
            super().predict()

        def update(self, z: float, R: float) -> None:
            for one in self.filters:
                one.R = np.array([[R]])
            super().update(z)

    stay = 0.995
    change = np.full((modes, modes), (1 - stay) / (modes - 1))
    np.fill_diagonal(change, stay)
    filters = [bayesian_ekf(x.copy(), P.copy(), 1) for _ in range(modes)]
    return Imm(filters, np.full(modes, 1 / modes), change)  # type: ignore[no-any-return]


class StoneSoupUkf:
    """Unscented Kalman filter of Stone Soup."""

    def __init__(self, x: Array, P: Array, modes: int) -> None:
        from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
        from stonesoup.types.array import StateVector, StateVectors
        from stonesoup.types.state import GaussianState
        from stonesoup.updater.kalman import UnscentedKalmanUpdater

        class Ranging(NonLinearGaussianMeasurement):  # type: ignore[misc]
            translation_offset = None

            @property
            def ndim_meas(self) -> int:
                return 1

            def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
                x = np.asarray(state.state_vector, float)
                reading = (np.hypot(x[0], x[1]) + x[5]).reshape(1, -1)
                return (StateVectors if reading.shape[1] > 1 else StateVector)(reading)

        self._ranging = Ranging
        self._vector = StateVector
        self._updater = UnscentedKalmanUpdater(None, alpha=0.5, beta=2.0, kappa=-3.0)
        self._state = GaussianState(StateVector(x), P, timestamp=datetime(2026, 1, 1))
        self._prior: Any = None

    @property
    def x(self) -> Array:
        return np.asarray((self._prior or self._state).state_vector, float).ravel()

    @property
    def P(self) -> Array:  # noqa: N802
        return np.asarray((self._prior or self._state).covar, float)

    def predict(self, F: Array, noises: list[Array]) -> None:
        from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
        from stonesoup.predictor.kalman import KalmanPredictor

        model = LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=F, covariance_matrix=noises[0]
        )
        state = self._prior or self._state
        when = state.timestamp + timedelta(seconds=0.1)
        self._prior = KalmanPredictor(model).predict(state, timestamp=when)

    def update(self, z: float, R: float) -> None:
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        model = self._ranging(ndim_state=6, mapping=(0, 1), noise_covar=np.array([[R]]))
        detection = Detection(
            self._vector([z]), timestamp=self._prior.timestamp, measurement_model=model
        )
        self._state = self._updater.update(SingleHypothesis(self._prior, detection))
        self._prior = None


class NrlCkf:
    """Cubature Kalman filter of nrl-tracker."""

    def __init__(self, x: Array, P: Array, modes: int) -> None:
        self.x = x
        self.P = P

    def predict(self, F: Array, noises: list[Array]) -> None:
        from pytcl.dynamic_estimation.kalman.unscented import ckf_predict

        found = ckf_predict(self.x, self.P, lambda x: F @ x, noises[0])
        self.x = found.x
        self.P = found.P

    def update(self, z: float, R: float) -> None:
        from pytcl.dynamic_estimation.kalman.unscented import ckf_update

        found = ckf_update(self.x, self.P, np.array([z]), expected, np.array([[R]]))
        self.x = found.x
        self.P = found.P


class Bank:
    """A public filter as a bank over the directions of the target. Directions of negligible
    likelihood are removed."""

    def __init__(self, make: Callable[[Array, Array, int], Filter], tuning: Tuning) -> None:
        self._make = make
        self._tuning = tuning
        self._filters: list[Filter] = []
        self._weights = np.zeros(STARTS)
        self._own: OwnMotion | None = None
        self._chord = np.zeros(2)
        self._since = 0.0
        self._outside = 0

    def feed(self, own: OwnMotion, sample: RangeSample | None) -> None:
        if self._own is not None and self._filters:
            dt = own.time - self._own.time
            heading = (own.heading + self._own.heading) / 2
            way = dt * (own.airspeed + self._own.airspeed) / 2
            self._chord += way * np.array([cos(heading), sin(heading)])
            self._since += dt
        self._own = own
        if sample is None:
            return
        if not self._filters:
            self._filters = list(self._ring(sample))
            return
        dt = self._since
        F = np.eye(6)
        F[:2, 2:4] = dt * np.eye(2)
        F[:2, 4] = self._chord
        F[5, 5] = exp(-dt / BIAS_TIME)
        slow = self._tuning.slow * sample.sigma**2 * (1 - exp(-2 * dt / BIAS_TIME))
        noises = [
            np.diag([dt * POSITION_PSD] * 2 + [dt * psd] * 2 + [1e-7 * dt, slow])
            for psd in self._tuning.drift_psd
        ]
        self._chord = np.zeros(2)
        self._since = 0.0
        R = (1 - self._tuning.slow) * sample.sigma**2
        for one in self._filters:
            one.predict(F, noises)
        misses = np.array([self._miss(one, sample.r, R) for one in self._filters])
        squared = misses[:, 0] ** 2 / misses[:, 1]
        # An outlier is outside the gate of every direction. After five in a row the filters are
        # wrong, and not the ranges.
        if squared.min() > 25.0 and self._outside < 5:
            self._outside += 1
            return
        self._outside = 0
        self._weights -= (squared + np.log(misses[:, 1])) / 2
        self._weights -= self._weights.max()
        kept = self._weights > -12.0
        self._filters = [one for one, keep in zip(self._filters, kept, strict=True) if keep]
        self._weights = self._weights[kept]
        for one in self._filters:
            one.update(sample.r, R)

    def estimate(self) -> Estimate | None:
        if not self._filters or self._own is None:
            return None
        share = np.exp(self._weights)
        share /= share.sum()
        states = np.array([one.x for one in self._filters])
        x = share @ states
        apart = states - x
        P = sum(
            weight * (one.P + np.outer(off, off))
            for weight, one, off in zip(share, self._filters, apart, strict=True)
        )
        V = x[4] * self._own.airspeed
        velocity = x[2:4] + V * np.array([cos(self._own.heading), sin(self._own.heading)])
        r_dot = float(x[:2] @ velocity) / max(hypot(x[0], x[1]), 1e-6)
        return Estimate(x[:2], np.asarray(P)[:2, :2], x[2:4], r_dot)

    def _ring(self, sample: RangeSample) -> Iterator[Filter]:
        """Yield the filters round the first range."""
        along = pi * sample.r / STARTS
        for direction in np.arange(STARTS) * 2 * pi / STARTS:
            out = np.array([cos(direction), sin(direction)])
            across = np.array([-out[1], out[0]])
            P = np.diag([0.0, 0.0, 9.0, 9.0, 0.0025, self._tuning.slow * sample.sigma**2 + 1e-9])
            P[:2, :2] = sample.sigma**2 * np.outer(out, out) + along**2 * np.outer(across, across)
            x = np.array([*(sample.r * out), 0.0, 0.0, 1.0, 0.0])
            yield self._make(x, P, len(self._tuning.drift_psd))

    @staticmethod
    def _miss(one: Filter, z: float, R: float) -> tuple[float, float]:
        """Return innovation and its variance, with the second-order effect of the bearing."""
        x = np.asarray(one.x)
        H = slope(x)
        along = np.array([-H[0, 1], H[0, 0]])
        r = hypot(x[0], x[1])
        bend = float(along @ one.P[:2, :2] @ along) / max(r, 1e-6)
        variance = float((H @ one.P @ H.T)[0, 0]) + R + bend**2 / 2
        return z - float(expected(x)[0]) - bend / 2, variance


TUNINGS = [
    Tuning(psd, slow)
    for psd, slow in product(
        (
            *((one,) for one in (1e-4, 1e-3, 1e-2, 1e-1)),
            *((1e-5, most) for most in (3e-3, 3e-2)),
            (1e-5, 1e-3, 1e-1),
        ),
        (0.0, 0.5),
    )
]
"""Grid of --tune: process noise of the drift, of one mode or of the modes of an IMM, and share of
the slowly varying range error."""
SINGLE = Tuning((1e-2,), 0.5)
MODES = Tuning((1e-6, 3e-3, 1e-1), 0.5)
PEERS: dict[str, Callable[[], Peer]] = {
    "circnav auto": Product,
    "bayesian-filters EKF": lambda: Bank(bayesian_ekf, SINGLE),
    "bayesian-filters UKF": lambda: Bank(bayesian_ukf, SINGLE),
    "bayesian-filters IMM": lambda: Bank(bayesian_imm, MODES),
    "Stone Soup UKF": lambda: Bank(StoneSoupUkf, SINGLE),
    "nrl-tracker CKF": lambda: Bank(NrlCkf, SINGLE),
}


class Result(NamedTuple):
    """Figures of one recording, as in the docstring of this module. A filter that fails
    (LinAlgError) has infinite errors."""

    position: float
    drift: float
    r_dot: float
    nees: float
    trust: float
    wrong: bool
    us: float


FAILED = Result(inf, inf, inf, inf, inf, False, float("nan"))


def run(peer: Peer, steps: list[Step]) -> Result:
    """Return the figures of a filter on a recording."""
    errors = []
    trust = inf
    wrong = False
    spent = 0.0
    updates = 0
    late = steps[-1].own.time - LATE
    for step in steps:
        own = step.own
        began = time.process_time()
        try:
            peer.feed(own, step.sample)
        except (np.linalg.LinAlgError, ValueError):
            return FAILED
        if own.time > late:
            spent += time.process_time() - began
            updates += step.sample is not None
        if step.sample is None:
            continue
        found = peer.estimate()
        if found is None:
            continue
        truth = step.truth
        off = found.position - np.array([truth.x, truth.y])
        spread = float(np.trace(found.covariance)) ** 0.5
        if trust == inf and spread < 0.25 * step.sample.r:
            trust = own.time
            wrong = hypot(*off) > 3 * spread
        if own.time > late:
            drift = found.drift - np.array([truth.drift_x, truth.drift_y])
            nees = float(off @ np.linalg.solve(found.covariance, off))
            errors.append((hypot(*off), hypot(*drift), found.r_dot - truth.r_dot, nees))
    if not errors:
        return FAILED
    table = np.array(errors)
    position, drift_error, r_dot = np.sqrt((table[:, :3] ** 2).mean(axis=0))
    return Result(
        float(position), float(drift_error), float(r_dot), float(table[:, 3].mean()), trust, wrong,
        1e6 * spent / max(updates, 1),
    )  # fmt: skip


def one(job: tuple[str, int, list[str]]) -> list[Result]:
    """Run filters on one recording."""
    name, seed, peers = job
    steps = record(name, seed)
    return [run(PEERS[peer](), steps) for peer in peers]


def row(name: str, peer: str, results: list[Result]) -> str:
    """Return a line of the table."""
    middle = Result(*(float(np.median(column)) for column in zip(*results, strict=True)))
    count = len(results)
    low, high = chi2.ppf([0.025, 0.975], 2 * count) / count
    kept = [one.nees for one in results if one.nees < inf]
    nees = float(np.mean(kept)) if kept else inf
    lost = sum(one.position > 50.0 for one in results)
    wrong = sum(one.wrong for one in results)
    return (
        f"| {name} | {peer} | {middle.position:.2f} | {middle.drift:.2f} | {middle.r_dot:.3f} |"
        f" {nees:.1f} ({low:.1f} to {high:.1f}) | {middle.trust:.1f} | {wrong} | {lost} |"
        f" {middle.us:.0f} |"
    )


HEADER = (
    "| situation | filter | position, m | drift, m/s | range rate, m/s | NEES | trust, s | wrong"
    " | lost | us |\n|---|---|---|---|---|---|---|---|---|---|"
)


def tuned(job: tuple[str, int]) -> list[float]:
    """Return the RMS position error of each tuning of TUNINGS on one recording."""
    steps = record(*job)
    return [
        run(Bank(bayesian_ekf if len(one.drift_psd) == 1 else bayesian_imm, one), steps).position
        for one in TUNINGS
    ]


def main() -> None:
    """Print the table, or the errors of each tuning."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=5, help="recordings of a situation")
    parser.add_argument("--situation", action="append", choices=NAMES, help="only these")
    parser.add_argument("--filter", action="append", choices=PEERS, help="only these")
    parser.add_argument("--tune", action="store_true", help="print the errors of each tuning")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    names = options.situation or NAMES
    peers = options.filter or list(PEERS)
    with ProcessPoolExecutor(options.processes) as pool:
        if options.tune:
            jobs = [(name, seed) for name in names for seed in (901,)]
            errors = np.minimum(list(pool.map(tuned, jobs)), 1e3)
            for number, tuning in enumerate(TUNINGS):
                mean = float(np.exp(np.log(errors[:, number]).mean()))
                each = ", ".join(f"{error:.2f}" for error in errors[:, number])
                print(f"{tuning.drift_psd} slow {tuning.slow}: {mean:.3f} m ({each})", flush=True)
            return
        print(HEADER)
        for name in names:
            jobs = [(name, seed, peers) for seed in range(1, 1 + options.flights)]
            found = list(pool.map(one, jobs))
            for number, peer in enumerate(peers):
                print(row(name, peer, [results[number] for results in found]), flush=True)


if __name__ == "__main__":
    main()
