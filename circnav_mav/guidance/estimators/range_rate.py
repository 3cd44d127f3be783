"""`kalman`: constant-velocity Kalman filter on (r, r'), built on filterpy."""

from math import sqrt

import numpy as np
from filterpy.kalman import KalmanFilter

from circnav_mav.guidance.estimators.interface import EstimatorSettings, Fused
from circnav_mav.guidance.estimators.steady import acceleration_variance
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RangeSample


class KalmanRangeRate:
    """State (r, r') in m and m/s, driven by an unknown acceleration that is constant over a sample interval.

    Its standard deviation is a third of the physical bound |r''| <= V^2/r + V omega_max. The time step is the
    difference of two sensor stamps, so jitter on the way costs nothing. The first sample starts the filter with
    r' = 0 and variance V^2/2: what -V cos(theta_b) has for a bearing nobody knows.
    """

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self._filter = KalmanFilter(dim_x=2, dim_z=1)
        self._filter.H = np.array([[1.0, 0.0]])
        self._filter.inv = np.reciprocal  # the innovation covariance is 1 x 1
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._newest: RangeSample | None = None
        self._refused: list[RangeSample] = []
        self._accepted = 0
        self._nis: float | None = None

    @property
    def ready(self) -> bool:
        """Enough samples, and r' better known than before the first of them (a standard deviation of V/sqrt 2)."""
        return self._accepted >= self._settings.min_samples and self._filter.P[1, 1] < self._settings.speed**2 / 4

    @property
    def nis(self) -> float | None:
        """Normalised innovation squared of the newest sample, taken in or not; chi-square with 1 degree of freedom."""
        return self._nis

    def observe(self, sample: RangeSample) -> Fused:
        """Take one sample in, or refuse it at the gate. Stamps must rise from call to call."""
        if self._newest is None:
            self._start(sample)
            return Fused.ACCEPTED
        self._predict_to(sample)
        variance = self._filter.P[0, 0] + sample.sigma**2
        self._nis = float((sample.r - self._filter.x[0, 0]) ** 2 / variance)
        if self._nis > self._settings.gate**2:
            return self._refuse(sample)
        self._filter.update(sample.r, R=sample.sigma**2)
        self._accepted += 1
        self._refused.clear()
        return Fused.ACCEPTED

    def restamp(self) -> None:
        """Start anew: the steps of this filter are those of the sensor's clock."""
        self.reset()

    def move(self, motion: OwnMotion) -> None:
        """Of no use here: range alone is enough."""

    def at(self, time: float) -> RangeEstimate | None:
        """The estimate predicted to a moment of the local clock; None before the first sample."""
        if self._newest is None:
            return None
        ahead = max(time - self._newest.time, 0.0)
        (r,), (r_dot,) = self._filter.x.tolist()  # plain numbers: several times faster than numpy's
        (p_rr, p_rv), (_, p_vv) = self._filter.P.tolist()
        q = acceleration_variance(self._settings, r)
        return RangeEstimate(
            time=time,
            r=r + r_dot * ahead,
            r_dot=r_dot,
            r_sigma=sqrt(p_rr + 2 * ahead * p_rv + ahead**2 * p_vv + q * ahead**4 / 4),
            r_dot_sigma=sqrt(p_vv + q * ahead**2),
        )

    def _start(self, sample: RangeSample) -> None:
        self._filter.x = np.array([[sample.r], [0.0]])
        self._filter.P = np.diag([sample.sigma**2, self._settings.speed**2 / 2])
        self._newest, self._accepted, self._nis = sample, 1, None
        self._refused.clear()

    def _refuse(self, sample: RangeSample) -> Fused:
        """Count a sample outside the gate; a run of them that agree with each other means that we are the outlier."""
        if self._refused and not self._agree(self._refused[-1], sample):
            self._refused.clear()
        self._refused.append(sample)
        if len(self._refused) < self._settings.restart_after:
            return Fused.GATED
        self._start(sample)
        return Fused.RESTARTED

    def _agree(self, before: RangeSample, after: RangeSample) -> bool:
        """Whether two samples can be of one motion: no farther apart than twice the speed carries, plus noise."""
        reach = 2 * self._settings.speed * (after.stamp - before.stamp)
        return abs(after.r - before.r) <= reach + self._settings.gate * sqrt(before.sigma**2 + after.sigma**2)

    def _acceleration_variance(self) -> float:
        """Variance of the unknown acceleration at the present range, m^2/s^4."""
        return acceleration_variance(self._settings, float(self._filter.x[0, 0]))

    def _predict_to(self, sample: RangeSample) -> None:
        """Carry the state to the moment of a sample by the sensor's own clock."""
        assert self._newest is not None
        step = sample.stamp - self._newest.stamp
        F = np.array([[1.0, step], [0.0, 1.0]])
        Q = self._acceleration_variance() * np.array([[step**4 / 4, step**3 / 2], [step**3 / 2, step**2]])
        self._filter.predict(F=F, Q=Q)
        self._newest = sample
