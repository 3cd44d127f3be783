"""The bank of relative-motion filters: search round the ring, track with several noise models, search again when lost.

SEARCH: hypotheses in all directions of the newest range, fitted to a window of the last seconds. When one explains
them and no other does, the flight is in TRACK: one Kalman filter per noise model (drift steady .. gusty, range error
white .. drifting); the evidence decides which model counts, and a model that lost is started again from the mixture.
A flight whose samples keep falling outside the gate searches again, at once and with the window that it has.

Every array has a last axis B over flights; in the air B = 1.
"""

from dataclasses import dataclass
from enum import IntEnum
from itertools import product

import numpy as np

from circnav_mav.core.estimators.bank import (
    DX,
    GX,
    GY,
    KAPPA,
    STATES,
    THETA,
    Array,
    Hypotheses,
    Noise,
    R,
    mixture,
    polar,
    predict,
    update,
)
from circnav_mav.core.estimators.bank import (
    B as BIAS,
)
from circnav_mav.core.estimators.bank import (
    drift as drift_of,
)
from circnav_mav.core.estimators.bins import RangeWindow
from circnav_mav.core.estimators.window import Guesses, Prior, all_round, carried, improve
from circnav_mav.core.estimators.window import covariance as covariance_of


class Stage(IntEnum):
    """Where a flight's bank stands."""

    EMPTY = 0
    SEARCH = 1
    TRACK = 2


@dataclass(frozen=True, slots=True)
class BankSettings:
    """speed: V, m/s. hypotheses: on the ring. gate: in standard deviations.

    converged, trusted, lost: bounds of the position's standard deviation over the range: below the first the search
    ends, above the second the estimate must not steer, above the third the track is given up. margin: how much worse
    (in log likelihood) every other place must fit. missed: share of recent samples outside the gate that ends the
    track; recent: memory of it, s. drift_sigma, drift_most: of the unknown drift, in V. min_bins: before any answer.
    winds, noises: the models in TRACK, all pairs of (m^2/s^3 of d, gust in V) and (white, drifting) parts of sigma.
    window_psd: of d in SEARCH.
    """

    speed: float
    hypotheses: int = 32
    gate: float = 5.0
    converged: float = 0.12
    trusted: float = 0.25
    lost: float = 0.6
    margin: float = 5.0
    missed: float = 0.6
    recent: float = 3.0
    min_bins: int = 8
    drift_sigma: float = 0.4
    drift_most: float = 0.85
    winds: tuple[tuple[float, float], ...] = ((3e-4, 0.0), (1e-2, 0.0), (1e-2, 0.1))
    noises: tuple[tuple[float, float], ...] = ((1.0, 0.0), (0.4, 0.9))
    window_psd: float = 0.01


FORGOTTEN, REVIVED = -12.0, -6.0
"""A model whose log weight falls below the first starts again from the mixture with the second."""
SWITCH = 0.5
"""The favourite of a search gives way to a guess that fits better by this log likelihood."""
ITERATIONS = 2
"""Of the least squares per bin."""
APART = 0.25
"""Guesses farther apart than this share of the range are different answers."""


class DriftBank:
    """The banks of B flights that are stepped together. `step` is the only way in; the attributes are what is believed.

    mean (8, B), covariance (8, 8, B), stage, nis, missed, refused (B,): nis of the heaviest hypothesis, share of
    recent misses, whether the last sample was refused.
    """

    def __init__(self, settings: BankSettings, flights: int = 1) -> None:
        self.settings = settings
        models = np.array([(*wind, *noise) for wind, noise in product(settings.winds, settings.noises)])
        models[:, 1] *= settings.speed
        self.noise = Noise(*models.T[..., None])
        self.stage = np.full(flights, Stage.EMPTY)
        self.mean = np.zeros((STATES, flights))
        self.covariance = np.zeros((STATES, STATES, flights))
        self.nis = np.full(flights, np.nan)
        self.missed = np.zeros(flights)
        self.refused = np.zeros(flights, bool)
        self._since = np.zeros(flights)
        self._window = RangeWindow(flights, settings.speed, settings.window_psd)
        self._prior = Prior(settings.drift_sigma * settings.speed)
        self._searching = np.zeros(0, int)
        self._guesses = all_round(np.zeros(0), settings.hypotheses)
        self._favourite = np.zeros(0, int)
        self._guessed = 0.0, np.zeros((2, flights))
        self._tracking = np.zeros(0, int)
        self._tracks = _copies(self.mean[:, :0], self.covariance[..., :0], len(models))

    @property
    def spread(self) -> Array:
        """Standard deviation of the position over the range, (B,); infinite before it is known where the target is."""
        variance = self.covariance[R, R] / np.maximum(self.mean[R], 1.0) ** 2 + self.covariance[THETA, THETA]
        return np.where(self.stage == Stage.TRACK, np.sqrt(np.maximum(variance, 0.0)), np.inf)

    @property
    def trusted(self) -> Array:
        """Whether the estimate may steer, (B,)."""
        return self.spread < self.settings.trusted

    @property
    def favourite(self) -> Array:
        """Number of the guess that a search thinks most of, (B,); -1 where there is no search."""
        number = np.full(self.stage.size, -1)
        number[self._searching] = self._favourite
        return number

    @property
    def likely_noise(self) -> Noise:
        """What the tracking models assume on average, arrays (1, B); the middle of them for those that search."""
        weight = np.full((len(self.noise.white), self.stage.size), 1 / len(self.noise.white))
        weight[:, self._tracking] = self._tracks.weight
        return Noise(
            *(
                (part * weight).sum(axis=0, keepdims=True)
                for part in (self.noise.drift_psd, self.noise.gust, self.noise.white, self.noise.drifting)
            )
        )

    def step(self, dt: float, chord: Array, z: Array, sigma: Array, valid: Array) -> None:
        """Carry all flights on by dt along chord (2, B), and take in their ranges z, sigma where valid (B,)."""
        self._since += dt
        closed = self._window.add(dt, chord, z, sigma, valid)
        self._track(dt, chord, z, sigma, valid)
        self._lose(z, valid)
        if closed:
            self._search(sigma)
        self._tell_favourites()
        self._since[valid] = 0.0

    def _track(self, dt: float, chord: Array, z: Array, sigma: Array, valid: Array) -> None:
        at = self._tracking
        if not at.size:
            return
        h = predict(self._tracks, self.noise, dt, chord[:, at], sigma[at])
        if valid[at].any():
            h, said = update(h, self.noise, z[at], sigma[at], valid[at], self.settings.gate)
            heaviest = (h.log_weight.argmax(axis=0), np.arange(at.size))
            self._count(at, said.nis[heaviest], said.taken[heaviest], valid[at])
        self.mean[:, at], self.covariance[:, :, at] = mean, covariance = mixture(h)
        self._tracks = _revive(h, mean, covariance)

    def _count(self, at: Array, nis: Array, taken: Array, valid: Array) -> None:
        """Keep the share of recent samples that were refused."""
        of = at[valid]
        weight = np.minimum(self._since[of] / self.settings.recent, 0.2)
        self.refused[at] = valid & ~taken
        self.missed[of] += (~taken[valid] - self.missed[of]) * weight
        self.nis[of] = nis[valid]

    def _lose(self, z: Array, valid: Array) -> None:
        """Send flights back to the ring whose track does not hold, and those that hear their first range."""
        cfg = self.settings
        drift = np.hypot(*drift_of(self.mean))
        astray = (self.missed > cfg.missed) | (self.spread > cfg.lost) | (drift > cfg.drift_most * cfg.speed)
        lost = (self.stage == Stage.TRACK) & astray
        begin = np.flatnonzero(valid & (lost | (self.stage == Stage.EMPTY)))
        if lost.any():
            stay = ~lost[self._tracking]
            self._tracking, self._tracks = self._tracking[stay], _some(self._tracks, stay)
            self.stage[lost] = Stage.EMPTY
        if begin.size:
            self.stage[begin] = Stage.SEARCH
            self.mean[BIAS, begin] = 0.0
            self._begin(begin, z[begin])

    def _begin(self, at: Array, r: Array) -> None:
        self._carry()
        old, new = self._guesses, all_round(r, self.settings.hypotheses)
        self._searching = np.concatenate([self._searching, at])
        self._favourite = np.concatenate([self._favourite, np.zeros(at.size, int)])
        self._guesses = Guesses(
            *(np.concatenate(pair) for pair in ((old.x, new.x), (old.cost, new.cost), (old.damping, new.damping)))
        )

    def _carry(self) -> None:
        """Bring the guesses to the present."""
        then, path = self._guessed
        step = (self._window.path - path)[:, self._searching]
        self._guesses = carried(self._guesses, self._window.now - then, step)
        self._guessed = self._window.now, self._window.path

    def _search(self, sigma: Array) -> None:
        """One more iteration of all guesses on the window; flights whose answer is clear go to TRACK."""
        self._carry()
        at = self._searching
        if not at.size:
            return
        bins = self._window.bins(at, sigma)
        g = self._guesses
        for _ in range(ITERATIONS):
            g = improve(g, bins, self._prior)
        self._guesses = g
        flights = np.arange(at.size)
        best = g.cost.argmin(axis=1)
        better = g.cost[flights, best] < g.cost[flights, self._favourite] - SWITCH
        self._favourite = np.where(better, best, self._favourite)
        x, cost = g.x[flights, best], g.cost[flights, best]
        r = np.hypot(x[:, 0], x[:, 1])
        away = np.hypot(g.x[..., 0] - x[:, None, 0], g.x[..., 1] - x[:, None, 1]) > APART * r[:, None]
        margin = np.where(away, g.cost, np.inf).min(axis=1) - cost
        scale = np.maximum(1.0, 2 * cost / np.maximum(self._window.filled(at) - 4, 1))
        P = covariance_of(x[:, None], bins, self._prior)[:, 0] * scale[:, None, None]
        known = np.sqrt(P[:, 0, 0] + P[:, 1, 1]) < self.settings.converged * r
        slow = np.hypot(x[:, 2], x[:, 3]) < self.settings.drift_most * self.settings.speed
        enough = self._window.filled(at) >= self.settings.min_bins
        found = known & slow & enough & (margin > self.settings.margin * scale)
        if found.any():
            self._found(found, x, P, sigma)

    def _tell_favourites(self) -> None:
        """What a search thinks most of, as the mean: a place to try, not to trust."""
        at = self._searching
        if not at.size:
            return
        then, path = self._guessed
        x = self._guesses.x[np.arange(at.size), self._favourite].T
        step = (self._window.path - path)[:, at]
        p = x[:2] + x[KAPPA] * step + x[2:4] * (self._window.now - then)
        self.mean[R, at], self.mean[THETA, at] = np.hypot(p[0], p[1]), np.arctan2(p[1], p[0])
        self.mean[DX:BIAS, at], self.mean[BIAS:, at] = x[DX:BIAS], 0.0

    def _found(self, found: Array, x: Array, P: Array, sigma: Array) -> None:
        """Start the tracks of flights whose search has ended."""
        at = self._searching[found]
        mean, covariance = np.zeros((STATES, at.size)), np.zeros((STATES, STATES, at.size))
        mean[:BIAS], covariance[:BIAS, :BIAS] = x[found].T, np.moveaxis(P[found], 0, -1)
        covariance[BIAS, BIAS] = (0.5 * sigma[at]) ** 2
        covariance[GX, GX] = covariance[GY, GY] = (0.02 * self.settings.speed) ** 2
        mean, covariance = polar(mean, covariance)
        new = _copies(mean, covariance, len(self.noise.white))
        old = self._tracks
        self._tracks = Hypotheses(
            *(
                np.concatenate(pair, axis=-1)
                for pair in ((old.x, new.x), (old.P, new.P), (old.log_weight, new.log_weight))
            )
        )
        self._tracking = np.concatenate([self._tracking, at])
        self.mean[:, at], self.covariance[:, :, at] = mean, covariance
        self.stage[at], self.missed[at] = Stage.TRACK, 0.0
        stay = ~found
        g = self._guesses
        self._favourite = self._favourite[stay]
        self._searching, self._guesses = self._searching[stay], Guesses(g.x[stay], g.cost[stay], g.damping[stay])


def _some(h: Hypotheses, which: Array) -> Hypotheses:
    return Hypotheses(h.x[..., which], h.P[..., which], h.log_weight[..., which])


def _copies(mean: Array, covariance: Array, count: int) -> Hypotheses:
    """The same belief under every model, equally likely."""
    return Hypotheses(
        np.repeat(mean[:, None], count, axis=1),
        np.repeat(covariance[:, :, None], count, axis=2),
        np.zeros((count, mean.shape[-1])),
    )


def _revive(h: Hypotheses, mean: Array, covariance: Array) -> Hypotheses:
    """Start models again that lost; what they hold is no use to anybody."""
    dead = h.log_weight < FORGOTTEN
    if not dead.any():
        return h
    return Hypotheses(
        np.where(dead, mean[:, None], h.x),
        np.where(dead, covariance[:, :, None], h.P),
        np.where(dead, REVIVED, h.log_weight),
    )
