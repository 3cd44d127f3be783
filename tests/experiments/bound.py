"""The posterior Cramer-Rao bound of the range rate: what no estimator of the assumed model can beat.

The information recursion J' = (F J^-1 F^T + Q)^-1 + H^T R^-1 H along the true motion (Tichavsky, Muravchik, Nehorai,
1998) is the covariance recursion of the filter, linearised at the truth instead of at its own mean.
"""

from typing import Any

import numpy as np

from circnav_mav.experiments.batch.estimators import Estimator, Seen, Truth
from circnav_mav.guidance.air_path import chord, wrap
from circnav_mav.guidance.estimators.relative_ekf import DX, GX, KAPPA, STATES, THETA, Hypotheses, Noise, R, predict

Array = Any
START = (4.0, 0.1, 1.0, 1.0, 2.5e-3, 0.0, 0.0, 0.0)
"""Variances at first; forgotten after some tens of seconds."""


class AlongsideBound:
    """An estimator, and beside it the bound (B,) of the standard deviation of r', m/s, as `rate_bound` step by step.

    drift_psd (m^2/s^3), gust (m/s): of the assumed model; range noise white with the sample's sigma.
    """

    def __init__(self, estimator: Estimator, speed: float, flights: int, drift_psd: float, gust: float) -> None:
        self._estimator, self._speed = estimator, speed
        self._noise = Noise(*(np.array([[value]]) for value in (drift_psd, gust, 1.0, 0.0)))
        P = np.zeros((STATES, STATES, 1, flights))
        for i, variance in enumerate(START):
            P[i, i] = variance
        P[GX, GX] = P[GX + 1, GX + 1] = gust**2
        self._P, self._before = P, None
        self.rate_bound: list[Array] = []

    _before: Truth | None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._estimator, name)

    def observe(self, seen: Seen, true: Truth) -> None:
        """As the estimator does, and carry the bound on."""
        if self._before is not None:
            self._step(self._before, true, seen)
        self._before = true
        air = self._speed * np.stack([np.cos(true.psi), np.sin(true.psi)])
        self.rate_bound.append(_rate_sigma(self._P[:, :, 0], true, air))
        self._estimator.observe(seen, true)

    def _step(self, before: Truth, true: Truth, seen: Seen) -> None:
        x = np.zeros((STATES, 1, true.psi.size))
        x[R, 0], x[THETA, 0] = np.hypot(before.p[0], before.p[1]), np.arctan2(before.p[1], before.p[0])
        x[DX : DX + 2, 0], x[KAPPA] = before.d, 1.0
        path = chord(self._speed, before.psi, wrap(true.psi - before.psi), seen.dt)
        h, dt = Hypotheses(x, self._P, np.zeros((1, true.psi.size))), np.full(true.psi.size, seen.dt)
        P = predict(h, self._noise, dt, path, seen.sigma).P
        PH = P[:, R]
        gain = np.where(seen.arrived, PH / (PH[R] + seen.sigma**2), 0.0)
        self._P = P - gain[:, None] * PH[None]


def _rate_sigma(P: Array, true: Truth, air: Array) -> Array:
    """Standard deviation of r' = n.(kappa V u + d + g), (B,), under covariances P (8, 8, B)."""
    n = true.p / np.hypot(true.p[0], true.p[1])
    v = air + true.d
    gradient = np.zeros(P.shape[1:])
    gradient[THETA] = -n[1] * v[0] + n[0] * v[1]
    gradient[DX : DX + 2] = gradient[GX : GX + 2] = n
    gradient[KAPPA] = (n * air).sum(axis=0)
    return np.sqrt(np.einsum("i...,ij...,j...->...", gradient, P, gradient))
