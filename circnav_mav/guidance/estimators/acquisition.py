"""The search of flights that do not know where their target is: guesses all round, until one stands alone.

A Kalman filter started on a ring of bearings is overconfident: it draws its tangents while the target may still be
anywhere. So the search keeps the ranges of a window and the air path flown, and improves M guesses of (p, d, kappa) by
Levenberg-Marquardt, all bins at once, one iteration per bin: whatever the data cannot tell apart stays apart as two
guesses of equal cost. Source: multi-start nonlinear least squares, Nocedal and Wright (2006), ch. 10.

Arrays have the axes B flights, M guesses, N bins. Frame and symbols as in `relative_ekf`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_bins import Bins, RangeWindow
from circnav_mav.guidance.maths import Batch

UNKNOWNS = 5
"""Position (2), drift (2) and airspeed scale."""
GUESSES = 32
"""On the ring."""
MOST_DAMPING, LEAST_DAMPING = 1e6, 1e-4
"""Bounds of the damping of Levenberg and Marquardt: nearly no step, and nearly Gauss-Newton; chosen."""
ROBUST = 4.0
"""Residuals beyond so many standard deviations count as if at the edge (a Cauchy-like weight)."""
SWITCH = 0.5
"""The favourite gives way to a guess that fits better by this log likelihood."""
ITERATIONS = 2
"""Of the least squares per bin."""
APART = 0.25
"""Guesses farther apart than this share of the range are different answers."""
CONVERGED = 0.12
"""Bound of the position's standard deviation over the range, for an answer."""
MARGIN = 5.0
"""How much worse, in log likelihood, every other place must fit."""
MIN_BINS = 8
"""Before any answer."""
DRIFT_MOST = 0.85
"""Largest drift that makes sense, in V."""


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known before any range: d = (dx, dy) +- drift (m/s), kappa = scale +- kappa.

    The drift's distribution is heavy-tailed (Cauchy): most targets stand still, and what moves may move fast. A normal
    one made the guesses of a still target wander off by metres a second for want of a reason not to.
    """

    drift: float
    kappa: float = 0.05
    dx: float = 0.0
    dy: float = 0.0
    scale: float = 1.0

    @property
    def mean(self) -> Batch:
        return np.array([0.0, 0.0, self.dx, self.dy, self.scale])

    def information(self, x: Batch) -> Batch:
        """Weights of the deviations of guesses x (..., 5) in their least squares."""
        of_drift = 2 / (self.drift**2 + self._apart(x))
        none = np.zeros_like(of_drift)
        return np.stack([none, none, of_drift, of_drift, none + self.kappa**-2], axis=-1)

    def cost(self, x: Batch) -> Batch:
        """How unlikely guesses x (..., 5) are, minus the logarithm."""
        return np.asarray(np.log1p(self._apart(x) / self.drift**2) + 0.5 * ((x[..., 4] - self.scale) / self.kappa) ** 2)

    def _apart(self, x: Batch) -> Batch:
        return (x[..., 2] - self.dx) ** 2 + (x[..., 3] - self.dy) ** 2


class Guesses(NamedTuple):
    """M guesses for each of B flights: x (B, M, 5) of p, d, kappa now; cost (B, M) there; damping (B, M)."""

    x: Batch
    cost: Batch
    damping: Batch

    def some(self, of: Batch) -> "Guesses":
        """Those of some flights."""
        return Guesses(*(part[of] for part in self))


class RingSearch:
    """Searches for those of B flights that need one; all flights fill the window all the time."""

    def __init__(self, settings: EstimatorSettings, flights: int, known: Prior | None = None) -> None:
        """known: what all flights know already of drift and airspeed scale."""
        self._settings = settings
        self._window = RangeWindow(flights, settings.speed)
        self._prior, self.remembers = known or self._nothing_known(), known is not None
        self.at = np.zeros(0, int)
        self.favourite = np.zeros(0, int)
        self._guesses = all_round(np.zeros(0), self._prior)
        self._guessed = np.zeros(flights), np.zeros((2, flights))

    def hear(self, dt: Batch, chord: Batch, z: Batch, sigma: Batch, valid: Batch) -> Batch:
        """Time and path go on, ranges come in where valid; tells whose search it is time to go on with, (B,)."""
        return self._window.add(dt, chord, z, sigma, valid)

    def forget(self) -> None:
        """Know nothing of the drift from now on."""
        self._prior, self.remembers = self._nothing_known(), False

    def begin(self, at: Batch, r: Batch) -> None:
        """Start on the rings of ranges r (n,) of the flights `at`."""
        self._carry()
        self.at = np.concatenate([self.at, at])
        self.favourite = np.concatenate([self.favourite, np.zeros(at.size, int)])
        both = zip(self._guesses, all_round(r, self._prior), strict=True)
        self._guesses = Guesses(*(np.concatenate(parts) for parts in both))

    def go_on(self, due: Batch, sigma: Batch) -> tuple[Batch, Batch, Batch] | None:
        """Improve the guesses of flights that are due on the window; the answers that became clear leave the search:
        of which flights (n,), x (5, n) of p, d, kappa, and covariance (5, 5, n)."""
        self._carry()
        of = np.flatnonzero(due[self.at])
        if not of.size:
            return None
        at, flights = self.at[of], np.arange(of.size)
        bins, filled, g = self._window.bins(at, sigma), self._window.filled(at), self._guesses.some(of)
        for _ in range(ITERATIONS):
            g = improve(g, bins, self._prior)
        all_ = self._guesses
        all_.x[of], all_.cost[of], all_.damping[of] = g.x, g.cost, g.damping
        best = g.cost.argmin(axis=1)
        better = g.cost[flights, best] < g.cost[flights, self.favourite[of]] - SWITCH
        self.favourite[of] = np.where(better, best, self.favourite[of])
        x, cost = g.x[flights, best], g.cost[flights, best]
        scale = np.maximum(1.0, 2 * cost / np.maximum(filled - UNKNOWNS + 1, 1))
        P = covariance(x[:, None], bins, self._prior)[:, 0] * scale[:, None, None]
        known = np.sqrt(P[:, 0, 0] + P[:, 1, 1]) < CONVERGED * np.hypot(x[:, 0], x[:, 1])
        flyable = np.hypot(x[:, 2], x[:, 3]) < DRIFT_MOST * self._settings.speed
        away = np.hypot(g.x[..., 0] - x[:, None, 0], g.x[..., 1] - x[:, None, 1])
        elsewhere = np.where(away > APART * np.hypot(x[:, 0], x[:, 1])[:, None], g.cost, np.inf).min(axis=1)
        alone = elsewhere - cost > MARGIN * scale
        found = known & flyable & alone & (filled >= MIN_BINS)
        if not found.any():
            return None
        stay = np.delete(np.arange(self.at.size), of[found])
        self._guesses = self._guesses.some(stay)
        self.at, self.favourite = self.at[stay], self.favourite[stay]
        return at[found], x[found].T, np.moveaxis(P[found], 0, -1)

    def favourites(self) -> Batch:
        """What each search thinks most of, brought to the present, (5, n): a place to try, not to trust."""
        then, path = self._guessed
        x = self._guesses.x[np.arange(self.at.size), self.favourite].T
        step = (self._window.path - path)[:, self.at]
        p = x[:2] + x[4] * step + x[2:4] * (self._window.now - then)[self.at]
        return np.concatenate([p, x[2:]])

    def _nothing_known(self) -> Prior:
        return Prior(self._settings.drift_sigma * self._settings.speed, self._settings.scale_sigma)

    def _carry(self) -> None:
        """Bring the guesses to the present: what they say of the past stays the same."""
        (then, before), g = self._guessed, self._guesses
        self._guessed = self._window.now, self._window.path
        dt, path = (self._window.now - then)[self.at], (self._window.path - before)[:, self.at]
        x = g.x.copy()
        x[..., 0] += x[..., 4] * path[0][:, None] + x[..., 2] * dt[:, None]
        x[..., 1] += x[..., 4] * path[1][:, None] + x[..., 3] * dt[:, None]
        self._guesses = Guesses(x, g.cost, g.damping)


def all_round(r: Batch, prior: Prior) -> Guesses:
    """Guesses in all directions of the ranges r (B,), the rest as known before."""
    angle = 2 * np.pi * (np.arange(GUESSES) + 0.5) / GUESSES
    x = np.zeros((r.size, GUESSES, UNKNOWNS)) + prior.mean
    x[..., 0], x[..., 1] = r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)
    return Guesses(x, np.full((r.size, GUESSES), np.inf), np.ones((r.size, GUESSES)))


def improve(g: Guesses, bins: Bins, prior: Prior) -> Guesses:
    """One Levenberg-Marquardt iteration of every guess; a step that does not pay is taken back and damped."""
    cost, A, b = _normal_equations(g.x, bins, prior)
    damped = A + (g.damping[..., None, None] * np.einsum("...ii->...i", A)[..., None]) * np.eye(UNKNOWNS)
    x = g.x + np.linalg.solve(damped + 1e-9 * np.eye(UNKNOWNS), b[..., None])[..., 0]
    better = _penalty(_residual(x, bins)[0]) + prior.cost(x)
    pays = better < cost
    damping = np.clip(np.where(pays, g.damping / 5, g.damping * 5), LEAST_DAMPING, MOST_DAMPING)
    return Guesses(np.where(pays[..., None], x, g.x), np.where(pays, better, cost), damping)


def covariance(x: Batch, bins: Bins, prior: Prior) -> Batch:
    """Covariance of guesses x (B, M, 5) by the curvature of the cost, (B, M, 5, 5)."""
    A = _normal_equations(x, bins, prior)[1]
    return np.linalg.inv(A + 1e-9 * np.eye(UNKNOWNS))


def _residual(x: Batch, bins: Bins) -> tuple[Batch, Batch, Batch]:
    """Residuals over their standard deviations (B, M, N), and the offsets p then (two of (B, M, N))."""
    px = x[..., 0, None] - x[..., 4, None] * bins.path[0][:, None] - x[..., 2, None] * bins.age[:, None]
    py = x[..., 1, None] - x[..., 4, None] * bins.path[1][:, None] - x[..., 3, None] * bins.age[:, None]
    r = np.sqrt(px * px + py * py) + 1e-6
    return (bins.z[:, None] - r) / np.sqrt(bins.variance)[:, None], px / r, py / r


def _penalty(residual: Batch) -> Batch:
    return (0.5 * ROBUST**2 * np.log1p((residual / ROBUST) ** 2)).sum(axis=-1)


def _normal_equations(x: Batch, bins: Bins, prior: Prior) -> tuple[Batch, Batch, Batch]:
    residual, nx, ny = _residual(x, bins)
    weight = 1 / (1 + (residual / ROBUST) ** 2)
    J = np.empty((*residual.shape, UNKNOWNS))
    J[..., 0], J[..., 1] = nx, ny
    J[..., 2], J[..., 3] = -nx * bins.age[:, None], -ny * bins.age[:, None]
    J[..., 4] = -(nx * bins.path[0][:, None] + ny * bins.path[1][:, None])
    J /= np.sqrt(bins.variance)[:, None, :, None]
    JT = np.swapaxes(J * weight[..., None], -1, -2)
    information = prior.information(x)
    A = JT @ J + information[..., None] * np.eye(UNKNOWNS)
    b = (JT @ residual[..., None])[..., 0] - information * (x - prior.mean)
    return _penalty(residual) + prior.cost(x), A, b
