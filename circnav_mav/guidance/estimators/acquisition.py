"""Acquisition of the target: hypotheses in all directions, until a single one fits the ranges.

Kalman filters started on a ring of bearings are overconfident: each linearizes along its own
tangent although the target may be in any direction. The search instead keeps a window of ranges and
the air path flown. It improves M hypotheses of (p, d, kappa) by Levenberg-Marquardt on all bins.
Hypotheses that fit the data equally well remain separate. Source: multi-start nonlinear least
squares, Nocedal and Wright (2006), ch. 10.

Arrays have the axes B flights, M hypotheses, N bins. Frame and symbols as in `relative_ekf`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_bins import Bins, RangeWindow
from circnav_mav.guidance.maths import Batch

UNKNOWNS = 5
"""Position (2), drift (2) and airspeed scale."""
CANDIDATES = 32
"""Initial hypotheses of a search, equally spaced in bearing on a circle with the radius of the
first range."""
MOST_DAMPING = 1e6
LEAST_DAMPING = 1e-4
"""Bounds of the Levenberg-Marquardt damping: almost no step, and almost Gauss-Newton; chosen."""
ROBUST = 4.0
"""Scale of the robust (Cauchy) weight, in standard deviations: the weight of larger residuals
decreases."""
SWITCH = 0.5
"""Advantage in log likelihood that another hypothesis needs to replace the most likely one."""
ITERATIONS = 2
"""Least-squares iterations per bin."""
APART = 0.25
"""Distance, as a share of the range, above which two hypotheses are different solutions."""
CONVERGED = 0.12
"""Largest standard deviation of the position, as a share of the range, of an accepted solution."""
MARGIN = 5.0
"""Advantage in log likelihood over every other position that an accepted solution needs."""
MIN_BINS = 8
"""Fewest filled bins before a solution is accepted."""
DRIFT_MOST = 0.85
"""Largest plausible drift, as a share of V."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Values before the first range: drift (dx, dy) +- drift, m/s, and airspeed scale `scale` +-
    kappa.

    The drift has a heavy-tailed (Cauchy) distribution: most targets are stationary, and moving ones
    may be fast. With a normal distribution, the hypotheses for a stationary target had several m/s
    of drift.
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
        """Return the inverse variances of the prior for hypotheses x (..., 5), as an array with the
        shape of x.

        Position: 0, because the prior has no position. Drift: the inverse variance of the normal
        distribution whose log density has the same slope at x as that of the Cauchy distribution.
        Airspeed scale: kappa^-2.
        """
        of_drift = 2 / (self.drift**2 + self._apart(x))
        none = np.zeros_like(of_drift)
        return np.stack([none, none, of_drift, of_drift, none + self.kappa**-2], axis=-1)

    def cost(self, x: Batch) -> Batch:
        """Return the negative log prior of hypotheses x (..., 5)."""
        return np.asarray(
            np.log1p(self._apart(x) / self.drift**2)
            + 0.5 * ((x[..., 4] - self.scale) / self.kappa) ** 2
        )

    def _apart(self, x: Batch) -> Batch:
        return (x[..., 2] - self.dx) ** 2 + (x[..., 3] - self.dy) ** 2


class Candidates(NamedTuple):
    """M hypotheses for each of B flights: current p, d, kappa in x (B, M, 5), their cost (B, M) and
    damping (B, M)."""

    x: Batch
    cost: Batch
    damping: Batch

    def some(self, of: Batch) -> "Candidates":
        """Return the hypotheses of the selected flights."""
        return Candidates(*(part[of] for part in self))


class Acquisition:
    """Searches for the targets of B flights. The search of a flight runs until it has a solution.
    The window stores the ranges of all flights."""

    def __init__(
        self, settings: EstimatorSettings, flights: int, known: Prior | None = None
    ) -> None:
        """known: prior of drift and airspeed scale, common to all flights."""
        self._settings = settings
        self._window = RangeWindow(flights, settings.speed)
        self._prior = known or self._nothing_known()
        self.remembers = known is not None
        self.at = np.zeros(0, int)
        self.most_likely = np.zeros(0, int)
        self._candidates = all_round(np.zeros(0), self._prior)
        self._advanced = np.zeros(flights), np.zeros((2, flights))

    def observe(self, dt: Batch, chord: Batch, z: Batch, sigma: Batch, valid: Batch) -> Batch:
        """Advance time and path, and add the valid ranges. Return True, (B,), for flights with a
        newly closed bin: their search is due."""
        return self._window.add(dt, chord, z, sigma, valid)

    def forget(self) -> None:
        """Discard the prior of drift and airspeed scale."""
        self._prior = self._nothing_known()
        self.remembers = False

    def begin(self, at: Batch, r: Batch) -> None:
        """Start searches of the flights `at`, on circles with the radii r (n,), m."""
        self._carry()
        self.at = np.concatenate([self.at, at])
        self.most_likely = np.concatenate([self.most_likely, np.zeros(at.size, int)])
        both = zip(self._candidates, all_round(r, self._prior), strict=True)
        self._candidates = Candidates(*(np.concatenate(parts) for parts in both))

    def go_on(self, due: Batch, sigma: Batch) -> tuple[Batch, Batch, Batch] | None:
        """Improve the hypotheses of the flights that are due, and end the searches that have a
        unique solution.

        Return the numbers (n,) of the flights whose search ended, their solutions x (5, n) of p, d,
        kappa, and the covariances (5, 5, n); None if no search ended.
        """
        self._carry()
        of = np.flatnonzero(due[self.at])
        if not of.size:
            return None
        at = self.at[of]
        flights = np.arange(of.size)
        bins = self._window.bins(at, sigma)
        filled = self._window.filled(at)
        g = self._candidates.some(of)
        for _ in range(ITERATIONS):
            g = improve(g, bins, self._prior)
        all_ = self._candidates
        all_.x[of], all_.cost[of], all_.damping[of] = g.x, g.cost, g.damping
        best = g.cost.argmin(axis=1)
        better = g.cost[flights, best] < g.cost[flights, self.most_likely[of]] - SWITCH
        self.most_likely[of] = np.where(better, best, self.most_likely[of])
        x = g.x[flights, best]
        cost = g.cost[flights, best]
        # Accept a solution if it is precise, its drift is plausible and no hypothesis at another
        # position fits nearly as well. `scale` (the reduced chi-square) raises covariance and
        # margin if the ranges are noisier than assumed.
        scale = np.maximum(1.0, 2 * cost / np.maximum(filled - UNKNOWNS + 1, 1))
        P = covariance(x[:, None], bins, self._prior)[:, 0] * scale[:, None, None]
        known = np.sqrt(P[:, 0, 0] + P[:, 1, 1]) < CONVERGED * np.hypot(x[:, 0], x[:, 1])
        flyable = np.hypot(x[:, 2], x[:, 3]) < DRIFT_MOST * self._settings.speed
        away = np.hypot(g.x[..., 0] - x[:, None, 0], g.x[..., 1] - x[:, None, 1])
        elsewhere = np.where(
            away > APART * np.hypot(x[:, 0], x[:, 1])[:, None], g.cost, np.inf
        ).min(axis=1)
        alone = elsewhere - cost > MARGIN * scale
        found = known & flyable & alone & (filled >= MIN_BINS)
        if not found.any():
            return None
        stay = np.delete(np.arange(self.at.size), of[found])
        self._candidates = self._candidates.some(stay)
        self.at, self.most_likely = self.at[stay], self.most_likely[stay]
        return at[found], x[found].T, np.moveaxis(P[found], 0, -1)

    def most_likely_states(self) -> Batch:
        """Return the most likely hypothesis of each search, predicted to now, (5, n).

        These hypotheses are unconfirmed: a law may fly them on trial, but must not trust them.
        """
        then, path = self._advanced
        x = self._candidates.x[np.arange(self.at.size), self.most_likely].T
        step = (self._window.path - path)[:, self.at]
        p = x[:2] + x[4] * step + x[2:4] * (self._window.now - then)[self.at]
        return np.concatenate([p, x[2:]])

    def _nothing_known(self) -> Prior:
        return Prior(self._settings.drift_sigma * self._settings.speed, self._settings.scale_sigma)

    def _carry(self) -> None:
        """Predict the hypotheses to now, along the path flown since."""
        (then, before), g = self._advanced, self._candidates
        self._advanced = self._window.now, self._window.path
        dt = (self._window.now - then)[self.at]
        path = (self._window.path - before)[:, self.at]
        x = g.x.copy()
        x[..., 0] += x[..., 4] * path[0][:, None] + x[..., 2] * dt[:, None]
        x[..., 1] += x[..., 4] * path[1][:, None] + x[..., 3] * dt[:, None]
        self._candidates = Candidates(x, g.cost, g.damping)


def all_round(r: Batch, prior: Prior) -> Candidates:
    """Return hypotheses in all directions at ranges r (B,), with the prior's drift and airspeed
    scale."""
    angle = 2 * np.pi * (np.arange(CANDIDATES) + 0.5) / CANDIDATES
    x = np.zeros((r.size, CANDIDATES, UNKNOWNS)) + prior.mean
    x[..., 0], x[..., 1] = r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)
    return Candidates(x, np.full((r.size, CANDIDATES), np.inf), np.ones((r.size, CANDIDATES)))


def improve(g: Candidates, bins: Bins, prior: Prior) -> Candidates:
    """Return the hypotheses after one Levenberg-Marquardt iteration. A step that does not lower the
    cost is undone, and its damping raised."""
    cost, A, b = _normal_equations(g.x, bins, prior)
    damped = A + (g.damping[..., None, None] * np.einsum("...ii->...i", A)[..., None]) * np.eye(
        UNKNOWNS
    )
    x = g.x + np.linalg.solve(damped + 1e-9 * np.eye(UNKNOWNS), b[..., None])[..., 0]
    better = _penalty(_residual(x, bins)[0]) + prior.cost(x)
    pays = better < cost
    damping = np.clip(np.where(pays, g.damping / 5, g.damping * 5), LEAST_DAMPING, MOST_DAMPING)
    return Candidates(np.where(pays[..., None], x, g.x), np.where(pays, better, cost), damping)


def covariance(x: Batch, bins: Bins, prior: Prior) -> Batch:
    """Return the covariance of hypotheses x (B, M, 5) from the curvature of the cost, (B, M, 5,
    5)."""
    A = _normal_equations(x, bins, prior)[1]
    return np.linalg.inv(A + 1e-9 * np.eye(UNKNOWNS))


def _residual(x: Batch, bins: Bins) -> tuple[Batch, Batch, Batch]:
    """Return the normalized residuals (B, M, N) and the two components of the unit vector of p at
    each bin."""
    px = (
        x[..., 0, None]
        - x[..., 4, None] * bins.path[0][:, None]
        - x[..., 2, None] * bins.age[:, None]
    )
    py = (
        x[..., 1, None]
        - x[..., 4, None] * bins.path[1][:, None]
        - x[..., 3, None] * bins.age[:, None]
    )
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
