"""The bank of relative-motion filters: search round the ring, track with several noise models, search again when lost.

SEARCH: hypotheses in all directions of the newest range, fitted to a window of the last seconds. When one explains
them and no other does, the flight is in TRACK: one Kalman filter per noise model (drift steady .. gusty, range error
white .. drifting); the evidence decides which model counts, and a model that lost is started again from the mixture
of its kind. A flight whose samples keep falling outside the gate searches again, at once and with the window that
it has.

Every array has a last axis B over flights; in the air B = 1.
"""

from enum import IntEnum
from typing import Any

import numpy as np

from circnav_mav.guidance.estimators import relative_ekf as ekf
from circnav_mav.guidance.estimators.acquisition import DRIFT_MOST, Prior, RingSearch
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_ekf import STATES, THETA, Felt, Hypotheses, Noise, R, Rates
from circnav_mav.guidance.maths import Batch


class Stage(IntEnum):
    """Where a flight's bank stands."""

    EMPTY = 0
    SEARCH = 1
    TRACK = 2


TRUSTED, KEPT, LOST = 0.25, 0.5, 0.6
"""Bounds of the position's standard deviation over the range: an estimate steers from the first up to the second, and
is given up at the third."""
MISSED, RECENT = 0.6, 3.0
"""Share of recent samples outside the gate that ends the track; memory of it, s."""
MODELS = (
    (1e-7, 0, 0, 0, 1, 0),  # the drift stands still
    (1e-7, 0, 0, 0, 0.4, 0.9),
    (3e-4, 0, 0, 0, 1, 0),  # changes slowly
    (3e-4, 0, 0, 0, 0.4, 0.9),
    (5e-2, 0, 0, 0, 1, 0),  # changes quickly
    (1e-2, 0.1, 0, 0, 1, 0),  # gusts
    (1e-7, 0.08, 0, 0, 1, 0),  # gusts in a wind that stands still
    (1e-7, 0.02, 0, 0, 1, 0),  # small ones, or an autopilot whose heading is a degree off for seconds
    (3e-4, 0.2, 0.03, 1, 1, 0),  # gusts, and a wind that turns, that accelerations tell
)
"""m^2/s^3 of d, gust in V, noise of the nose in V, whether accelerations count, white and drifting part of sigma. A
drifting range error shows only where the drift stands still or changes slowly."""
LEAST_SIGMA, MOST_SIGMA = 1e-3, 1e3
"""What the standard deviation of a range counts as at least and at most, m: none is known better than the motion in
between, worse ones tell nothing, and variances that are farther apart cancel to nothing in a covariance."""
FORGOTTEN, REVIVED = -12.0, -6.0
"""A model whose log weight falls below the first starts again from the mixture with the second."""


class DriftBank:
    """The banks of B flights that are stepped together. `step` is the only way in, or its two parts; the attributes
    are what is believed.

    mean (12, B), covariance (12, 12, B), stage, nis, missed, refused, spread, trusted (B,): nis of the heaviest
    hypothesis, share of recent misses, whether the last sample was refused, standard deviation of the position over the
    range (infinite before it is known where the target is), whether the estimate may steer. assumed (3, B): what the
    tracking models assume on average of drift_psd, gust and feels; the middle of them for those that search.
    """

    def __init__(self, settings: EstimatorSettings, flights: int = 1, known: Prior | None = None) -> None:
        """known: of drift and airspeed scale, before the first range; forgotten with the first lost track."""
        self._settings = settings
        models = np.array(MODELS)
        models[:, 1:3] *= settings.speed
        psd, gust, nose, feels, white, drifting = models.T[..., None]
        self.noise = Noise(psd, gust, white, drifting, nose, feels)
        self._feels = self.noise.feels[:, 0] > 0
        self._assumptions = np.hstack([self.noise.drift_psd, self.noise.gust, self.noise.feels]).T
        self.stage = np.full(flights, Stage.EMPTY)
        self.mean = np.zeros((STATES, flights))
        self.covariance = np.zeros((STATES, STATES, flights))
        self.nis = np.full(flights, np.nan)
        self.missed = np.zeros(flights)
        self.refused = np.zeros(flights, bool)
        self.spread = np.full(flights, np.inf)
        self.trusted = np.zeros(flights, bool)
        self._since = np.zeros(flights)
        self._unheard: tuple[Batch, Batch, Batch, Batch, Batch] | None = None
        """The newest range (dt, chord, z, sigma, valid) that the search has not taken in."""
        self._due: tuple[Batch, Batch] | None = None
        """Whose search it is time to go on with, (B,), and the deviations of their ranges, m."""
        self._search = RingSearch(settings, flights, known)
        self._tracking = np.zeros(0, int)
        self._tracks = _copies(self.mean[:, :0], self.covariance[..., :0])
        self._assume()

    @property
    def favourite(self) -> Batch:
        """Number of the guess that a search thinks most of, (B,); -1 where there is no search."""
        number = np.full(self.stage.size, -1)
        number[self._search.at] = self._search.favourite
        return number

    @property
    def remembers(self) -> bool:
        """Whether the drift is known from before."""
        return self._search.remembers

    def step(self, *heard: Any) -> None:
        """`observe` and `search`."""
        self.observe(*heard)
        self.search()

    def observe(
        self, dt: Batch, chord: Batch, z: Batch, sigma: Batch, valid: Batch, felt: Felt | None = None,
        rates: Rates | None = None,
    ) -> None:  # fmt: skip
        """Carry flights on by dt (B,) along chord (2, B), and take in their ranges z, sigma where valid (B,). Nothing
        happens to those whose dt and chord are 0 and whose range is not valid. felt: the accelerations meanwhile.
        rates: range rates measured now."""
        self.search()
        sigma = np.minimum(np.maximum(sigma, LEAST_SIGMA), MOST_SIGMA)
        self._since += dt
        self._track(dt, chord, z, sigma, valid, felt, rates)
        lost = self._lose()
        self._since[valid] = 0.0
        self._unheard = dt, chord, z, sigma, valid
        if lost or self._tracking.size < self.stage.size:
            self._hear()  # a vehicle that searches is steered by what its search thinks most of

    def search(self) -> None:
        """Go on with the searches. The result counts from the next estimate on."""
        if self._unheard is not None:
            self._hear()
        if self._due is None:
            return
        (due, sigma), self._due = self._due, None
        found = self._search.go_on(due, sigma) if due.any() else None
        if found is not None:
            self._start(*found, sigma)
        self._tell_favourites()

    def _hear(self) -> None:
        """Let the search take in the newest range, and begin for those that hear their first one."""
        assert self._unheard is not None
        (dt, chord, z, sigma, valid), self._unheard = self._unheard, None
        due = self._search.hear(dt, chord, z, sigma, valid)
        begin = np.flatnonzero(valid & (self.stage == Stage.EMPTY))
        if begin.size:
            self.stage[begin] = Stage.SEARCH
            self._search.begin(begin, z[begin])
        if self._search.at.size:
            self._due = due, sigma
            self._tell_favourites()

    def _track(
        self, dt: Batch, chord: Batch, z: Batch, sigma: Batch, valid: Batch, felt: Felt | None, rates: Rates | None
    ) -> None:
        at = self._tracking
        if not at.size:
            return
        h = self._tracks
        of: Any = slice(None)
        if self.stage.size > 1:
            dt, chord, z, sigma, valid = (part[..., at] for part in (dt, chord, z, sigma, valid))
            felt, rates, of = felt and felt.of(at), rates and rates.of(at), at
        if dt.any():  # a rate has the very moment of its range
            h = ekf.predict(h, self.noise, dt, chord, sigma, felt)
        if valid.any():
            h, nis, taken = ekf.update(h, self.noise, z, sigma, valid, self._settings.gate)
            heaviest = (h.log_weight.argmax(axis=0), np.arange(at.size))
            self._count(of, nis[heaviest], taken[heaviest], valid)
        if rates is not None and rates.valid.any():
            h = ekf.update_rate(h, rates, self._settings.gate)
        mean, covariance = ekf.mixture(h)
        self._believe(of, mean, covariance)
        self._tracks = _revive(h, self._feels, mean, covariance)
        self._assume()

    def _believe(self, at: Any, mean: Batch, covariance: Batch) -> None:
        self.mean[:, at], self.covariance[:, :, at] = mean, covariance
        variance = covariance[R, R] / np.maximum(mean[R], 1.0) ** 2 + covariance[THETA, THETA]
        self.spread[at] = np.sqrt(np.maximum(variance, 0.0))
        # an estimate that steers goes on until it is much worse: a law on range alone holds the circle worse still,
        # and one bound for both would change the law at every wobble
        bound = np.where(self.trusted[at], KEPT, TRUSTED)
        self.trusted[at] = self.spread[at] < bound

    def _count(self, at: Any, nis: Batch, taken: Batch, valid: Batch) -> None:
        """Keep the share of recent samples that were refused."""
        missed, weight = self.missed[at], valid * np.minimum(self._since[at] / RECENT, 0.2)
        self.refused[at] = valid & ~taken
        self.missed[at] = missed + (~taken - missed) * weight
        self.nis[at] = np.where(valid, nis, self.nis[at])

    def _assume(self) -> None:
        weight = np.full((self._assumptions.shape[1], self.stage.size), 1 / self._assumptions.shape[1])
        weight[:, self._tracking] = self._tracks.weight
        self.assumed = self._assumptions @ weight

    def _lose(self) -> bool:
        """Send flights back to the ring whose track does not hold; tells whether there are any."""
        if not self._tracking.size:
            return False
        drift = np.hypot(*ekf.drift(self.mean))
        astray = (self.missed > MISSED) | (self.spread > LOST) | (drift > DRIFT_MOST * self._settings.speed)
        sound = np.isfinite(self.mean.sum(axis=0) + self.covariance.sum(axis=(0, 1)))
        lost = (self.stage == Stage.TRACK) & (astray | ~sound)
        if not lost.any():
            return False
        stay = ~lost[self._tracking]
        self._tracks = Hypotheses(*(part[..., stay] for part in self._tracks))
        self._tracking = self._tracking[stay]
        self.stage[lost], self.spread[lost] = Stage.EMPTY, np.inf
        self.trusted[lost] = self.refused[lost] = False
        self.mean[:, ~sound], self.covariance[:, :, ~sound] = 0.0, 0.0
        self._assume()
        self._search.forget()
        return True

    def _tell_favourites(self) -> None:
        """What a search thinks most of, as the mean."""
        at = self._search.at
        if at.size:
            x = self._search.favourites()
            self.mean[R, at], self.mean[THETA, at] = np.hypot(x[0], x[1]), np.arctan2(x[1], x[0])
            self.mean[ekf.DX : ekf.B, at], self.mean[ekf.B :, at] = x[ekf.DX :], 0.0

    def _start(self, at: Batch, x: Batch, P: Batch, sigma: Batch) -> None:
        """Start the tracks of flights whose search has ended."""
        known = slice(0, ekf.B)
        mean, covariance = np.zeros((STATES, at.size)), np.zeros((STATES, STATES, at.size))
        mean[known], covariance[known, known] = x, P
        covariance[ekf.B, ekf.B] = (0.5 * sigma[at]) ** 2
        covariance[ekf.GX, ekf.GX] = covariance[ekf.GY, ekf.GY] = (0.02 * self._settings.speed) ** 2
        covariance[ekf.FORWARD, ekf.FORWARD] = covariance[ekf.LEFT, ekf.LEFT] = ekf.FELT_BIAS**2
        mean, covariance = ekf.polar(mean, covariance)
        both = zip(self._tracks, _copies(mean, covariance), strict=True)
        self._tracks = Hypotheses(*(np.concatenate(parts, axis=-1) for parts in both))
        self._tracking = np.concatenate([self._tracking, at])
        self._believe(at, mean, covariance)
        self._assume()
        self.stage[at], self.missed[at] = Stage.TRACK, 0.0


def _copies(mean: Batch, covariance: Batch) -> Hypotheses:
    """The same belief under every model, equally likely."""
    x, P = np.repeat(mean[:, None], len(MODELS), axis=1), np.repeat(covariance[:, :, None], len(MODELS), axis=2)
    return Hypotheses(x, P, np.zeros((len(MODELS), mean.shape[-1])))


def _revive(h: Hypotheses, feels: Batch, mean: Batch, covariance: Batch) -> Hypotheses:
    """Start models again that lost, each from the mixture of its own kind: feels (M,), which go by accelerations. Where
    no model of a kind is left, from the mixture of all, mean (12, B) and covariance (12, 12, B).

    The models that feel can take a wrong airspeed for a gust that turns with the nose. The others show the mistake only
    if they are not started from it.
    """
    dead: Batch = h.log_weight < FORGOTTEN
    if not dead.any():
        return h
    x, P = h.x, h.P
    for kind in (feels, ~feels):
        again = dead & kind[:, None]
        if again.any():
            best = h.log_weight[kind].max(axis=0)
            theirs, spread = ekf.mixture(Hypotheses(h.x[:, kind], h.P[:, :, kind], h.log_weight[kind] - best))
            left: Batch = best >= FORGOTTEN
            start: Batch = np.where(left, theirs, mean)
            of_start: Batch = np.where(left, spread, covariance)
            x, P = np.where(again, start[:, None], x), np.where(again, of_start[:, :, None], P)
    return Hypotheses(x, P, np.where(dead, REVIVED, h.log_weight))
