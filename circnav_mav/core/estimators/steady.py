"""What the `kalman` estimator settles to: its noise and its lag, for checks before the flight."""

from dataclasses import dataclass

import numpy as np

from circnav_mav.core.estimators.interface import EstimatorSettings
from circnav_mav.core.theory import max_range_acceleration

ACCELERATION_SIGMAS = 3.0
"""The physical bound on |r''| is taken as this many standard deviations of the process noise."""
STEPS = 500


def acceleration_variance(settings: EstimatorSettings, r: float) -> float:
    """Variance of the unknown acceleration at range r (m), m^2/s^4."""
    return (max_range_acceleration(settings.speed, settings.max_turn_rate, r) / ACCELERATION_SIGMAS) ** 2


@dataclass(frozen=True, slots=True)
class SteadyState:
    """r_dot_sigma: standard deviation of the estimated range rate, m/s. lag: its delay under acceleration, s."""

    r_dot_sigma: float
    lag: float


def steady_state(settings: EstimatorSettings, *, r: float, sigma: float, period: float) -> SteadyState:
    """Covariance of the constant-velocity filter after many samples of noise sigma (m) every `period` (s) at range r.

    The lag is that of an alpha-beta filter under constant acceleration, T (2 alpha - beta)/(2 beta).
    """
    F = np.array([[1.0, period], [0.0, 1.0]])
    step = np.array([period**2 / 2, period])
    Q = acceleration_variance(settings, r) * np.outer(step, step)
    P = np.diag([sigma**2, settings.speed**2 / 2])
    K = np.zeros(2)
    for _ in range(STEPS):
        P = F @ P @ F.T + Q
        K = P[:, 0] / (P[0, 0] + sigma**2)
        P = P - np.outer(K, P[0])
    alpha, beta = float(K[0]), float(K[1]) * period
    return SteadyState(float(P[1, 1]) ** 0.5, period * (2 * alpha - beta) / (2 * beta))
