"""`kalman`: constant-velocity Kalman filter on (r, r'), by filterpy.

State (r, r') in m and m/s, driven by an unknown acceleration that is constant over a sample
interval. Its standard deviation is a third of the physical bound |r''| <= V^2/r + V omega_max. The
first sample starts the filter with r' = 0 and a variance of r' of V^2/2. This is the variance of
-V cos(theta_b) for an unknown bearing theta_b.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import hypot, sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.guidance.laws import max_range_acceleration
from circnav_mav.guidance.types import RangeEstimate, RangeSample, RateSample

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

Array = NDArray[np.float64]
RANGE = 0
"""Index of the range in the state."""
RATE = 1
"""Index of the range rate in the state."""
ROWS = np.eye(2)[:, None]
"""Matrix from the state to each of its components, (2, 1, 2)."""


def acceleration_variance(settings: EstimatorSettings, r: float) -> float:
    """Return the variance of the unknown acceleration at range r (m), m^2/s^4."""
    # 3.0: physical bound on |r''|, in standard deviations of the process noise.
    return (max_range_acceleration(settings.speed, settings.max_turn_rate, r) / 3.0) ** 2


def motion_model(h: float, q: float) -> tuple[Array, Array]:
    """Return the transition matrix F and the process noise Q over h seconds of an acceleration with
    variance q."""
    moved = h * h / 2
    Q = np.array(((q * moved * moved, q * moved * h), (q * h * moved, q * h * h)))
    return np.array(((1.0, h), (0.0, 1.0))), Q


class KalmanRangeRate(Estimator):
    """Kalman filter of range and range rate. Its time step is the difference of two sensor
    timestamps, so transport jitter has no effect."""

    _filter: "KalmanFilter"
    """Created by the first sample."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        self._newest: RangeSample | RateSample | None = None
        self._samples = self._refused = 0
        self._refused_range: RangeSample | None = None
        self._nis = 0.0

    @property
    def ready(self) -> bool:
        """True if the estimate may steer. There must be enough samples, and the standard deviation
        of r' must be below V/2."""
        settings = self._settings
        return self._samples >= settings.min_samples and bool(
            self._filter.P[1, 1] < settings.speed**2 / 4
        )

    @property
    def nis(self) -> float | None:
        """Normalized innovation squared of the newest sample, accepted or not; chi-square with 1
        degree of freedom."""
        begun = self._samples == 0 or (self._samples == 1 and self._refused == 0)
        return None if begun else self._nis

    def observe(self, sample: RangeSample) -> bool:
        """Add a sample, or reject it at the gate. Timestamps must increase from call to call.

        If several consecutive samples are outside the gate but agree with each other, the filter is
        wrong, and restarts.
        """
        h = (
            0.0 if self._newest is None else max(sample.stamp - self._newest.stamp, 0.0)
        )  # 0 if a newer range rate was received before
        accepted = self._samples > 0 and self._measure(RANGE, h, sample.r, sample.sigma)
        if accepted:
            self._samples = self._samples + 1
            self._refused = 0
        else:
            self._refused = self._refused + 1 if self._agrees(sample, h) else 1
            if self._samples == 0 or self._refused >= self._settings.restart_after:
                self._start(sample)
        self._newest = self._refused_range = sample
        if sample.rate is not None:
            self.observe_rate(sample.rate)
        return self._refused == 0

    def observe_rate(self, sample: RateSample) -> None:
        """Add a range rate, unless it is older than the newest sample. A rate outside the gate is
        ignored. Whether the filter or the rate is wrong is decided by the ranges."""
        if self._newest is None or sample.stamp < self._newest.stamp:
            return
        self._measure(RATE, sample.stamp - self._newest.stamp, sample.r_dot, sample.sigma)
        self._newest = sample

    def restamp(self) -> None:
        """Restart: the time steps of this filter come from the sensor's clock."""
        self.reset()

    def at(self, time: float) -> RangeEstimate | None:
        """Return the estimate predicted to a time of the local clock (s), or None before the first
        sample."""
        if self._newest is None:
            return None
        F, Q = self._model(max(time - self._newest.time, 0.0))
        x = F @ self._filter.x
        P = F @ self._filter.P @ F.T + Q
        r = float(x[0, 0])
        r_dot = float(x[1, 0])
        if r < 0:  # a vehicle that flies straight over the target flies away from it afterwards
            r = -r
            r_dot = -r_dot
        return RangeEstimate(time, r, r_dot, sqrt(P[0, 0]), sqrt(P[1, 1]))

    def _measure(self, component: int, h: float, z: float, sigma: float) -> bool:
        """Predict by h (s) and add a measurement of a component of the state. Return False if it is
        outside the gate and was ignored."""
        F, Q = self._model(h)
        self._filter.predict(F=F, Q=Q)
        x = self._filter.x
        P = self._filter.P
        nis = float((z - x[component, 0]) ** 2 / (P[component, component] + sigma**2))
        if component == RANGE:
            self._nis = nis
        if nis > self._settings.gate**2:
            return False
        self._filter.update(z, R=np.array([[sigma**2]]), H=ROWS[component])
        return True

    def _model(self, h: float) -> tuple[Array, Array]:
        return motion_model(h, acceleration_variance(self._settings, float(self._filter.x[0, 0])))

    def _agrees(self, sample: RangeSample, h: float) -> bool:
        """True if a rejected sample and the rejected sample before it fit a single motion. Then the
        ranges differ by no more than twice the speed times the interval, plus noise."""
        before = self._refused_range
        settings = self._settings
        if before is None or self._refused == 0:
            return True
        return abs(sample.r - before.r) <= 2 * settings.speed * h + settings.gate * hypot(
            before.sigma, sample.sigma
        )

    def _start(self, sample: RangeSample) -> None:
        # The import takes a second, because filterpy loads scipy.stats. So no command waits for it
        # that estimates nothing.
        from filterpy.kalman import KalmanFilter

        self._filter = KalmanFilter(dim_x=2, dim_z=1)
        self._filter.inv = np.reciprocal  # of 1 x 1 matrices, faster than a general inverse
        self._filter.x = np.array([[sample.r], [0.0]])
        self._filter.P = np.diag([sample.sigma**2, self._settings.speed**2 / 2])
        self._samples = 1
        self._refused = 0


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Steady state of the filter.

    r_dot_sigma: standard deviation of the estimated range rate, m/s.
    lag: delay of the estimated range rate under constant acceleration, s.
    """

    r_dot_sigma: float
    lag: float


@lru_cache(maxsize=1024)
def steady_state(
    settings: EstimatorSettings, *, r: float, sigma: float, period: float
) -> SteadyState:
    """Return the filter's steady state for samples of noise sigma (m) every `period` (s) at range r
    (m).

    The steady filter is an alpha-beta filter. Its gains follow from the tracking index (Kalata,
    1984), with alpha = 1 - root^2 and beta = 2 (1 - root)^2. Under constant acceleration its lag is
    T (2 alpha - beta)/(2 beta).
    """
    index = sqrt(acceleration_variance(settings, r)) * period**2 / sigma
    root = 4 / (4 + index + sqrt(index * (index + 8)))
    return SteadyState(
        r_dot_sigma=2 * sigma / period * sqrt((1 - root) ** 3 / root),
        lag=period * root / (1 - root),
    )
