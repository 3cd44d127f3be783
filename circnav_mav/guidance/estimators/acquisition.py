"""The search of flights that do not know where their target is: guesses all round, until one stands alone."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from circnav_mav.guidance.estimators.acquisition_window import (
    UNKNOWNS,
    Guesses,
    Prior,
    all_round,
    carried,
    covariance,
    improve,
)
from circnav_mav.guidance.estimators.range_bins import RangeWindow

Array = Any
SWITCH = 0.5
"""The favourite gives way to a guess that fits better by this log likelihood."""
ITERATIONS = 2
"""Of the least squares per bin."""
APART = 0.25
"""Guesses farther apart than this share of the range are different answers."""


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """When a search has an answer. hypotheses: guesses on the ring. speed: V, m/s.

    converged: bound of the position's standard deviation over the range. margin: how much worse (in log likelihood)
    every other place must fit. drift_sigma, drift_most: usual and largest size of the unknown drift, in V. scale_sigma:
    of the airspeed scale. min_bins: before any answer.
    window_psd: how fast the drift may change, m^2/s^3.
    """

    speed: float
    hypotheses: int = 32
    converged: float = 0.12
    margin: float = 5.0
    drift_sigma: float = 0.2
    scale_sigma: float = 0.05
    drift_most: float = 0.85
    min_bins: int = 8
    window_psd: float = 0.01


@dataclass(frozen=True, slots=True)
class Found:
    """Answers for the flights `at` (n,): x (5, n) of p, d, kappa, and covariance P (5, 5, n)."""

    at: Array
    x: Array
    P: Array


class RingSearch:
    """Searches for those of B flights that need one; all flights fill the window all the time."""

    def __init__(self, settings: SearchSettings, flights: int, known: Prior | None = None) -> None:
        """known: what all flights know already of drift and airspeed scale."""
        self._settings = settings
        self._window = RangeWindow(flights, settings.speed, settings.window_psd)
        self._prior, self.remembers = known or self._nothing_known(), known is not None
        self.at = np.zeros(0, int)
        self.favourite = np.zeros(0, int)
        self._guesses = all_round(np.zeros(0), settings.hypotheses, self._prior)
        self._guessed = np.zeros(flights), np.zeros((2, flights))

    def hear(self, dt: Array, chord: Array, z: Array, sigma: Array, valid: Array) -> Array:
        """Time and path go on, ranges come in where valid; tells whose search it is time to go on with, (B,)."""
        return self._window.add(dt, chord, z, sigma, valid)

    def forget(self) -> None:
        """Know nothing of the drift from now on."""
        self._prior, self.remembers = self._nothing_known(), False

    def begin(self, at: Array, r: Array) -> None:
        """Start on the rings of ranges r (n,) of the flights `at`."""
        self._carry()
        new = all_round(r, self._settings.hypotheses, self._prior)
        self.at = np.concatenate([self.at, at])
        self.favourite = np.concatenate([self.favourite, np.zeros(at.size, int)])
        old = self._guesses
        self._guesses = Guesses(
            np.concatenate([old.x, new.x]),
            np.concatenate([old.cost, new.cost]),
            np.concatenate([old.damping, new.damping]),
        )

    def go_on(self, due: Array, sigma: Array) -> Found | None:
        """Improve the guesses of flights that are due on the window; the answers that became clear leave the search."""
        self._carry()
        of = np.flatnonzero(due[self.at])
        if not of.size:
            return None
        at, cfg, flights = self.at[of], self._settings, np.arange(of.size)
        bins, filled, g = self._window.bins(at, sigma), self._window.filled(at), self._guesses.some(of)
        for _ in range(ITERATIONS):
            g = improve(g, bins, self._prior)
        self._guesses.put(of, g)
        best = g.cost.argmin(axis=1)
        better = g.cost[flights, best] < g.cost[flights, self.favourite[of]] - SWITCH
        self.favourite[of] = np.where(better, best, self.favourite[of])
        x, cost = g.x[flights, best], g.cost[flights, best]
        scale = np.maximum(1.0, 2 * cost / np.maximum(filled - UNKNOWNS + 1, 1))
        P = covariance(x[:, None], bins, self._prior)[:, 0] * scale[:, None, None]
        known = np.sqrt(P[:, 0, 0] + P[:, 1, 1]) < cfg.converged * np.hypot(x[:, 0], x[:, 1])
        flyable = np.hypot(x[:, 2], x[:, 3]) < cfg.drift_most * cfg.speed
        alone = _margin(g, x, cost) > cfg.margin * scale
        found = known & flyable & alone & (filled >= cfg.min_bins)
        if not found.any():
            return None
        self._leave(of[found])
        return Found(at[found], x[found].T, np.moveaxis(P[found], 0, -1))

    def favourites(self) -> Array:
        """What each search thinks most of, brought to the present, (5, n): a place to try, not to trust."""
        then, path = self._guessed
        x = self._guesses.x[np.arange(self.at.size), self.favourite].T
        step = (self._window.path - path)[:, self.at]
        p = x[:2] + x[4] * step + x[2:4] * (self._window.now - then)[self.at]
        return np.concatenate([p, x[2:]])

    def _nothing_known(self) -> Prior:
        return Prior(self._settings.drift_sigma * self._settings.speed, self._settings.scale_sigma)

    def _carry(self) -> None:
        then, path = self._guessed
        step = (self._window.path - path)[:, self.at]
        self._guesses = carried(self._guesses, (self._window.now - then)[self.at], step)
        self._guessed = self._window.now, self._window.path

    def _leave(self, of: Array) -> None:
        """Those of the searching flights search no more."""
        stay = np.delete(np.arange(self.at.size), of)
        self._guesses = self._guesses.some(stay)
        self.at, self.favourite = self.at[stay], self.favourite[stay]


def _margin(g: Guesses, x: Array, cost: Array) -> Array:
    """How much worse the best guess elsewhere fits, (B,)."""
    r = np.hypot(x[:, 0], x[:, 1])
    away = np.hypot(g.x[..., 0] - x[:, None, 0], g.x[..., 1] - x[:, None, 1]) > APART * r[:, None]
    return np.where(away, g.cost, np.inf).min(axis=1) - cost
