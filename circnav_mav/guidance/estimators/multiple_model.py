"""Multiple-model filter of the relative motion: acquisition, then tracking with several noise
models.

SEARCH: hypotheses in all directions at the newest range, fitted to a window of the last seconds.
When exactly one of them explains the ranges, the flight changes to TRACKING.

TRACKING: one Kalman filter per noise model (drift from steady to gusty, range error from white to
drifting), weighted by its likelihood. A model of negligible weight restarts from the mixture of its
kind: the models that use accelerations, or those that do not. If the samples keep falling outside
the gate, the flight searches again at once, with the existing window.

Every array has a last axis B over flights. In a real flight B = 1.
"""

from enum import IntEnum
from typing import Any

import numpy as np

from circnav_mav.guidance.estimators import relative_ekf as ekf
from circnav_mav.guidance.estimators.acquisition import DRIFT_MOST, Acquisition, Prior
from circnav_mav.guidance.estimators.interface import EstimatorSettings, MethodChange
from circnav_mav.guidance.estimators.relative_ekf import (
    KAPPA,
    STATES,
    THETA,
    Hypotheses,
    Noise,
    R,
    Rates,
    VelocityChange,
)
from circnav_mav.guidance.maths import Batch


class Stage(IntEnum):
    """Stage of a flight's estimate."""

    EMPTY = 0
    SEARCH = 1
    TRACKING = 2


TRUSTED = 0.25
KEPT = 0.5
LOST = 0.6
"""Bounds of the position's standard deviation, as a share of the range: an estimate may steer below
TRUSTED, and until it exceeds KEPT. Above LOST it is discarded."""
MISSED = 0.6
RECENT = 3.0
"""Share of recent samples outside the gate above which the flight searches again, and time constant
of this share, s."""
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
"""Noise models: drift_psd (m^2/s^3), gust (as a share of V), nose (as a share of V),
acceleration_weight, white, drifting, as in `Noise`. A drifting range error can be observed only
while the drift is steady or changes slowly."""
LEAST_SIGMA = 1e-3
MOST_SIGMA = 1e3
"""Bounds of the standard deviation of a range, m. A lower value would be below the error of the
motion between samples; a range with a higher one carries no information. Beyond these bounds,
rounding errors spoil a covariance."""
FORGOTTEN = -12.0
REVIVED = -6.0
"""Log weight below which a model restarts from the mixture, and its log weight afterwards."""


class MultipleModelFilter:
    """Multiple-model filters of B flights that are stepped together. Input: `step`, or `observe`
    and `search`.

    mean (12, B), covariance (12, 12, B): the estimate. Arrays (B,): stage: of acquisition; nis:
    normalized innovation squared of the most likely hypothesis; missed: share of recent samples
    outside the gate; refused: True if the last sample was rejected; spread: standard deviation of
    the position as a share of the range (infinite before the target is located); trusted: True if
    the estimate may steer. assumed (3, B): weighted average of the models' drift_psd, gust and
    acceleration_weight (unweighted during a search).
    """

    def __init__(
        self, settings: EstimatorSettings, flights: int = 1, known: Prior | None = None
    ) -> None:
        """known: prior of drift and airspeed scale. It is discarded when a track is lost."""
        self._settings = settings
        models = np.array(MODELS)
        models[:, 1:3] *= settings.speed
        psd, gust, nose, acceleration_weight, white, drifting = models.T[..., None]
        bounds = settings.scale_bounds
        bias = settings.acceleration_bias
        self.noise = Noise(psd, gust, white, drifting, nose, acceleration_weight, bounds, bias)
        self._uses_accelerations = self.noise.acceleration_weight[:, 0] > 0
        self._assumptions = np.hstack(
            [self.noise.drift_psd, self.noise.gust, self.noise.acceleration_weight]
        ).T
        self.stage = np.full(flights, Stage.EMPTY)
        self.mean = np.zeros((STATES, flights))
        self.covariance = np.zeros((STATES, STATES, flights))
        self.nis = np.full(flights, np.nan)
        self.missed = np.zeros(flights)
        self.refused = np.zeros(flights, bool)
        self.spread = np.full(flights, np.inf)
        self.trusted = np.zeros(flights, bool)
        self._since = np.zeros(flights)
        self._due: tuple[Batch, Batch] | None = None
        """True for flights whose search is due, (B,), and standard deviations of their ranges (B,),
        m."""
        self._search = Acquisition(settings, flights, known)
        self._tracking = np.zeros(0, int)
        self._tracks = _copies(self.mean[:, :0], self.covariance[..., :0])
        self._assume()

    @property
    def most_likely(self) -> Batch:
        """Number of the most likely hypothesis of a search, (B,), or -1 without a search."""
        number = np.full(self.stage.size, -1)
        number[self._search.at] = self._search.most_likely
        return number

    @property
    def remembers(self) -> bool:
        """True if the search has a prior of the drift."""
        return self._search.remembers

    def tracked_from(self, before: "MultipleModelFilter", change: MethodChange) -> None:
        """Continue the tracks of another filter, whose own motion was over the ground, with motion
        through the air."""
        mean, covariance = before.mean.copy(), before.covariance.copy()
        mean[ekf.DX] += change.wind[0]
        mean[ekf.DY] += change.wind[1]
        mean[KAPPA] = change.scale
        covariance[KAPPA] = covariance[:, KAPPA] = 0.0
        covariance[KAPPA, KAPPA] = change.scale_sigma**2
        covariance[ekf.DX, ekf.DX] += change.wind_sigma**2
        covariance[ekf.DY, ekf.DY] += change.wind_sigma**2
        for error in (ekf.FORWARD, ekf.LEFT):
            covariance[error] = covariance[:, error] = 0.0
            covariance[error, error] = change.settings.acceleration_bias**2
        at = np.flatnonzero(before.stage == Stage.TRACKING)
        self.trusted[at] = before.trusted[at]
        self._tracks = _copies(mean[:, at], covariance[..., at])
        self._tracking = at
        self._store(at, mean[:, at], covariance[..., at])
        self._assume()
        self.stage[at] = Stage.TRACKING

    def step(self, *received: Any) -> None:
        """Run `observe`, then `search`."""
        self.observe(*received)
        self.search()

    def observe(
        self,
        dt: Batch,
        chord: Batch,
        z: Batch,
        sigma: Batch,
        valid: Batch,
        felt: VelocityChange | None = None,
        rates: Rates | None = None,
    ) -> None:
        """Predict by dt (B,), s, along chord (2, B), m, and add the ranges z, sigma (B,), m, where
        valid (B,).

        Flights with dt and chord 0 and no valid range are unchanged. felt: accelerations measured
        during dt. rates: range rates measured at its end.
        """
        self.search()
        sigma = np.minimum(np.maximum(sigma, LEAST_SIGMA), MOST_SIGMA)
        self._since += dt
        self._track(dt, chord, z, sigma, valid, felt, rates)
        self._lose()
        self._since[valid] = 0.0
        due = self._search.observe(dt, chord, z, sigma, valid)
        begin = np.flatnonzero(valid & (self.stage == Stage.EMPTY))
        if begin.size:
            self.stage[begin] = Stage.SEARCH
            self._search.begin(begin, z[begin])
        if self._search.at.size:
            self._due = due, sigma
            self._update_most_likely()  # during a search, the most likely hypothesis steers

    def search(self) -> None:
        """Continue the searches. Results are used from the next estimate on."""
        if self._due is None:
            return
        (due, sigma), self._due = self._due, None
        found = self._search.go_on(due, sigma) if due.any() else None
        if found is not None:
            self._start(*found, sigma)
        self._update_most_likely()

    def _track(
        self,
        dt: Batch,
        chord: Batch,
        z: Batch,
        sigma: Batch,
        valid: Batch,
        felt: VelocityChange | None,
        rates: Rates | None,
    ) -> None:
        at = self._tracking
        if not at.size:
            return
        h = self._tracks
        of: Any = slice(None)
        if self.stage.size > 1:
            dt, chord, z, sigma, valid = (part[..., at] for part in (dt, chord, z, sigma, valid))
            felt = felt and felt.of(at)
            rates = rates and rates.of(at)
            of = at
        if dt.any():  # 0 for a rate measured at the same time as its range
            h = ekf.predict(h, self.noise, dt, chord, sigma, felt)
        if valid.any():
            h, nis, taken = ekf.update(h, self.noise, z, sigma, valid, self._settings.gate)
            heaviest = (h.log_weight.argmax(axis=0), np.arange(at.size))
            self._count(of, nis[heaviest], taken[heaviest], valid)
        if rates is not None and rates.valid.any():
            h = ekf.update_rate(h, self.noise, rates, self._settings.gate)
        mean, covariance = ekf.mixture(h)
        self._store(of, mean, covariance)
        self._tracks = _revive(h, self._uses_accelerations, mean, covariance)
        self._assume()

    def _store(self, at: Any, mean: Batch, covariance: Batch) -> None:
        self.mean[:, at], self.covariance[:, :, at] = mean, covariance
        variance = covariance[R, R] / np.maximum(mean[R], 1.0) ** 2 + covariance[THETA, THETA]
        self.spread[at] = np.sqrt(np.maximum(variance, 0.0))
        # Hysteresis: an estimate that steers is used until it is much worse. A law on range alone
        # holds the circle worse still, and a single bound would switch the law whenever the spread
        # fluctuates around it.
        bound = np.where(self.trusted[at], KEPT, TRUSTED)
        self.trusted[at] = self.spread[at] < bound

    def _count(self, at: Any, nis: Batch, taken: Batch, valid: Batch) -> None:
        """Update the share of recent samples that were rejected."""
        missed = self.missed[at]
        weight = valid * np.minimum(self._since[at] / RECENT, 0.2)
        self.refused[at] = valid & ~taken
        self.missed[at] = missed + (~taken - missed) * weight
        self.nis[at] = np.where(valid, nis, self.nis[at])

    def _assume(self) -> None:
        weight = np.full(
            (self._assumptions.shape[1], self.stage.size), 1 / self._assumptions.shape[1]
        )
        weight[:, self._tracking] = self._tracks.weight
        self.assumed = self._assumptions @ weight

    def _lose(self) -> None:
        """Move flights with an inconsistent track back to the search."""
        if not self._tracking.size:
            return
        drift = np.hypot(*ekf.drift(self.mean))
        astray = (
            (self.missed > MISSED)
            | (self.spread > LOST)
            | (drift > DRIFT_MOST * self._settings.speed)
        )
        sound = np.isfinite(self.mean.sum(axis=0) + self.covariance.sum(axis=(0, 1)))
        lost = (self.stage == Stage.TRACKING) & (astray | ~sound)
        if not lost.any():
            return
        stay = ~lost[self._tracking]
        self._tracks = Hypotheses(*(part[..., stay] for part in self._tracks))
        self._tracking = self._tracking[stay]
        self.stage[lost], self.spread[lost] = Stage.EMPTY, np.inf
        self.trusted[lost] = self.refused[lost] = False
        self.mean[:, ~sound] = 0.0
        self.covariance[:, :, ~sound] = 0.0
        self._assume()
        self._search.forget()

    def _update_most_likely(self) -> None:
        """Copy the most likely hypothesis of each search to the mean."""
        at = self._search.at
        if at.size:
            x = self._search.most_likely_states()
            self.mean[R, at], self.mean[THETA, at] = np.hypot(x[0], x[1]), np.arctan2(x[1], x[0])
            self.mean[ekf.DX : ekf.B, at] = x[ekf.DX :]
            self.mean[ekf.B :, at] = 0.0

    def _start(self, at: Batch, x: Batch, P: Batch, sigma: Batch) -> None:
        """Start tracking the flights `at` from their solutions x (5, n) with covariances P (5, 5,
        n)."""
        known = slice(0, ekf.B)
        mean, covariance = np.zeros((STATES, at.size)), np.zeros((STATES, STATES, at.size))
        mean[known], covariance[known, known] = x, P
        covariance[ekf.B, ekf.B] = (0.5 * sigma[at]) ** 2
        covariance[ekf.GX, ekf.GX] = covariance[ekf.GY, ekf.GY] = (0.02 * self._settings.speed) ** 2
        covariance[ekf.FORWARD, ekf.FORWARD] = covariance[ekf.LEFT, ekf.LEFT] = (
            self._settings.acceleration_bias**2
        )
        mean, covariance = ekf.polar(mean, covariance)
        both = zip(self._tracks, _copies(mean, covariance), strict=True)
        self._tracks = Hypotheses(*(np.concatenate(parts, axis=-1) for parts in both))
        self._tracking = np.concatenate([self._tracking, at])
        self._store(at, mean, covariance)
        self._assume()
        self.stage[at] = Stage.TRACKING
        self.missed[at] = 0.0


def _copies(mean: Batch, covariance: Batch) -> Hypotheses:
    """Return hypotheses with the same estimate for every model, equally likely."""
    x = np.repeat(mean[:, None], len(MODELS), axis=1)
    P = np.repeat(covariance[:, :, None], len(MODELS), axis=2)
    return Hypotheses(x, P, np.zeros((len(MODELS), mean.shape[-1])))


def _revive(h: Hypotheses, uses_accelerations: Batch, mean: Batch, covariance: Batch) -> Hypotheses:
    """Return the hypotheses with the models of negligible weight restarted.

    uses_accelerations (M,): by model. Each model restarts from the mixture of its own kind. If no
    model of this kind is left, it restarts from the mixture of all, mean (12, B) and covariance
    (12, 12, B).

    Models that use accelerations can mistake a wrong airspeed for a gust that turns with the
    heading. The other models reveal this error only if they do not restart from it.
    """
    dead: Batch = h.log_weight < FORGOTTEN
    if not dead.any():
        return h
    x = h.x
    P = h.P
    for kind in (uses_accelerations, ~uses_accelerations):
        again = dead & kind[:, None]
        if again.any():
            best = h.log_weight[kind].max(axis=0)
            theirs, spread = ekf.mixture(
                Hypotheses(h.x[:, kind], h.P[:, :, kind], h.log_weight[kind] - best)
            )
            left: Batch = best >= FORGOTTEN
            start: Batch = np.where(left, theirs, mean)
            of_start: Batch = np.where(left, spread, covariance)
            x = np.where(again, start[:, None], x)
            P = np.where(again, of_start[:, :, None], P)
    return Hypotheses(x, P, np.where(dead, REVIVED, h.log_weight))
