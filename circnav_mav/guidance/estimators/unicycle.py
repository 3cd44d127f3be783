"""`unicycle`: extended Kalman filter on range and the angle to the line of sight, with the turn
rate as input.

    r' = -V cos eta,   eta' = (V/r) sin eta - omega
    z = r + noise,   Doppler: z' = -V cos eta + noise

eta = angle from the velocity to the line of sight, positive if the target is on the left. The model
includes V and omega but no wind: in drift W the error of r' is up to W. Two filters start at eta =
+90 and -90 deg because range alone does not distinguish left from right. The more likely one is
used. Arrays: x (2, 2, B), P (2, 2, 2, B) for state, hypothesis, flight.
"""

from copy import copy
from math import pi, sqrt

import numpy as np

from circnav_mav.guidance.estimators.dead_reckoning import FlownPath, PathPoint
from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings, Fused
from circnav_mav.guidance.maths import Batch, wrap
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RangeSample, RateSample

POSITION_PSD = 0.05**2
ANGLE_PSD = 0.03**2
"""Process noise of r (m^2/s) and eta (rad^2/s), for wind and side-slip."""
CLOSEST = 5.0
"""Smallest range of the state, m: the angle is singular at the target."""
WEIGHT_MEMORY = 20.0
"""Time constant, s, of the evidence for one side of the target; chosen."""
LOST_AFTER = 10
"""Consecutive rejected samples after which both filters restart."""
SURE = 0.5
"""Standard deviation of eta, rad, above which the range rate may not steer."""
MOST_TURNED = pi / 2
LEAST_CHORD = 0.9
"""Largest turn in one prediction, rad, and the ratio of chord to path length of such an arc (pi/2:
0.9). The chord of a longer arc determines neither path length nor turn."""


class UnicycleFilter:
    """Both hypotheses of B flights that are stepped together."""

    def __init__(self, gate: float, flights: int = 1) -> None:
        self._gate = gate
        self.x = np.zeros((2, 2, flights))
        self.P = np.zeros((2, 2, 2, flights))
        self.log_weight = np.zeros((2, flights))
        self.nis = np.full(flights, np.nan)
        self.refused = np.full(flights, LOST_AFTER)
        self.samples = np.zeros(flights, int)

    @property
    def likelier(self) -> tuple[Batch, Batch]:
        """State (2, B) and covariance (2, 2, B) of the more likely hypothesis."""
        best = self.log_weight.argmax(axis=0)
        at = np.arange(self.nis.size)
        return self.x[:, best, at], self.P[:, :, best, at]

    def predict(self, V: Batch, turned: Batch, dt: float) -> None:
        """Predict by dt (s) at airspeed V (B,), m/s, while the heading turns by `turned` (B,), rad:
        midpoint rule."""
        if dt <= 0:
            return
        r, eta = self.x
        half = eta + (V / np.maximum(r, CLOSEST) * np.sin(eta) * dt - turned) / 2
        middle = np.maximum(r - V * np.cos(eta) * dt / 2, CLOSEST)
        self.x = np.stack(
            [r - V * np.cos(half) * dt, eta + V / middle * np.sin(half) * dt - turned]
        )
        F = np.zeros_like(self.P)
        F[0, 0], F[0, 1] = 1.0, V * np.sin(half) * dt
        F[1, 0], F[1, 1] = -V * np.sin(half) / middle**2 * dt, 1 + V / middle * np.cos(half) * dt
        self.P = np.einsum("ij...,jk...,lk...->il...", F, self.P, F)
        self.P[0, 0] += POSITION_PSD * dt
        self.P[1, 1] += ANGLE_PSD * dt
        self.log_weight = self.log_weight * np.exp(-dt / WEIGHT_MEMORY)

    def update(self, z: Batch, sigma: Batch, arrived: Batch) -> None:
        """Add ranges z (B,), m, where they arrived. Restart flights that rejected too many
        consecutive samples."""
        fits = self._fuse(z - self.x[0], np.array([1.0, 0.0])[:, None, None], sigma, arrived)
        refused = arrived & ~fits.any(axis=0)
        self.refused = np.where(arrived, np.where(refused, self.refused + 1, 0), self.refused)
        self.samples = self.samples + (arrived & ~refused)
        self._start(z, sigma, arrived & (self.refused > LOST_AFTER))

    def update_rate(self, z: Batch, sigma: Batch | float, V: Batch, arrived: Batch) -> None:
        """Add range rates measured by Doppler, z (B,), m/s."""
        eta = self.x[1]
        self._fuse(
            z + V * np.cos(eta), np.stack([np.zeros_like(eta), V * np.sin(eta)]), sigma, arrived
        )

    def _fuse(self, nu: Batch, H: Batch, sigma: Batch | float, arrived: Batch) -> Batch:
        PH = (self.P * H[None]).sum(axis=1)
        S = (PH * H).sum(axis=0) + sigma**2
        nis = nu**2 / np.maximum(S, 1e-9)
        fits = nis <= self._gate**2
        K = np.where(arrived & fits, PH / np.maximum(S, 1e-9), 0.0)
        self.x = self.x + K * nu
        self.x[0] = np.maximum(self.x[0], CLOSEST)
        self.x[1] = wrap(self.x[1])
        self.P = self.P - K[:, None] * PH[None]
        likelihood = np.maximum(-0.5 * nis, -0.5 * self._gate**2) - 0.5 * np.log(
            np.maximum(S, 1e-9)
        )
        self.log_weight = self.log_weight + np.where(arrived, likelihood, 0.0)
        best = self.log_weight.argmax(axis=0)
        self.nis = np.where(arrived, nis[best, np.arange(best.size)], self.nis)
        return fits

    def _start(self, z: Batch, sigma: Batch, of: Batch) -> None:
        if not of.any():
            return
        self.x[0][:, of] = np.maximum(z[of], CLOSEST)
        self.x[1][:, of] = np.array([[np.pi / 2], [-np.pi / 2]])
        self.P[..., of] = 0.0
        self.P[0, 0][:, of] = sigma[of] ** 2
        self.P[1, 1][:, of] = 1.0
        self.log_weight[:, of] = 0.0
        self.refused[of] = 0
        self.samples[of] = 1


class UnicycleEstimator(Estimator):
    """The filter in flight. It is ready only if own motion covers the times of the ranges."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self._longest = MOST_TURNED / settings.max_turn_rate
        self.reset()

    def reset(self) -> None:
        self.filter = UnicycleFilter(self._settings.gate)
        self._path = FlownPath()
        self._used: PathPoint | None = None
        self._range_at = float("-inf")

    @property
    def ready(self) -> bool:
        """True if the filter has enough samples and the standard deviation of the angle is below
        SURE."""
        _, P = self.filter.likelier
        return bool(self.filter.samples[0] >= self._settings.min_samples and P[1, 1, 0] < SURE**2)

    @property
    def nis(self) -> float | None:
        return None if np.isnan(self.filter.nis[0]) else float(self.filter.nis[0])

    def move(self, motion: OwnMotion) -> None:
        self._path.move(motion)

    def observe(self, sample: RangeSample) -> Fused:
        point = self._path.at(sample.time)
        before = self._used
        if point is None:
            return Fused.ACCEPTED
        # After a gap in own motion, or a turn of more than a quarter circle since the last range,
        # the chord of the path does not determine the motion: restart.
        if before is not None and (point.piece != before.piece or self._bent(before, point)):
            self.filter = UnicycleFilter(self._settings.gate)
            before = None
        if before is not None:
            if sample.time <= self._range_at:
                return Fused.GATED
            self._carry(self.filter, before, point)
        self._range_at = sample.time
        one = np.array([True])
        sigma = np.array([sample.sigma])
        self.filter.update(np.array([sample.r]), sigma, one)
        self._used = point
        if sample.rate is not None:
            self.observe_rate(sample.rate)
        return Fused.GATED if self.filter.refused[0] else Fused.ACCEPTED

    def observe_rate(self, sample: RateSample) -> None:
        point = self._path.at(sample.time)
        before = self._used
        if (
            point is None
            or before is None
            or point.piece != before.piece
            or sample.time < before.motion.time
        ):
            return
        self._carry(self.filter, before, point)
        V = np.array([point.motion.airspeed])
        one = np.array([True])
        self.filter.update_rate(np.array([sample.r_dot]), np.array([sample.sigma]), V, one)
        self._used = point

    def at(self, time: float) -> RangeEstimate | None:
        point = self._path.at(time)
        if point is None or self._used is None or point.piece != self._used.piece:
            return None
        ahead = copy(self.filter)
        if time > self._used.motion.time:
            self._carry(ahead, self._used, point)
        (r, eta), P = ahead.likelier
        V = point.motion.airspeed
        rate_sigma = V * abs(np.sin(eta[0])) * sqrt(max(P[1, 1, 0], 0.0))
        return RangeEstimate(
            time,
            float(r[0]),
            float(-V * np.cos(eta[0])),
            sqrt(max(P[0, 0, 0], 0.0)),
            float(rate_sigma),
            eta=float(eta[0]),
        )

    def _bent(self, before: PathPoint, after: PathPoint) -> bool:
        """True if the vehicle may have turned by more than a quarter circle: enough time has
        passed, and the chord is short."""
        dt = after.motion.time - before.motion.time
        way = after.motion.airspeed * dt
        return dt > self._longest and bool(
            np.hypot(after.x - before.x, after.y - before.y) < LEAST_CHORD * way
        )

    def _carry(self, unicycle: UnicycleFilter, before: PathPoint, after: PathPoint) -> None:
        turned = wrap(np.array([after.motion.heading - before.motion.heading]))
        dt = after.motion.time - before.motion.time
        V = (
            np.hypot(after.x - before.x, after.y - before.y) / dt
            if dt > 0
            else after.motion.airspeed
        )
        unicycle.predict(np.array([V]), turned, dt)
