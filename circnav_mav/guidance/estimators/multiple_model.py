"""Multiple-model filter of the relative motion: acquisition, then tracking with several noise
models.

SEARCH: hypotheses in all directions at the newest range, fitted to a window of the last seconds.
When only one hypothesis explains the ranges, the filter changes to TRACKING.

TRACKING: one Kalman filter per noise model (drift from steady to gusty, range error from white to
drifting), weighted by its likelihood. A model of negligible weight restarts from the mixture of its
kind. There are two kinds: models that use accelerations, and models that do not. If most samples
are outside the gate, the filter searches again at once, with the existing window.
"""

from enum import IntEnum
from math import hypot, inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.estimators import relative_ekf as ekf
from circnav_mav.guidance.estimators.acquisition import DRIFT_MOST, Acquisition, Prior, Solution
from circnav_mav.guidance.estimators.interface import EstimatorSettings, MethodChange
from circnav_mav.guidance.estimators.relative_ekf import (
    KAPPA,
    STATES,
    THETA,
    Array,
    Hypotheses,
    Noise,
    R,
    VelocityChange,
)
from circnav_mav.guidance.maths import Vector


class Stage(IntEnum):
    """Stage of the estimate. EMPTY: no range since the start, or since a track was lost."""

    EMPTY = 0
    SEARCH = 1
    TRACKING = 2


TRUSTED = 0.25
"""Standard deviation of the position, as a share of the range, below which an estimate begins to
steer."""
KEPT = 0.5
"""Standard deviation of the position, as a share of the range, above which a steering estimate
stops steering."""
LOST = 0.6
"""Standard deviation of the position, as a share of the range, above which the estimate is
discarded and the filter searches again."""
MISSED = 0.6
"""Share of recent samples outside the gate above which the filter searches again."""
RECENT = 3.0
"""Time constant of the share of recent samples outside the gate, s."""
MODELS = (
    (1e-7, 0, 0, 0, 1, 0),  # steady drift
    (1e-7, 0, 0, 0, 0.4, 0.9),
    (3e-4, 0, 0, 0, 1, 0),  # changes slowly
    (3e-4, 0, 0, 0, 0.4, 0.9),
    (5e-2, 0, 0, 0, 1, 0),  # changes quickly
    (1e-2, 0.1, 0, 0, 1, 0),  # gusts
    (1e-7, 0.08, 0, 0, 1, 0),  # gusts in a steady wind
    (1e-7, 0.02, 0, 0, 1, 0),  # weak gusts, or a heading that is wrong by 1 deg for seconds
    (3e-4, 0.2, 0.03, 1, 1, 0),  # gusts and a veering wind, measured by the accelerometers
)
"""Noise models. Columns: drift_psd (m^2/s^3), gust (as a share of V), nose (as a share of V),
acceleration_weight, white, drifting, as in `Noise`. Only models with a steady or slowly changing
drift have a drifting range error: with other drifts it cannot be observed."""
LEAST_SIGMA = 1e-3
"""Lower bound of the standard deviation of a range, m; a smaller value is raised to it. With a
smaller value, rounding errors spoil a covariance. The motion between samples has a larger error
anyway."""
MOST_SIGMA = 1e3
"""Upper bound of the standard deviation of a range, m; a larger value is lowered to it. With a
larger value, rounding errors spoil a covariance. Such a range contains no information anyway."""
FORGOTTEN = -12.0
"""Log weight below which a model restarts from the mixture. The heaviest model has 0."""
REVIVED = -6.0
"""Log weight of a model after its restart."""


class Rate(NamedTuple):
    """Measured range rate.

    r_dot: range rate, m/s.
    sigma: standard deviation of r_dot, m/s.
    air: velocity through the air V u(psi) at the same time, with the measured airspeed V, m/s.
    """

    r_dot: float
    sigma: float
    air: Vector


class MultipleModelFilter:
    """Multiple-model filter. Input: `step`, or `observe` and `search`.

    mean (12,), covariance (12, 12): the estimate.
    stage: stage of the estimate.
    nis: normalized innovation squared of the most likely noise model; None before the first update.
    missed: share of recent samples outside the gate.
    refused: True if the last sample was rejected.
    spread: standard deviation of the position as a share of the range; infinite before the target
        is located.
    trusted: True if the estimate may steer.
    assumed: weighted average of the models' drift_psd, gust and acceleration_weight, (3,);
        unweighted during a search.
    """

    def __init__(self, settings: EstimatorSettings, known: Prior | None = None) -> None:
        """known: prior of drift and airspeed scale. It is discarded when a track is lost."""
        self._settings = settings
        models = np.array(MODELS)
        models[:, 1:3] *= settings.speed
        psd, gust, nose, acceleration_weight, white, drifting = models.T
        bounds = settings.scale_bounds
        bias = settings.acceleration_bias
        self.noise = Noise(psd, gust, white, drifting, nose, acceleration_weight, bounds, bias)
        self._assumptions = np.array((psd, gust, acceleration_weight))
        self.stage = Stage.EMPTY
        self.mean = np.zeros(STATES)
        self.covariance = np.zeros((STATES, STATES))
        self.assumed = self._assumptions.mean(axis=1)
        self.nis: float | None = None
        self.missed = 0.0
        self.refused = False
        self.spread = inf
        self.trusted = False
        self._since = 0.0
        """Time since the newest range, s."""
        self._due: float | None = None
        """Standard deviation of the ranges, m, if an iteration of the search is due."""
        self._search = Acquisition(settings, known)
        self._tracks = _copies(self.mean, self.covariance)
        """Hypotheses of the models. Valid in TRACKING."""

    @property
    def most_likely(self) -> int | None:
        """Number of the most likely hypothesis of a search, or None without a search."""
        return self._search.most_likely

    @property
    def remembers(self) -> bool:
        """True if the search for the target begins with a drift that was estimated before."""
        return self._search.remembers

    def tracked_from(self, before: "MultipleModelFilter", change: MethodChange) -> None:
        """Continue the track of another filter with own motion through the air. The other filter
        used own motion over the ground."""
        mean = before.mean.copy()
        covariance = before.covariance.copy()
        mean[ekf.DX] += change.wind[0]
        mean[ekf.DY] += change.wind[1]
        mean[KAPPA] = change.scale
        covariance[ekf.DX, ekf.DX] += change.wind_sigma**2
        covariance[ekf.DY, ekf.DY] += change.wind_sigma**2
        bias = change.settings.acceleration_bias
        for state, sigma in (
            (KAPPA, change.scale_sigma),
            (ekf.FORWARD, bias),
            (ekf.LEFT, bias),
        ):
            covariance[state] = 0.0
            covariance[:, state] = 0.0
            covariance[state, state] = sigma**2
        self.trusted = before.trusted
        self._begin_track(mean, covariance)

    def step(
        self,
        dt: float,
        chord: Vector,
        z: float | None,
        sigma: float,
        acceleration: VelocityChange | None = None,
        rate: Rate | None = None,
    ) -> None:
        """Run `observe`, then `search`."""
        self.observe(dt, chord, z, sigma, acceleration, rate)
        self.search()

    def observe(
        self,
        dt: float,
        chord: Vector,
        z: float | None,
        sigma: float,
        acceleration: VelocityChange | None = None,
        rate: Rate | None = None,
    ) -> None:
        """Predict by dt (s) along a chord (m), and add the range z (m) unless it is None. sigma:
        standard deviation of ranges, m.

        acceleration: measured during dt.
        rate: range rate measured at the end of dt.
        """
        self.search()
        sigma = min(max(sigma, LEAST_SIGMA), MOST_SIGMA)
        self._since += dt
        if self.stage == Stage.TRACKING:
            self._track(dt, chord, z, sigma, acceleration, rate)
            self._lose()
        due = self._search.observe(dt, chord, z, sigma)
        if z is not None:
            self._since = 0.0
            if self.stage == Stage.EMPTY:
                self.stage = Stage.SEARCH
                self._search.begin(z)
        if self.stage == Stage.SEARCH:
            self._due = sigma if due else None
            self._update_most_likely()  # during a search, the most likely hypothesis steers

    def search(self) -> None:
        """Run an iteration of the search if one is due. The next estimate uses the result."""
        if self._due is None:
            return
        sigma = self._due
        self._due = None
        solution = self._search.iterate(sigma)
        if solution is None:
            self._update_most_likely()
        else:
            self._start(solution, sigma)

    def _track(
        self,
        dt: float,
        chord: Vector,
        z: float | None,
        sigma: float,
        acceleration: VelocityChange | None,
        rate: Rate | None,
    ) -> None:
        h = self._tracks
        gate = self._settings.gate
        if dt > 0:  # 0 for a rate measured at the same time as its range
            h = ekf.predict(h, self.noise, dt, chord, sigma, acceleration)
        if z is not None:
            measured = ekf.range_measurement(h, self.noise, z, sigma)
            h, nis, accepted = ekf.update(h, self.noise, measured, gate)
            heaviest = h.log_weight.argmax()
            self._count(float(nis[heaviest]), bool(accepted[heaviest]))
        if rate is not None:
            h, _, _ = ekf.update(h, self.noise, ekf.rate_measurement(h, *rate), gate)
        mean, covariance = ekf.mixture(h)
        self._tracks = _revive(h, self.noise.acceleration_weight > 0, mean, covariance)
        self._store(mean, covariance)

    def _store(self, mean: Array, covariance: Array) -> None:
        """Store the mixture of the tracks."""
        self.mean = mean
        self.covariance = covariance
        variance = covariance[R, R] / max(mean[R], 1.0) ** 2 + covariance[THETA, THETA]
        self.spread = sqrt(max(variance, 0.0))
        # Hysteresis: an estimate that steers is used until it is much worse. Even then it holds the
        # circle better than a range-only law. A single bound would switch the law whenever the
        # spread fluctuates around this bound.
        self.trusted = self.spread < (KEPT if self.trusted else TRUSTED)
        self.assumed = self._assumptions @ self._tracks.weight

    def _count(self, nis: float, accepted: bool) -> None:
        """Update the share of recent samples that were rejected."""
        self.nis = nis
        self.refused = not accepted
        weight = min(self._since / RECENT, 0.2)
        self.missed += (self.refused - self.missed) * weight

    def _lose(self) -> None:
        """Discard the track, so that the filter searches again, if the track is inconsistent."""
        drift = hypot(*ekf.drift(self.mean))
        sound = bool(np.isfinite(self.mean).all() and np.isfinite(self.covariance).all())
        if (
            sound
            and self.missed <= MISSED
            and self.spread <= LOST
            and drift <= DRIFT_MOST * self._settings.speed
        ):
            return
        self.stage = Stage.EMPTY
        self.spread = inf
        self.trusted = False
        self.refused = False
        self.assumed = self._assumptions.mean(axis=1)
        if not sound:
            self.mean = np.zeros(STATES)
            self.covariance = np.zeros((STATES, STATES))
        self._search.forget()

    def _update_most_likely(self) -> None:
        """Copy the most likely hypothesis of the search to the mean."""
        x = self._search.most_likely_state()
        self.mean[R] = hypot(x[0], x[1])
        self.mean[THETA] = np.arctan2(x[1], x[0])
        self.mean[ekf.DX : ekf.B] = x[ekf.DX :]
        self.mean[ekf.B :] = 0.0

    def _start(self, solution: Solution, sigma: float) -> None:
        """Start tracking from the solution of a search."""
        known = slice(0, ekf.B)
        mean = np.zeros(STATES)
        mean[known] = solution.x
        sigmas = np.zeros(STATES)
        sigmas[ekf.B] = 0.5 * sigma
        sigmas[[ekf.GX, ekf.GY]] = 0.02 * self._settings.speed
        sigmas[[ekf.FORWARD, ekf.LEFT]] = self._settings.acceleration_bias
        covariance = np.diag(sigmas**2)
        covariance[known, known] = solution.P
        self._begin_track(*ekf.polar(mean, covariance))
        self.missed = 0.0

    def _begin_track(self, mean: Array, covariance: Array) -> None:
        """Track with all models, starting from the same estimate."""
        self.stage = Stage.TRACKING
        self._tracks = _copies(mean, covariance)
        self._store(mean, covariance)


def _copies(mean: Array, covariance: Array) -> Hypotheses:
    """Return hypotheses with the same estimate for every model, equally likely."""
    x = np.repeat(mean[:, None], len(MODELS), axis=1)
    P = np.repeat(covariance[:, :, None], len(MODELS), axis=2)
    return Hypotheses(x, P, np.zeros(len(MODELS)))


def _revive(
    h: Hypotheses, uses_accelerations: NDArray[np.bool_], mean: Array, covariance: Array
) -> Hypotheses:
    """Return the hypotheses with the models of negligible weight restarted.

    uses_accelerations: for each model, (M,).
    mean (12,), covariance (12, 12): mixture of all models.

    Each model restarts from the mixture of its own kind. If no model of this kind is left, the
    model restarts from the mixture of all models.

    Models that use accelerations can mistake a wrong airspeed for a gust that turns with the
    heading. The other models reveal this error only if they do not restart from an estimate with
    this error.
    """
    forgotten = h.log_weight < FORGOTTEN
    if not forgotten.any():
        return h
    x = h.x.copy()
    P = h.P.copy()
    for kind in (uses_accelerations, ~uses_accelerations):
        restarts = forgotten & kind
        if restarts.any():
            start, spread = mean, covariance
            if h.log_weight[kind].max() >= FORGOTTEN:
                start, spread = ekf.mixture(
                    Hypotheses(h.x[:, kind], h.P[:, :, kind], h.log_weight[kind])
                )
            x[:, restarts] = start[:, None]
            P[:, :, restarts] = spread[:, :, None]
    return Hypotheses(x, P, np.where(forgotten, REVIVED, h.log_weight))
