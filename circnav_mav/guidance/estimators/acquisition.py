"""Acquisition of the target: hypotheses in all directions, until only one hypothesis fits the
ranges.

Kalman filters started on a circle of bearings are overconfident: each filter linearizes along its
own tangent, although the target may be in any direction. The search instead stores a window of
ranges and the flown air path. It improves M hypotheses of (p, d, kappa): position relative to the
target, drift, airspeed scale. The method is Levenberg-Marquardt on all bins. Hypotheses that fit
the data equally well remain separate. Source: multi-start nonlinear least squares, Nocedal and
Wright (2006), ch. 10.

Arrays have the axes M hypotheses, N bins. Frame and symbols as in `relative_ekf`.
"""

from dataclasses import dataclass
from math import atan2, hypot, inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_bins import Bins, RangeWindow
from circnav_mav.guidance.estimators.relative_ekf import STATES
from circnav_mav.guidance.maths import Vector

Array = NDArray[np.float64]
UNKNOWNS = 5
"""Number of unknowns of a hypothesis: position (2), drift (2) and airspeed scale."""
CANDIDATES = 32
"""Initial hypotheses of a search, equally spaced in bearing on a circle with the radius of the
first range."""
MOST_DAMPING = 1e6
"""Upper bound of the Levenberg-Marquardt damping: the step is almost 0."""
LEAST_DAMPING = 1e-4
"""Lower bound of the Levenberg-Marquardt damping: the step is almost a Gauss-Newton step."""
ROBUST = 4.0
"""Scale of the robust (Cauchy) weight, in standard deviations of a residual. A residual of this
size has half the weight of a small residual."""
APART = 0.25
"""Distance, as a share of the range, above which two hypotheses are different solutions."""
DRIFT_MOST = 0.85
"""Largest plausible drift, as a share of V. A solution with a larger drift is rejected."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Prior of drift and airspeed scale.

    drift: scale of the drift's distribution about (dx, dy), m/s.
    kappa: standard deviation of the airspeed scale.
    dx, dy: most probable drift, m/s.
    scale: mean of the airspeed scale.

    The drift has a heavy-tailed (Cauchy) distribution, because most targets are stationary, but a
    moving target may be fast. With a normal distribution, the hypotheses for a stationary target
    had several m/s of drift.
    """

    drift: float
    kappa: float
    dx: float = 0.0
    dy: float = 0.0
    scale: float = 1.0

    @property
    def mean(self) -> Array:
        return np.array([0.0, 0.0, self.dx, self.dy, self.scale])

    def information(self, x: Array) -> Array:
        """Return the inverse variances of the prior for hypotheses x (M, 5), with the shape of x.

        Position: 0, because the prior has no position. Drift: the inverse variance of the normal
        distribution whose log density has the same slope at x as that of the Cauchy distribution.
        Airspeed scale: kappa^-2.
        """
        of_drift = 2 / (self.drift**2 + self._apart(x))
        none = np.zeros_like(of_drift)
        return np.stack([none, none, of_drift, of_drift, none + self.kappa**-2], axis=-1)

    def cost(self, x: Array) -> Array:
        """Return the negative log prior of hypotheses x (M, 5)."""
        return np.asarray(
            np.log1p(self._apart(x) / self.drift**2)
            + 0.5 * ((x[..., 4] - self.scale) / self.kappa) ** 2
        )

    def _apart(self, x: Array) -> Array:
        return (x[..., 2] - self.dx) ** 2 + (x[..., 3] - self.dy) ** 2


class Candidates(NamedTuple):
    """M hypotheses.

    x: current p, d, kappa, (M, 5).
    cost: negative log likelihood, (M,).
    damping: damping of the next Levenberg-Marquardt iteration, (M,).
    """

    x: Array
    cost: Array
    damping: Array


class Solution(NamedTuple):
    """Result of a search: p, d, kappa in x (5,), and their covariance P (5, 5)."""

    x: Array
    P: Array


class Estimate(NamedTuple):
    """Relative motion at the newest range.

    mean (12,), covariance (12, 12): state of `relative_ekf`.
    hypothesis: number of the most likely hypothesis of a search, else None. A hypothesis is
        unconfirmed: a law may fly it on trial, but must not trust it.
    spread: standard deviation of the position as a share of the range; infinite during a search.
    trusted: True if the estimate may steer.
    drift_psd, gust, acceleration_weight: weighted averages of the noise models, as in `Noise`.
    """

    mean: Array
    covariance: Array
    hypothesis: int | None = None
    spread: float = inf
    trusted: bool = False
    drift_psd: float = 0.0
    gust: float = 0.0
    acceleration_weight: float = 0.0

    @property
    def finite(self) -> bool:
        """True if mean and covariance contain only finite numbers."""
        return isfinite(self.mean.sum()) and isfinite(self.covariance.sum())


class Acquisition:
    """Search for the target. The window also stores ranges while no search is running.

    estimate: most likely hypothesis of the search; None without a search.
    due: standard deviation of the ranges, m, if an iteration of the search is due.
    remembers: True if the search has a prior of the drift.
    """

    def __init__(self, settings: EstimatorSettings, known: Prior | None = None) -> None:
        """known: prior of drift and airspeed scale."""
        self._settings = settings
        self._window = RangeWindow(settings.speed)
        self._prior = known or self._unknown()
        self.remembers = known is not None
        self.estimate: Estimate | None = None
        self.due: float | None = None
        self._most_likely = 0
        self._candidates: Candidates
        """Hypotheses of the present search, predicted to the time and path in `_carried`."""
        self._carried: tuple[float, Vector] = (0.0, (0.0, 0.0))

    def observe(self, dt: float, chord: Vector, z: float | None, sigma: float) -> None:
        """Advance time by dt (s) and path by chord (m), and add the range z (m) unless it is None.
        A closed bin makes an iteration of the search due."""
        closed = self._window.add(dt, chord, z, sigma)
        if self.estimate is not None:
            self.due = sigma if closed else None
            self._update()

    def forget(self) -> None:
        """Discard the prior of drift and airspeed scale."""
        self._prior = self._unknown()
        self.remembers = False

    def begin(self, r: float) -> None:
        """Start a search on the circle with the radius r, m."""
        self._candidates = on_circle(r, self._prior)
        self._carried = (self._window.now, self._window.path)
        self._most_likely = 0
        self._update()

    def search(self) -> Solution | None:
        """Run an iteration of the search if one is due. A unique solution ends the search."""
        if self.due is None:
            return None
        sigma = self.due
        self.due = None
        self._carry()
        bins = self._window.bins(sigma)
        g = self._candidates
        # 2: least-squares iterations for each closed bin.
        for _ in range(2):
            g = improve(g, bins, self._prior)
        self._candidates = g
        best = int(g.cost.argmin())
        # 0.5: advantage in log likelihood with which another hypothesis replaces the most likely
        # hypothesis.
        if g.cost[best] < g.cost[self._most_likely] - 0.5:
            self._most_likely = best
        solution = self._solution(best, bins)
        if solution is None:
            self._update()
        else:
            self.estimate = None
        return solution

    def _solution(self, best: int, bins: Bins) -> Solution | None:
        """Return the best hypothesis if it is precise, its drift is plausible and no hypothesis at
        another position fits nearly as well."""
        g = self._candidates
        cost = float(g.cost[best])
        filled = bins.z.size
        if filled < 2 * UNKNOWNS:
            return None
        # If the ranges are noisier than assumed, `scale` (the reduced chi-square) increases the
        # covariance and the required advantage over other positions.
        scale = max(1.0, 2 * cost / (filled - UNKNOWNS + 1))
        x = g.x[best]
        P = covariance(x, bins, self._prior) * scale
        r = hypot(x[0], x[1])
        # 0.12: largest standard deviation of the position of an accepted solution, as a share of
        # the range.
        precise = sqrt(P[0, 0] + P[1, 1]) < 0.12 * r
        plausible = hypot(x[2], x[3]) < DRIFT_MOST * self._settings.speed
        elsewhere = np.hypot(g.x[:, 0] - x[0], g.x[:, 1] - x[1]) > APART * r
        # 5.0: least advantage in log likelihood of an accepted solution over every other position.
        unique = g.cost[elsewhere].min(initial=np.inf) - cost > 5.0 * scale
        return Solution(x, P) if precise and plausible and unique else None

    def _update(self) -> None:
        """Store the most likely hypothesis, predicted to now, as the estimate."""
        self._carry()
        x = self._candidates.x[self._most_likely]
        mean = np.zeros(STATES)
        mean[:2] = hypot(x[0], x[1]), atan2(x[1], x[0])
        mean[2:UNKNOWNS] = x[2:]
        self.estimate = Estimate(mean, np.zeros((STATES, STATES)), self._most_likely)

    def _unknown(self) -> Prior:
        return Prior(self._settings.drift_sigma * self._settings.speed, self._settings.scale_sigma)

    def _carry(self) -> None:
        """Predict the hypotheses to now, along the path flown since the last prediction."""
        then, before = self._carried
        now = self._window.now
        path = self._window.path
        self._carried = (now, path)
        x = self._candidates.x.copy()
        x[:, 0] += x[:, 4] * (path[0] - before[0]) + x[:, 2] * (now - then)
        x[:, 1] += x[:, 4] * (path[1] - before[1]) + x[:, 3] * (now - then)
        self._candidates = self._candidates._replace(x=x)


def on_circle(r: float, prior: Prior) -> Candidates:
    """Return hypotheses in all directions at range r, with the prior's drift and airspeed scale."""
    angle = 2 * np.pi * (np.arange(CANDIDATES) + 0.5) / CANDIDATES
    x = np.tile(prior.mean, (CANDIDATES, 1))
    x[:, 0] = r * np.cos(angle)
    x[:, 1] = r * np.sin(angle)
    return Candidates(x, np.full(CANDIDATES, np.inf), np.ones(CANDIDATES))


def improve(g: Candidates, bins: Bins, prior: Prior) -> Candidates:
    """Return the hypotheses after one Levenberg-Marquardt iteration. If a step does not lower the
    cost of a hypothesis, the step is undone and the damping increased."""
    cost, A, b = _normal_equations(g.x, bins, prior)
    diagonal = np.einsum("mii->mi", A)
    damped = A + (g.damping[:, None] * diagonal + 1e-9)[:, None] * np.eye(UNKNOWNS)
    x = g.x + np.linalg.solve(damped, b[..., None])[..., 0]
    improved_cost = _penalty(_residual(x, bins)[0]) + prior.cost(x)
    improves = improved_cost < cost
    damping = np.clip(g.damping * np.where(improves, 0.2, 5.0), LEAST_DAMPING, MOST_DAMPING)
    return Candidates(
        np.where(improves[:, None], x, g.x), np.where(improves, improved_cost, cost), damping
    )


def covariance(x: Array, bins: Bins, prior: Prior) -> Array:
    """Return the covariance of one hypothesis x (5,) from the curvature of the cost, (5, 5)."""
    A = _normal_equations(x[None], bins, prior)[1][0]
    return np.asarray(np.linalg.inv(A + 1e-9 * np.eye(UNKNOWNS)))


def _residual(x: Array, bins: Bins) -> tuple[Array, Array, Array]:
    """Return the normalized residuals (M, N) and the two components of the unit vector of p at each
    bin."""
    px = x[:, [0]] - x[:, [4]] * bins.path[0] - x[:, [2]] * bins.age
    py = x[:, [1]] - x[:, [4]] * bins.path[1] - x[:, [3]] * bins.age
    r = np.sqrt(px * px + py * py) + 1e-6
    return (bins.z - r) / np.sqrt(bins.variance), px / r, py / r


def _penalty(residual: Array) -> Array:
    return np.asarray((0.5 * ROBUST**2 * np.log1p((residual / ROBUST) ** 2)).sum(axis=-1))


def _normal_equations(x: Array, bins: Bins, prior: Prior) -> tuple[Array, Array, Array]:
    """Return the cost (M,) of hypotheses x (M, 5), and the matrix (M, 5, 5) and right side (M, 5)
    of the normal equations of a Gauss-Newton step."""
    residual, nx, ny = _residual(x, bins)
    weight = 1 / (1 + (residual / ROBUST) ** 2)
    J = np.empty((*residual.shape, UNKNOWNS))
    J[..., 0] = nx
    J[..., 1] = ny
    J[..., 2] = -nx * bins.age
    J[..., 3] = -ny * bins.age
    J[..., 4] = -(nx * bins.path[0] + ny * bins.path[1])
    J /= np.sqrt(bins.variance)[:, None]
    JT = np.swapaxes(J * weight[..., None], -1, -2)
    information = prior.information(x)
    A = JT @ J + information[..., None] * np.eye(UNKNOWNS)
    b = (JT @ residual[..., None])[..., 0] - information * (x - prior.mean)
    return _penalty(residual) + prior.cost(x), A, b
