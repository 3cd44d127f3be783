"""Estimators `drift` and `auto`. They update the relative-motion filters with ranges and own motion
in order of arrival."""

from dataclasses import replace
from math import cos, hypot, sin, sqrt

from circnav_mav.guidance.estimators.acquisition import Prior
from circnav_mav.guidance.estimators.dead_reckoning import FlownPath, PathPoint, predict_mixture
from circnav_mav.guidance.estimators.interface import (
    Estimator,
    EstimatorSettings,
    MethodChange,
)
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.estimators.relative_ekf import DX, DY, KAPPA, drift
from circnav_mav.guidance.estimators.relative_filter import RelativeFilter
from circnav_mav.guidance.estimators.tracker import TRUSTED, Rate
from circnav_mav.guidance.maths import Vector
from circnav_mav.guidance.types import (
    OwnMotion,
    RangeEstimate,
    RangeSample,
    RateSample,
    RelativeMotion,
)

MEMORY = 10.0
"""Least age, s, of the stored drift estimate from which the search restarts after a gap without
ranges. A newer estimate may already be affected by the cause of the gap."""
REMEMBERED = 0.01
"""Scale of the prior distribution of the stored drift, as a share of V. With 0.03, the search
after a gap takes two to four times as long."""
FORGOTTEN = 1e-3
"""Growth rate of the variance of the stored drift with its age, m^2/s^3."""


class DriftEstimator(Estimator):
    """Estimates position relative to the target and drift from range, heading, turn rate and
    airspeed.

    The estimator is ready only if own motion is known at the time of the newest range and the
    estimate is trusted. Late, repeated and reordered samples are rejected.
    """

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        self.filter = RelativeFilter(self._settings)
        self._path = FlownPath()
        self._used: PathPoint | None = None
        self._range_at = float("-inf")
        self._sigma = 1.0
        self._astray = False
        self._asked: float | None = None
        """Time of the first estimate since the newest range, s."""
        self._lately: tuple[float, Prior] | None = None
        self._before: tuple[float, Prior] | None = None

    @property
    def ready(self) -> bool:
        """True if the estimate is trusted, and own motion is known at the time of the newest
        range."""
        return self.filter.trusted and not self._astray

    @property
    def nis(self) -> float | None:
        """Normalized innovation squared of the newest sample, or None while searching."""
        return None if self.filter.tracker is None else self.filter.tracker.nis

    def move(self, motion: OwnMotion) -> None:
        self._path.move(motion)

    def fly_through_air(self, change: MethodChange) -> None:
        """Continue a trusted track with the wind in its drift. A search starts again with the wind
        as its prior."""
        self._settings = change.settings
        x, y = change.wind
        drift_sigma = hypot(change.wind_sigma, REMEMBERED * change.settings.speed)
        known = Prior(drift_sigma, change.scale_sigma, x, y)
        self.filter = self.filter.fly_through_air(change, known)
        self._lately = self._before = None
        if self.filter.tracker is None:
            self._used = None

    def observe(self, sample: RangeSample) -> bool:
        point = self._path.at(sample.time)
        before = self._used
        if point is None:
            # Own motion is unknown at the time of this range: the vehicle may not follow its
            # commands.
            self._astray = True
            return True
        if before is not None and point.piece != before.piece:
            self._restart(sample.time)
            before = None
        if before is not None and (
            sample.time <= self._range_at or sample.time < before.motion.time
        ):
            return False
        self._range_at = sample.time
        start = before or point
        change = None if before is None else point.velocity_change_since(before)
        self.filter.observe(*_step(start, point), sample.r, sample.sigma, change)
        self._asked = None
        self._used = point
        self._sigma = sample.sigma
        self._astray = False
        self._remember(sample.time)
        if sample.rate is not None:
            self.observe_rate(sample.rate)
        tracker = self.filter.tracker
        return tracker is None or not tracker.refused

    def observe_rate(self, sample: RateSample) -> None:
        """Add a range rate, unless it is older than the newest sample. The search uses ranges
        only."""
        point = self._path.at(sample.time)
        before = self._used
        if (
            point is None
            or before is None
            or point.piece != before.piece
            or sample.time < before.motion.time
        ):
            return
        V = point.motion.airspeed
        psi = point.motion.heading
        rate = Rate(sample.r_dot, sample.sigma, (V * cos(psi), V * sin(psi)))
        change = point.velocity_change_since(before)
        self.filter.observe(*_step(before, point), None, self._sigma, change, rate)
        self.filter.search()
        self._used = point

    def at(self, time: float) -> RangeEstimate | None:
        # Each step requests the estimate before it sends its setpoint. A search iteration takes
        # some milliseconds and would delay the setpoint. So the search continues at the next range,
        # or when an estimate of a later time is requested.
        if self._asked is not None and time > self._asked:
            self.filter.search()
        self._asked = time if self._asked is None else self._asked
        point = self._path.at(time)
        estimate = self.filter.estimate
        then = self._used
        if point is None or then is None or point.piece != then.piece or estimate is None:
            return None
        own = point.motion
        tracker = self.filter.tracker
        covariance = estimate.covariance
        dt, chord = _step(then, point)
        change = point.velocity_change_since(then)
        at = predict_mixture(estimate, dt, chord, own.heading, own.airspeed, change)
        # Without ranges, the uncertainty of the prediction grows. What has been added since the
        # newest range must stay below the bound of a new estimate.
        added = at.r_variance / at.r**2 + at.direction_variance - estimate.spread**2
        steers = self.ready and added < TRUSTED**2
        relative = RelativeMotion(
            x=at.x,
            y=at.y,
            sigma=sqrt(max(at.r_variance + at.r**2 * at.direction_variance, 0.0))
            if tracker is not None
            else at.r,
            drift_x=at.drift[0],
            drift_y=at.drift[1],
            heading=own.heading,
            turn_rate=own.turn_rate,
            airspeed=at.airspeed,
            scale=float(estimate.mean[KAPPA]),
            trusted=steers,
            trial=estimate.hypothesis,
            drift_remembered=self.filter.acquisition.remembers,
            acceleration_weight=0.0 if change is None else estimate.acceleration_weight,
            drift_covariance=None
            if tracker is None
            else (covariance.item(DX, DX), covariance.item(DX, DY), covariance.item(DY, DY)),
        )
        return RangeEstimate(
            time, at.r, at.r_dot,
            sqrt(max(at.r_variance, 0.0)) if tracker is not None else self._sigma,
            sqrt(max(at.r_dot_variance, 0.0)) if tracker is not None else self._settings.speed,
            eta=relative.eta, relative=relative,
        )  # fmt: skip

    def _restart(self, now: float) -> None:
        """Restart the search. The stored drift is the prior, because wind and target velocity have
        probably changed little."""
        known = None
        # If the estimated drift has changed since the prior was stored, widen the prior to this
        # change. If the vehicle turned out not to follow its commands, its own motion was wrong:
        # ignore the change.
        if self._before is not None:
            time, known = self._before
            sigma = sqrt(known.drift**2 + FORGOTTEN * (now - time))
            if self.filter.tracker is not None and not self._astray:
                dx, dy = drift(self.filter.tracker.estimate.mean)
                sigma = max(sigma, hypot(dx - known.dx, dy - known.dy))
            known = replace(known, drift=sigma)
        self._lately = self._before
        self.filter = RelativeFilter(self._settings, known=known)

    def _remember(self, now: float) -> None:
        """Store drift and airspeed scale every MEMORY seconds, and keep the previously stored
        values."""
        estimate = self.filter.estimate
        if self.ready and estimate and (self._lately is None or now - self._lately[0] > MEMORY):
            dx, dy = drift(estimate.mean).tolist()
            scale = float(estimate.mean[KAPPA])
            settings = self._settings
            known = Prior(REMEMBERED * settings.speed, settings.scale_sigma, dx, dy, scale)
            self._before = self._lately
            self._lately = (now, known)


class AutoEstimator(Estimator):
    """Estimator `auto`. From the first samples on, `kalman` estimates range and range rate. As soon
    as the estimate of `drift` is trusted, `drift` replaces `kalman`."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self.kalman = KalmanRangeRate(settings)
        self.drift = DriftEstimator(settings)

    def reset(self) -> None:
        self.kalman.reset()
        self.drift.reset()

    @property
    def ready(self) -> bool:
        return self.drift.ready or self.kalman.ready

    @property
    def nis(self) -> float | None:
        """Normalized innovation squared of the estimator in use."""
        return self.drift.nis if self.drift.ready else self.kalman.nis

    def restamp(self) -> None:
        """Restart `kalman`, which uses the sensor's clock. The target estimate is kept."""
        self.kalman.restamp()

    def move(self, motion: OwnMotion) -> None:
        self.drift.move(motion)

    def fly_through_air(self, change: MethodChange) -> None:
        self.drift.fly_through_air(change)

    def observe(self, sample: RangeSample) -> bool:
        """Add a sample. It is accepted if `drift` is ready and accepts it. Otherwise `kalman`
        decides, because `drift` rejects correct ranges while its position is wrong."""
        by_drift = self.drift.observe(sample)
        by_range = self.kalman.observe(sample)
        return (by_drift and self.drift.ready) or by_range

    def observe_rate(self, sample: RateSample) -> None:
        self.drift.observe_rate(sample)
        self.kalman.observe_rate(sample)

    def at(self, time: float) -> RangeEstimate | None:
        """Return the estimate predicted to a time (s). It contains the relative motion if `drift`
        has one, even if this is not trusted."""
        by_drift = self.drift.at(time)
        if by_drift is not None and by_drift.relative is not None and by_drift.relative.trusted:
            return by_drift
        by_range = self.kalman.at(time)
        if by_drift is None or by_range is None:
            return by_range
        return by_range._replace(relative=by_drift.relative)


def _step(before: PathPoint, after: PathPoint) -> tuple[float, Vector]:
    """Return time (s) and path (m) from one point to the next."""
    dt = max(after.motion.time - before.motion.time, 0.0)
    return dt, (after.x - before.x, after.y - before.y)
