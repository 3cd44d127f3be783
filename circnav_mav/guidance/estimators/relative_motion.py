"""`drift` and `auto`: the bank of relative-motion filters in flight, fed with ranges and own motion as they come."""

from dataclasses import replace
from math import sqrt

import numpy as np

from circnav_mav.guidance.estimators.acquisition import Prior
from circnav_mav.guidance.estimators.dead_reckoning import Belief, Knot, OwnPath, predict_belief
from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings, Fused
from circnav_mav.guidance.estimators.multiple_model import TRUSTED, DriftBank, Stage
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.estimators.relative_ekf import DX, DY, KAPPA, Felt, Rates, drift
from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RangeSample, RateSample, RelativeMotion

GAP = 20.0
"""After a longer time without ranges, s, the bank starts anew."""
MEMORY = 10.0
"""After such a gap the drift counts that was known so long (s) before it: what came later may be the trouble."""
GROWN = 1.1
"""A prediction may steer while it is at most so many times as uncertain as the estimate at the newest range."""
REMEMBERED, FORGOTTEN = 0.03, 1e-3
"""Standard deviation of that drift, in V, and how its variance grows, m^2/s^3: winds and targets change meanwhile, by
some .8 m/s in a minute, as the search takes it."""


class DriftEstimator(Estimator):
    """Range, heading, turn rate and airspeed in; position relative to the target and drift out.

    Needs own motion that covers the moments of the ranges; without it, it is not ready. Samples that come late, twice
    or out of order are refused. Ready as long as the bank may be trusted.
    """

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        self.bank = DriftBank(self._settings)
        self._path = OwnPath()
        self._used: Knot | None = None
        self._range_at = float("-inf")
        self._sigma = 1.0
        self._astray = False
        self._asked: float | None = None
        """Moment of the first estimate since the newest range, s."""
        self._lately: tuple[float, Prior] | None = None
        self._before: tuple[float, Prior] | None = None

    @property
    def ready(self) -> bool:
        """Whether the bank may be trusted, and has had the newest range."""
        return bool(self.bank.trusted[0]) and not self._astray

    @property
    def nis(self) -> float | None:
        """Normalised innovation squared of the newest sample; None while searching."""
        return None if np.isnan(self.bank.nis[0]) else float(self.bank.nis[0])

    def move(self, motion: OwnMotion) -> None:
        self._path.move(motion)

    def observe(self, sample: RangeSample) -> Fused:
        knot, before = self._path.at(sample.time), self._used
        if knot is None:
            self._astray = True  # ranges, but nobody knows how the vehicle flies: it does not do as it is told
            return Fused.ACCEPTED
        if before is not None and (knot.piece != before.piece or sample.time - before.motion.time > GAP):
            self._restart(sample.time)
            before = None
        if before is not None and (sample.time <= self._range_at or sample.time < before.motion.time):
            return Fused.GATED
        self._range_at = sample.time
        ranges = np.array([sample.r]), np.array([sample.sigma]), np.array([True])
        self.bank.observe(*_step(before or knot, knot), *ranges, _felt(before, knot))
        self._asked = None
        self._used, self._sigma, self._astray = knot, sample.sigma, False
        self._remember(sample.time)
        if sample.rate is not None:
            self.observe_rate(sample.rate)
        return Fused.GATED if self.bank.refused[0] else Fused.ACCEPTED

    def observe_rate(self, sample: RateSample) -> None:
        """Take in a range rate, unless it is older than the newest sample. A search goes by ranges alone."""
        knot, before = self._path.at(sample.time), self._used
        if knot is None or before is None or knot.piece != before.piece or sample.time < before.motion.time:
            return
        nothing, V, psi = np.zeros(1), knot.motion.airspeed, knot.motion.heading
        air = V * np.array([[np.cos(psi)], [np.sin(psi)]])
        rates = Rates(np.array([sample.r_dot]), np.array([sample.sigma]), np.array([True]), air)
        ranges = nothing, nothing + self._sigma, nothing > 0
        self.bank.step(*_step(before, knot), *ranges, _felt(before, knot), rates)
        self._used = knot

    def at(self, time: float) -> RangeEstimate | None:
        # One step of the flight asks for the estimate before its setpoint. A search takes some milliseconds, so it goes
        # on with the next range, or when an estimate of a later moment is asked for.
        if self._asked is not None and time > self._asked:
            self.bank.search()
        self._asked = time if self._asked is None else self._asked
        knot = self._path.at(time)
        if knot is None or self._used is None or knot.piece != self._used.piece or self.bank.stage[0] == Stage.EMPTY:
            return None
        then, own, tracks = self._used, knot.motion, self.bank.stage[0] == Stage.TRACK
        mean, covariance = tuple(self.bank.mean[:, 0].tolist()), self.bank.covariance[:, :, 0]
        belief = Belief(mean, covariance, *self.bank.assumed[:, 0].tolist())
        dt, chord = max(own.time - then.motion.time, 0.0), (knot.x - then.x, knot.y - then.y)
        felt = knot.felt_since(then)
        at = predict_belief(belief, dt, chord, heading=own.heading, airspeed=own.airspeed, felt=felt)
        # without ranges a prediction gets worse
        bound = max(TRUSTED, GROWN * float(self.bank.spread[0]))
        steers = self.ready and at.r_variance / at.r**2 + at.direction_variance < bound**2
        relative = RelativeMotion(
            x=at.x,
            y=at.y,
            sigma=sqrt(max(at.r_variance + at.r**2 * at.direction_variance, 0.0)) if tracks else at.r,
            drift_x=at.drift[0],
            drift_y=at.drift[1],
            heading=own.heading,
            turn_rate=own.turn_rate,
            airspeed=at.airspeed,
            scale=belief.mean[KAPPA],
            trusted=steers,
            trial=None if tracks else int(self.bank.favourite[0]),
            drift_remembered=self.bank.remembers,
            feels=belief.feels if tracks and felt is not None else 0.0,
            drift_covariance=(covariance.item(DX, DX), covariance.item(DX, DY), covariance.item(DY, DY)),
        )
        return RangeEstimate(
            time, at.r, at.r_dot,
            sqrt(max(at.r_variance, 0.0)) if tracks else self._sigma,
            sqrt(max(at.r_dot_variance, 0.0)) if tracks else self._settings.speed,
            eta=relative.eta, relative=relative, missed=float(self.bank.missed[0]),
        )  # fmt: skip

    def _restart(self, now: float) -> None:
        """Search anew. The wind, and the way of the target, are likely still what they were; as far as the bank has not
        seen them change since. What it saw of a vehicle that soon proved not to do as it was told, is nothing."""
        known = None
        if self._before is not None:
            time, known = self._before
            sigma = sqrt(known.drift**2 + FORGOTTEN * (now - time))
            if self.bank.stage[0] == Stage.TRACK and not self._astray:
                dx, dy = drift(self.bank.mean[:, 0])
                sigma = max(sigma, float(np.hypot(dx - known.dx, dy - known.dy)))
            known = replace(known, drift=sigma)
        self._lately = self._before
        self.bank = DriftBank(self._settings, known=known)

    def _remember(self, now: float) -> None:
        """Keep what is known of the drift now and then, and what was known before that."""
        if self.ready and (self._lately is None or now - self._lately[0] > MEMORY):
            (dx, dy), scale = drift(self.bank.mean[:, 0]), float(self.bank.mean[KAPPA, 0])
            known = Prior(REMEMBERED * self._settings.speed, dx=float(dx), dy=float(dy), scale=scale)
            self._before, self._lately = self._lately, (now, known)


class AutoEstimator(Estimator):
    """`auto`: range and range rate by `kalman` from the first samples on, everything by `drift` once it is trusted."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self.kalman, self.drift = KalmanRangeRate(settings), DriftEstimator(settings)

    def reset(self) -> None:
        self.kalman.reset()
        self.drift.reset()

    @property
    def ready(self) -> bool:
        return self.drift.ready or self.kalman.ready

    @property
    def nis(self) -> float | None:
        """Of the one that is believed."""
        return self.drift.nis if self.drift.ready else self.kalman.nis

    def restamp(self) -> None:
        """Only `kalman` goes by the sensor's clock; where the target is, stays known."""
        self.kalman.restamp()

    def move(self, motion: OwnMotion) -> None:
        self.drift.move(motion)

    def observe(self, sample: RangeSample) -> Fused:
        """Take one sample in; refused is what fits neither, for a bank that has lost its place refuses the truth."""
        by_drift, by_range = self.drift.observe(sample), self.kalman.observe(sample)
        return by_range if by_drift is Fused.GATED or not self.drift.ready else by_drift

    def observe_rate(self, sample: RateSample) -> None:
        self.drift.observe_rate(sample)
        self.kalman.observe_rate(sample)

    def at(self, time: float) -> RangeEstimate | None:
        """The estimate predicted to a moment; with the relative motion, trusted or on trial, wherever there is one."""
        by_drift = self.drift.at(time)
        if by_drift is not None and by_drift.relative is not None and by_drift.relative.trusted:
            return by_drift
        by_range = self.kalman.at(time)
        if by_drift is None or by_range is None:
            return by_range
        return RangeEstimate(
            time, by_range.r, by_range.r_dot, by_range.r_sigma, by_range.r_dot_sigma,
            relative=by_drift.relative, missed=by_drift.missed,
        )  # fmt: skip


def _step(before: Knot, after: Knot) -> tuple[Array, Array]:
    """Time and path from one knot to the next."""
    dt = max(after.motion.time - before.motion.time, 0.0)
    return np.array([dt]), np.array([[after.x - before.x], [after.y - before.y]])


def _felt(before: Knot | None, after: Knot) -> Felt | None:
    """What was felt meanwhile, of one flight of a bank."""
    felt = None if before is None else after.felt_since(before)
    return None if felt is None else Felt(*(np.array(part)[..., None] for part in felt))
