"""Estimator of the product beside public filters, on the same recorded ranges and own motion.

    pip install -e '.[peers]'
    python -m tests.tools.bench.bench_peers                         # the table
    python -m tests.tools.bench.bench_peers --tune --flights 1      # noises of the public filters

Recordings: point-mass flights of `circnav bench`, 120 s, ranges at 10 Hz, start within 100 to 300
m. The law of `auto` steers with the true position and drift: no estimator affects the path.

Public filters: bayesian-filters (the maintained fork of filterpy), Stone Soup, nrl-tracker (pytcl).
Their states are those of the product without accelerations: position relative to the target as
range and direction (one EKF: as x and y), drift, airspeed scale, a slowly varying range error, and
gusts; the motion is the chord of the measured air path. They share no code with the product.

Tuning: the filters have the true noises of heading, airspeed and ranges, a gate of 5 sigma, and the
priors of drift and scale of the product. One Gaussian cannot represent the ring of the first range:
each filter starts as a bank of 32 directions, weighted by likelihood. The process noise of the
drift, the gusts and the share of the slowly varying range error are tuned: --tune prints the errors
of each choice of a grid, best first, on one recording of each situation, with other seeds than the
table. The best choice has the least geometric mean of the RMS position errors. UKF and CKF have the
choice of the EKF. *EKF, tuned to the situation*: with the best choice for this situation alone,
which no flight knows in advance. The product has its fixed noises.

Position, drift, range rate: RMS error of the last 60 s; median of the recordings and its 95 %
interval. NEES: of the position, mean of the last 60 s and of the recordings; the header has the 95
% band for one instant of all recordings. Trust: time until the stated standard deviation of the
position is below a quarter of the range. *wrong*: number of recordings whose error then exceeds
three of these standard deviations. *lost*: number of recordings with a position error above 50 m.
us: processor time of a range with its own motion, in the last 60 s, median.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import product
from math import atan2, cos, exp, hypot, inf, pi, sin
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from circnav_mav import Guidance, OwnMotion, RangeSample, tune
from circnav_mav.extras.bench.flight import FullInformation, MotionSensors, Radio, World
from circnav_mav.extras.bench.situations import ORBIT, SITUATIONS, TURN_LAG
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator
from tests.tools.bench.intervals import median

Array = NDArray[Any]
NAMES = (
    "calm", "wind 0.33 V", "gusts 1.5, wind 0.33 V", "target turns", "lora, wind 0.2 V",
    "uwb, wind 0.2 V", "10 % outliers of 20 m",
)  # fmt: skip
LATE = 60.0
"""Length of the evaluated last part of a recording, s."""
STARTS = 32
"""Number of directions in which a public filter starts."""
STATES = 8
"""Number of states of a public filter."""
POSITION_PSD = 0.0045
"""Process noise of the position, m^2/s: airspeed noise of 0.3 m/s along, and heading noise of 0.02
rad at 15 m/s across the path, each independent at 20 Hz."""
BIAS_TIME = 3.0
"""Correlation time of the slowly varying range error of the public filters, s."""
GUST_TIME = 10.0
"""Correlation time of the gusts of the public filters, s."""


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
    situation = replace(known, start=(100.0, 300.0), duration=120.0, ranging=radio_errors)
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
        """Process the vehicle's motion in one step, and a range if one was received."""

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


class Mode(NamedTuple):
    """Noises of a public filter.

    drift_psd: process noise of the drift, m^2/s^3.
    gust: standard deviation of each component of the gusts, m/s.
    slow: share of the variance of a range that varies slowly.
    """

    drift_psd: float
    gust: float
    slow: float


class Tuning(NamedTuple):
    """Tuning of a public filter: one mode, or the modes of an IMM.

    stay: probability that a mode of an IMM continues from one range to the next.
    """

    modes: tuple[Mode, ...]
    stay: float = 1.0


class Coordinates(Protocol):
    """Meaning of the first two of the STATES states (position, drift_x, drift_y, scale, range
    error, gust_x, gust_y)."""

    def place(self, x: Array) -> Array:
        """Return the position relative to the target, m."""

    def to_plane(self, x: Array) -> Array:
        """Return the Jacobian of `place` in the first two states."""

    def states(self, place: Array, near: Array) -> Array:
        """Return the first two states at a position. near: state close to it."""

    def expected(self, x: Array) -> Array:
        """Return the predicted range, m, as an array (1,)."""

    def slope(self, x: Array) -> Array:
        """Return the Jacobian of `expected`."""

    def bend(self, x: Array, P: Array) -> float:
        """Return the mean of the range that its Jacobian neglects, m."""


class Cartesian:
    """Position as x and y."""

    def place(self, x: Array) -> Array:
        return x[:2]

    def to_plane(self, x: Array) -> Array:
        return np.eye(2)

    def states(self, place: Array, near: Array) -> Array:
        return place

    def expected(self, x: Array) -> Array:
        return np.array([hypot(x[0], x[1]) + x[5]])

    def slope(self, x: Array) -> Array:
        r = max(hypot(x[0], x[1]), 1e-6)
        return np.array([[x[0] / r, x[1] / r, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])

    def bend(self, x: Array, P: Array) -> float:
        r = max(hypot(x[0], x[1]), 1e-6)
        across = np.array([-x[1], x[0]]) / r
        return float(across @ P[:2, :2] @ across) / r / 2


class Polar:
    """Position as range and direction, as in the product. The range is then linear in the state,
    and the motion is not."""

    def place(self, x: Array) -> Array:
        return np.array([x[0] * cos(x[1]), x[0] * sin(x[1])])

    def to_plane(self, x: Array) -> Array:
        c = cos(x[1])
        s = sin(x[1])
        r = max(x[0], 1.0)
        return np.array([[c, -r * s], [s, r * c]])

    def states(self, place: Array, near: Array) -> Array:
        c = cos(near[1])
        s = sin(near[1])
        turned = atan2(c * place[1] - s * place[0], c * place[0] + s * place[1])
        return np.array([hypot(*place), near[1] + turned])

    def expected(self, x: Array) -> Array:
        return x[[0]] + x[5]

    def slope(self, x: Array) -> Array:
        return np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])

    def bend(self, x: Array, P: Array) -> float:
        return 0.0


class Move:
    """Motion between two ranges."""

    def __init__(self, space: Coordinates, dt: float, chord: Array) -> None:
        """dt: s. chord: chord of the measured air path, m."""
        self._space = space
        self._way = np.zeros((2, STATES))
        self._way[:, 2:4] = dt * np.eye(2)
        self._way[:, 4] = chord
        self._way[:, 6:] = dt * np.eye(2)
        self.keep = np.ones(STATES)
        self.keep[5] = exp(-dt / BIAS_TIME)
        self.keep[6:] = exp(-dt / GUST_TIME)

    def __call__(self, x: Array) -> Array:
        """Return the state after the motion."""
        moved = self.keep * x
        moved[:2] = self._space.states(self._space.place(x) + self._way @ x, x)
        return moved

    def jacobian(self, x: Array) -> Array:
        """Return the Jacobian of the motion."""
        F = np.diag(self.keep)
        F[:2] = self._way
        F[:2, :2] += self._space.to_plane(x)
        F[:2] = np.linalg.inv(self._space.to_plane(self(x))) @ F[:2]
        return F


class Filter(Protocol):
    """One Gaussian filter of a package."""

    x: Array
    P: Array

    def predict(self, move: Move, noises: list[Array]) -> None:
        """Predict over a motion. noises: process noise of each mode."""

    def update(self, z: float, variances: list[float]) -> None:
        """Add a range z. variances: variance of the range in each mode."""


Make = Callable[[Array, Array, Coordinates, Tuning], Filter]


def bayesian_ekf(x: Array, P: Array, space: Coordinates, tuning: Tuning) -> Filter:
    """Return the extended Kalman filter of bayesian-filters."""
    from bayesian_filters.kalman import ExtendedKalmanFilter

    class Ekf(ExtendedKalmanFilter):  # type: ignore[misc]
        move: Move

        def predict_x(self, u: Any = 0) -> None:
            self.x = self.move(self.x)

        def predict(self, move: Any = None, noises: Any = None) -> None:
            if noises is not None:
                self.move = move
                self.Q = noises[0]
            self.F = self.move.jacobian(self.x)
            super().predict()

        def update(self, z: Any, variances: Any = None) -> None:
            R = None if variances is None else variances[0]
            super().update(np.atleast_1d(z), space.slope, space.expected, R=R)

    made = Ekf(STATES, 1)
    made.x = x
    made.P = P
    return made  # type: ignore[no-any-return]


def bayesian_ukf(x: Array, P: Array, space: Coordinates, tuning: Tuning) -> Filter:
    """Return the unscented Kalman filter of bayesian-filters."""
    from bayesian_filters.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    class Ukf(UnscentedKalmanFilter):  # type: ignore[misc]
        def predict(self, move: Move, noises: list[Array]) -> None:
            self.Q = noises[0]
            self.P = (self.P + self.P.T) / 2
            super().predict(fx=lambda x, dt: move(x))

        def update(self, z: float, variances: list[float]) -> None:
            super().update(np.array([z]), R=np.array([variances]))

    points = MerweScaledSigmaPoints(STATES, alpha=0.5, beta=2.0, kappa=3.0 - STATES)
    made = Ukf(STATES, 1, 0.1, space.expected, None, points)
    made.x = x
    made.P = P
    return made  # type: ignore[no-any-return]


def bayesian_imm(x: Array, P: Array, space: Coordinates, tuning: Tuning) -> Filter:
    """Return the interacting multiple models of bayesian-filters, over extended Kalman filters."""
    from bayesian_filters.kalman import IMMEstimator

    class Imm(IMMEstimator):  # type: ignore[misc]
        def predict(self, move: Move, noises: list[Array]) -> None:
            for one, Q in zip(self.filters, noises, strict=True):
                one.move = move
                one.Q = Q
            super().predict()

        def update(self, z: float, variances: list[float]) -> None:
            for one, R in zip(self.filters, variances, strict=True):
                one.R = np.array([[R]])
            super().update(z)

    modes = len(tuning.modes)
    change = np.full((modes, modes), (1 - tuning.stay) / (modes - 1))
    np.fill_diagonal(change, tuning.stay)
    filters = [bayesian_ekf(x.copy(), P.copy(), space, tuning) for _ in range(modes)]
    return Imm(filters, np.full(modes, 1 / modes), change)  # type: ignore[no-any-return]


class StoneSoupUkf:
    """Unscented Kalman filter of Stone Soup."""

    def __init__(self, x: Array, P: Array, space: Coordinates, tuning: Tuning) -> None:
        from stonesoup.models.base import GaussianModel
        from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
        from stonesoup.models.transition.base import TransitionModel
        from stonesoup.predictor.kalman import UnscentedKalmanPredictor
        from stonesoup.types.array import StateVector, StateVectors
        from stonesoup.types.state import GaussianState
        from stonesoup.updater.kalman import UnscentedKalmanUpdater

        def each(function: Callable[[Array], Array], state: Any) -> Any:
            columns = np.asarray(state.state_vector, float).T
            values = np.array([function(column) for column in columns]).T
            return (StateVectors if len(columns) > 1 else StateVector)(values)

        class Ranging(NonLinearGaussianMeasurement):  # type: ignore[misc]
            translation_offset = None

            @property
            def ndim_meas(self) -> int:
                return 1

            def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
                return each(space.expected, state)

        class Motion(TransitionModel, GaussianModel):  # type: ignore[misc]
            ndim_state = STATES
            move: Move
            noise: Array

            def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
                return each(self.move, state)

            def covar(self, **_: Any) -> Array:
                return self.noise

        self._ranging = Ranging
        self._vector = StateVector
        self._motion = Motion()
        shape = {"alpha": 0.5, "beta": 2.0, "kappa": 3.0 - STATES}
        self._predictor = UnscentedKalmanPredictor(self._motion, **shape)
        self._updater = UnscentedKalmanUpdater(None, **shape)
        self._state = GaussianState(StateVector(x), P, timestamp=datetime(2026, 1, 1))

    @property
    def x(self) -> Array:
        return np.asarray(self._state.state_vector, float).ravel()

    @property
    def P(self) -> Array:  # noqa: N802
        return np.asarray(self._state.covar, float)

    def predict(self, move: Move, noises: list[Array]) -> None:
        self._motion.move = move
        self._motion.noise = noises[0]
        when = self._state.timestamp + timedelta(seconds=0.1)
        self._state = self._predictor.predict(self._state, timestamp=when)

    def update(self, z: float, variances: list[float]) -> None:
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis

        model = self._ranging(ndim_state=STATES, mapping=(0, 1), noise_covar=np.array([variances]))
        detection = Detection(
            self._vector([z]), timestamp=self._state.timestamp, measurement_model=model
        )
        self._state = self._updater.update(SingleHypothesis(self._state, detection))


class NrlCkf:
    """Cubature Kalman filter of nrl-tracker."""

    def __init__(self, x: Array, P: Array, space: Coordinates, tuning: Tuning) -> None:
        self.x = x
        self.P = P
        self._space = space

    def predict(self, move: Move, noises: list[Array]) -> None:
        from pytcl.dynamic_estimation.kalman.unscented import ckf_predict

        found = ckf_predict(self.x, self.P, move, noises[0])
        self.x = found.x
        self.P = found.P

    def update(self, z: float, variances: list[float]) -> None:
        from pytcl.dynamic_estimation.kalman.unscented import ckf_update

        found = ckf_update(
            self.x, self.P, np.array([z]), self._space.expected, np.array([variances])
        )
        self.x = found.x
        self.P = found.P


class Bank:
    """A public filter as a bank over the directions of the target. Directions of negligible
    likelihood are removed, and directions that have converged are merged."""

    def __init__(self, make: Make, space: Coordinates, tuning: Tuning) -> None:
        self._make = make
        self._space = space
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
        move = Move(self._space, dt, self._chord)
        self._chord = np.zeros(2)
        self._since = 0.0
        modes = self._tuning.modes
        lost = 1 - move.keep**2
        added = np.zeros((len(modes), STATES))
        for row, mode in zip(added, modes, strict=True):
            row[2:4] = dt * mode.drift_psd
            row[4] = 1e-7 * dt
            row[5] = mode.slow * sample.sigma**2 * lost[5]
            row[6:] = mode.gust**2 * lost[6:]
        variances = [(1 - mode.slow) * sample.sigma**2 for mode in modes]
        for one in self._filters:
            from_plane = np.linalg.inv(self._space.to_plane(np.asarray(one.x)))
            noises = [np.diag(row) for row in added]
            for noise in noises:
                noise[:2, :2] = dt * POSITION_PSD * from_plane @ from_plane.T
            one.predict(move, noises)
        # The weights of the directions use the whole variance of a range. With the share that
        # varies fast, a wrong share would remove the true direction.
        misses = np.array([self._miss(one, sample.r, sample.sigma**2) for one in self._filters])
        squared = misses[:, 0] ** 2 / misses[:, 1]
        # An outlier is outside the gate of every direction. After five in a row the filters are
        # wrong, and not the ranges.
        if squared.min() > 25.0 and self._outside < 5:
            self._outside += 1
            return
        self._outside = 0
        self._weights -= (squared + np.log(misses[:, 1])) / 2
        self._weights -= self._weights.max()
        self._keep(self._weights > -9.0)
        for one in self._filters:
            one.update(sample.r, variances)
        if len(self._filters) > 1:
            self._merge()

    def _places(self) -> tuple[Array, Array]:
        """Return positions (n, 2) and their covariances (n, 2, 2) of the filters."""
        places = np.array([self._space.place(one.x) for one in self._filters])
        planes = np.array([self._space.to_plane(one.x) for one in self._filters])
        inner = np.array([one.P[:2, :2] for one in self._filters])
        return places, planes @ inner @ planes.transpose(0, 2, 1)

    def _merge(self) -> None:
        """Remove the directions that have converged to the heaviest one: within half of its
        standard deviation of the position."""
        heaviest = int(self._weights.argmax())
        places, covariances = self._places()
        spread = np.trace(covariances[heaviest]) ** 0.5
        same = np.hypot(*(places - places[heaviest]).T) < 0.5 * spread
        self._weights[heaviest] = np.log(np.exp(self._weights[same]).sum())
        same[heaviest] = False
        self._keep(~same)

    def _keep(self, kept: Array) -> None:
        self._filters = [one for one, keep in zip(self._filters, kept, strict=True) if keep]
        self._weights = self._weights[kept]

    def estimate(self) -> Estimate | None:
        if not self._filters or self._own is None:
            return None
        share = np.exp(self._weights)
        share /= share.sum()
        places, covariances = self._places()
        place = share @ places
        apart = places - place
        P = np.einsum("n,nij->ij", share, covariances + apart[:, :, None] * apart[:, None, :])
        x = share @ np.array([one.x for one in self._filters])
        V = x[4] * self._own.airspeed
        drift = x[2:4] + x[6:]
        velocity = drift + V * np.array([cos(self._own.heading), sin(self._own.heading)])
        return Estimate(place, P, drift, float(place @ velocity) / max(hypot(*place), 1e-6))

    def _ring(self, sample: RangeSample) -> Iterator[Filter]:
        """Yield the filters round the first range."""
        slow = max(mode.slow for mode in self._tuning.modes) * sample.sigma**2 + 1e-9
        gust = max(mode.gust for mode in self._tuning.modes) ** 2 + 1e-9
        for direction in np.arange(STARTS) * 2 * pi / STARTS:
            out = np.array([cos(direction), sin(direction)])
            across = np.array([-out[1], out[0]])
            near = np.array([sample.r, direction])
            x = np.array([*self._space.states(sample.r * out, near), 0, 0, 1, 0, 0, 0])
            P = np.diag([0.0, 0.0, 9.0, 9.0, 0.0025, slow, gust, gust])
            from_plane = np.linalg.inv(self._space.to_plane(x))
            sides = from_plane @ np.column_stack(
                [sample.sigma * out, pi * sample.r / STARTS * across]
            )
            P[:2, :2] = sides @ sides.T
            yield self._make(x, P, self._space, self._tuning)

    def _miss(self, one: Filter, z: float, R: float) -> tuple[float, float]:
        """Return innovation and its variance, with the second-order effect of the bearing."""
        x = np.asarray(one.x)
        H = self._space.slope(x)
        bend = self._space.bend(x, one.P)
        variance = float((H @ one.P @ H.T)[0, 0]) + R + 2 * bend**2
        return z - float(self._space.expected(x)[0]) - bend, variance


SINGLES = [
    Tuning((Mode(*values),))
    for values in product((1e-5, 1e-4, 1e-3, 1e-2), (0.0, 0.5, 1.5), (0.0, 0.5, 0.9))
]
"""Grid of --tune for filters with one mode."""
STEADY = Mode(1e-6, 0.0, 0.0)
STEADY_SLOW = Mode(1e-6, 0.0, 0.8)
TURNING = Mode(3e-2, 0.0, 0.0)
GUSTY = Mode(1e-4, 1.5, 0.0)
SEVERAL = [
    Tuning(modes, stay)
    for modes, stay in product(
        (
            (STEADY, TURNING),
            (STEADY, GUSTY),
            (STEADY, STEADY_SLOW, GUSTY, TURNING),
        ),
        (0.99, 0.999),
    )
]
"""Grid of --tune for an IMM."""


class Public(NamedTuple):
    """A public filter.

    make: constructor.
    space: coordinates.
    grid: tunings of --tune.
    chosen: best tuning.
    by_situation: best tuning for each situation alone, if it is known to the filter.
    """

    make: Make
    space: Coordinates
    grid: list[Tuning]
    chosen: Tuning
    by_situation: dict[str, Tuning] | None = None

    def __call__(self, situation: str) -> Peer:
        tuning = self.chosen if self.by_situation is None else self.by_situation[situation]
        return Bank(self.make, self.space, tuning)


SINGLE = Tuning((Mode(1e-5, 0.0, 0.5),))
SEPARATE = {
    "calm": Tuning((Mode(1e-5, 0.0, 0.5),)),
    "wind 0.33 V": Tuning((Mode(1e-5, 0.0, 0.5),)),
    "gusts 1.5, wind 0.33 V": Tuning((Mode(1e-5, 1.5, 0.0),)),
    "target turns": Tuning((Mode(1e-2, 0.0, 0.0),)),
    "lora, wind 0.2 V": Tuning((Mode(1e-5, 0.0, 0.5),)),
    "uwb, wind 0.2 V": Tuning((Mode(1e-5, 0.0, 0.0),)),
    "10 % outliers of 20 m": Tuning((Mode(1e-5, 0.0, 0.5),)),
}
MODES = Tuning((STEADY, STEADY_SLOW, GUSTY, TURNING), 0.999)
"""Best tunings by --tune: of an EKF, of an EKF in each situation, and of an IMM."""
PUBLIC = {
    "EKF, x and y": Public(bayesian_ekf, Cartesian(), SINGLES, SINGLE),
    "EKF": Public(bayesian_ekf, Polar(), SINGLES, SINGLE),
    "EKF, tuned to the situation": Public(bayesian_ekf, Polar(), SINGLES, SINGLE, SEPARATE),
    "UKF": Public(bayesian_ukf, Polar(), SINGLES, SINGLE),
    "IMM": Public(bayesian_imm, Polar(), SEVERAL, MODES),
    "UKF of Stone Soup": Public(StoneSoupUkf, Polar(), SINGLES, SINGLE),
    "CKF of nrl-tracker": Public(NrlCkf, Polar(), SINGLES, SINGLE),
}
"""Public filters, of bayesian-filters unless stated."""
TUNED = ("EKF, x and y", "EKF", "IMM")
"""Filters that --tune tunes by default."""
PEERS: dict[str, Callable[[str], Peer]] = {"circnav auto": lambda name: Product(), **PUBLIC}


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
    return [run(PEERS[peer](name), steps) for peer in peers]


def row(name: str, peer: str, results: list[Result]) -> str:
    """Return a line of the table."""
    mean = np.mean([one.nees for one in results])
    nees = f"{mean:.1f}" if mean < 1000.0 else "> 1000"
    lost = sum(one.position > 50.0 for one in results)
    wrong = sum(one.wrong for one in results)
    position, drift, r_dot, trust = (
        median([one[column] for one in results], form)
        for column, form in ((0, ".2f"), (1, ".2f"), (2, ".3f"), (4, ".1f"))
    )
    us = float(np.nanmedian([one.us for one in results]))
    return (
        f"| {name} | {peer} | {position} | {drift} | {r_dot} | {nees} | {trust} | {wrong} |"
        f" {lost} | {us:.0f} |"
    )


def header(count: int) -> str:
    """Return the header of a table of so many recordings a row."""
    low, high = chi2.ppf([0.025, 0.975], 2 * count) / count
    return (
        f"| {count} recordings a row | filter | position, m | drift, m/s | range rate, m/s"
        f" | NEES ({low:.1f} to {high:.1f}) | trust, s | wrong | lost | us |\n"
        "|---|---|---|---|---|---|---|---|---|---|"
    )


def tuned(job: tuple[str, int, str]) -> list[tuple[float, float]]:
    """Return RMS position error and NEES of each tuning of a filter on one recording."""
    name, seed, peer = job
    steps = record(name, seed)
    public = PUBLIC[peer]
    results = [run(Bank(public.make, public.space, one), steps) for one in public.grid]
    return [(one.position, one.nees) for one in results]


def tune_filter(
    run_all: Callable[..., Iterator[list[tuple[float, float]]]],
    peer: str,
    names: Sequence[str],
    seeds: Sequence[int],
) -> None:
    """Print the mean errors of the tunings of a filter."""
    jobs = [(name, seed, peer) for name in names for seed in seeds]
    table = np.minimum(list(run_all(tuned, jobs)), 1e3)
    figures = table.reshape(len(names), len(seeds), -1, 2)
    errors, nees = np.moveaxis(np.exp(np.log(figures).mean(axis=1)), -1, 0)
    order = np.argsort(np.log(errors).mean(axis=0))
    for number in order:
        tuning = PUBLIC[peer].grid[number]
        each = ", ".join(
            f"{error:.2f} ({ratio:.1f})"
            for error, ratio in zip(errors[:, number], nees[:, number], strict=True)
        )
        mean = np.exp(np.log(errors[:, number]).mean())
        modes = [tuple(mode) for mode in tuning.modes]
        print(f"{peer} {modes} {tuning.stay}: {mean:.3f} m: {each}", flush=True)


def main() -> None:
    """Print the table, or the errors of each tuning."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=6, help="recordings of a situation")
    parser.add_argument("--situation", action="append", choices=NAMES, help="only these")
    parser.add_argument("--filter", action="append", choices=PEERS, help="only these")
    parser.add_argument("--tune", action="store_true", help="print the errors of each tuning")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    names = options.situation or NAMES
    peers = options.filter or list(PEERS)
    with ProcessPoolExecutor(options.processes) as pool:
        if options.tune:
            for peer in options.filter or TUNED:
                tune_filter(pool.map, peer, names, range(901, 901 + options.flights))
            return
        jobs = [(name, seed, peers) for name in names for seed in range(1, 1 + options.flights)]
        found = pool.map(one, jobs)
        print(header(options.flights))
        for name in names:
            results = [next(found) for _ in range(options.flights)]
            for peer, figures in zip(peers, zip(*results, strict=True), strict=True):
                print(row(name, peer, list(figures)), flush=True)


if __name__ == "__main__":
    main()
