"""Where can the target be, given the last seconds of ranges? Least squares from many starts over a window.

A Kalman filter started on a ring of bearings is overconfident: it draws its tangents while the target may still be
anywhere. So the search keeps the ranges of a window and the air path flown, and improves M guesses of (p, d, kappa) by
Levenberg-Marquardt, all bins at once, one iteration per bin: whatever the data cannot tell apart stays apart as two
guesses of equal cost. Source: multi-start nonlinear least squares, Nocedal and Wright (2006), ch. 10.

Arrays have the axes B flights, M guesses, N bins. Frame and symbols as in `bank`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any
UNKNOWNS = 5
MOST_DAMPING, LEAST_DAMPING = 1e6, 1e-4
ROBUST = 4.0
"""Residuals beyond so many standard deviations count as if at the edge (a Cauchy-like weight)."""


@dataclass(frozen=True, slots=True)
class Bins:
    """N averaged ranges of B flights, newest last, shape (B, N): age (s) and path (2, B, N; m) since, both counted
    back from now, z (m) and its variance (m^2; infinite for an empty bin)."""

    age: Array
    path: Array
    z: Array
    variance: Array


@dataclass(frozen=True, slots=True)
class Guesses:
    """M guesses for each of B flights: x (B, M, 5) of p, d, kappa now; cost (B, M) there; damping (B, M)."""

    x: Array
    cost: Array
    damping: Array

    def some(self, of: Array) -> "Guesses":
        """Those of some flights."""
        return Guesses(self.x[of], self.cost[of], self.damping[of])

    def put(self, of: Array, new: "Guesses") -> None:
        """Replace those of some flights."""
        self.x[of], self.cost[of], self.damping[of] = new.x, new.cost, new.damping


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
    def mean(self) -> Array:
        return np.array([0.0, 0.0, self.dx, self.dy, self.scale])

    def information(self, x: Array) -> Array:
        """Weights of the deviations of guesses x (..., 5) in their least squares."""
        of_drift = 2 / (self.drift**2 + self._apart(x))
        none = np.zeros_like(of_drift)
        return np.stack([none, none, of_drift, of_drift, none + self.kappa**-2], axis=-1)

    def cost(self, x: Array) -> Array:
        """How unlikely guesses x (..., 5) are, minus the logarithm."""
        return np.asarray(np.log1p(self._apart(x) / self.drift**2) + 0.5 * ((x[..., 4] - self.scale) / self.kappa) ** 2)

    def _apart(self, x: Array) -> Array:
        return (x[..., 2] - self.dx) ** 2 + (x[..., 3] - self.dy) ** 2


def all_round(r: Array, count: int, prior: Prior) -> Guesses:
    """Guesses in all directions of the ranges r (B,), the rest as known before."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    x = np.zeros((r.size, count, UNKNOWNS)) + prior.mean
    x[..., 0], x[..., 1] = r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)
    return Guesses(x, np.full((r.size, count), np.inf), np.ones((r.size, count)))


def carried(g: Guesses, dt: Array, path: Array) -> Guesses:
    """The guesses after dt (B,) along a path (2, B) more: what they say of the past stays the same."""
    x = g.x.copy()
    x[..., 0] += x[..., 4] * path[0][:, None] + x[..., 2] * dt[:, None]
    x[..., 1] += x[..., 4] * path[1][:, None] + x[..., 3] * dt[:, None]
    return Guesses(x, g.cost, g.damping)


def improve(g: Guesses, bins: Bins, prior: Prior) -> Guesses:
    """One Levenberg-Marquardt iteration of every guess; a step that does not pay is taken back and damped."""
    cost, A, b = _normal_equations(g.x, bins, prior)
    damped = A + (g.damping[..., None, None] * np.einsum("...ii->...i", A)[..., None]) * np.eye(UNKNOWNS)
    x = g.x + np.linalg.solve(damped + 1e-9 * np.eye(UNKNOWNS), b[..., None])[..., 0]
    better = _cost(x, bins, prior)
    pays = better < cost
    damping = np.clip(np.where(pays, g.damping / 5, g.damping * 5), LEAST_DAMPING, MOST_DAMPING)
    return Guesses(np.where(pays[..., None], x, g.x), np.where(pays, better, cost), damping)


def covariance(x: Array, bins: Bins, prior: Prior) -> Array:
    """Covariance of guesses x (B, M, 5) by the curvature of the cost, (B, M, 5, 5)."""
    A = _normal_equations(x, bins, prior)[1]
    return np.linalg.inv(A + 1e-9 * np.eye(UNKNOWNS))


def _residual(x: Array, bins: Bins) -> tuple[Array, Array, Array]:
    """Residuals over their standard deviations (B, M, N), and the offsets p then (two of (B, M, N))."""
    px = x[..., 0, None] - x[..., 4, None] * bins.path[0][:, None] - x[..., 2, None] * bins.age[:, None]
    py = x[..., 1, None] - x[..., 4, None] * bins.path[1][:, None] - x[..., 3, None] * bins.age[:, None]
    r = np.sqrt(px * px + py * py) + 1e-6
    return (bins.z[:, None] - r) / np.sqrt(bins.variance)[:, None], px / r, py / r


def _penalty(residual: Array) -> Array:
    return 0.5 * ROBUST**2 * np.log1p((residual / ROBUST) ** 2)


def _cost(x: Array, bins: Bins, prior: Prior) -> Array:
    residual = _residual(x, bins)[0]
    return _penalty(residual).sum(axis=-1) + prior.cost(x)


def _normal_equations(x: Array, bins: Bins, prior: Prior) -> tuple[Array, Array, Array]:
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
    return _penalty(residual).sum(axis=-1) + prior.cost(x), A, b
