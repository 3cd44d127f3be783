"""What the `kalman` estimator settles to: its noise and its lag, for checks before the flight."""

from dataclasses import dataclass
from functools import lru_cache

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.theory import max_range_acceleration

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


@lru_cache(maxsize=1024)
def steady_state(settings: EstimatorSettings, *, r: float, sigma: float, period: float) -> SteadyState:
    """Covariance of the constant-velocity filter after many samples of noise sigma (m) every `period` (s) at range r.

    The lag is that of an alpha-beta filter under constant acceleration, T (2 alpha - beta)/(2 beta).
    """
    q = acceleration_variance(settings, r)
    q_rr, q_rv, q_vv = q * period**4 / 4, q * period**3 / 2, q * period**2
    rr, rv, vv = sigma**2, 0.0, settings.speed**2 / 2
    alpha = beta = 0.0
    for _ in range(STEPS):
        rr, rv, vv = rr + 2 * period * rv + period**2 * vv + q_rr, rv + period * vv + q_rv, vv + q_vv
        alpha, beta = rr / (rr + sigma**2), rv / (rr + sigma**2)
        rr, rv, vv = (1 - alpha) * rr, (1 - alpha) * rv, vv - beta * rv
    return SteadyState(vv**0.5, period * (2 * alpha - beta * period) / (2 * beta * period))
