"""Where every default gain comes from: the mission check, the pilot and the benchmark all ask here.

A gain follows from the circle and from one delay: that of the turn, which a mission states, and that of the range-rate
filter, which follows from the radio's noise and rate. (The heading loop of `drift` and `auto` is tuned in flight, by
the answer that is measured there: see `vector_field.drift_gains`.)
"""

from collections.abc import Callable

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.steady import steady_state
from circnav_mav.guidance.theory import rate_gain, smooth_gain_bound, switching_gain_bound

LEAST = 1.2
"""Default gains stay this many times above the paper's bound."""
SMOOTH_LOOP = 0.35
"""What 2 k r_d V lag is for law 1 at the most; from about .45 on, vehicles limit-cycle."""
BOUNDED_LAG = 0.55
"""Lag of turn and filter, s, that the gain of `bounded` is made for."""


def loop_lag(turn_lag: float, settings: EstimatorSettings, *, r_d: float, sigma: float, period: float) -> float:
    """Delay, s, from a change of the range rate to the vehicle's turn: the turn's own, and that of the filter on ranges
    of noise sigma (m) every `period` (s)."""
    return turn_lag + steady_state(settings, r=r_d, sigma=sigma, period=period).lag


def default_gain(law: str, V: float, r_d: float, lag: float) -> float:
    """Magnitude of a law's gain k at speed V (m/s) on a circle of r_d (m), with so much delay in the loop (s)."""
    return float(_GAINS[law](V, r_d, lag))


def _smooth(V: float, r_d: float, lag: float) -> float:
    """Twice the bound, as in the paper's example, or less where the delay would make the circle oscillate."""
    bound = smooth_gain_bound(r_d)
    return max(LEAST * bound, min(2 * bound, SMOOTH_LOOP / (2 * r_d * V * lag)))


_GAINS: dict[str, Callable[[float, float, float], float]] = {
    "smooth": _smooth,
    "switching": lambda V, r_d, lag: LEAST * switching_gain_bound(V, r_d),  # as in the paper's example
    "bounded": lambda V, r_d, lag: max(0.5 * rate_gain(V, r_d, BOUNDED_LAG), 1.5 / r_d),  # its slope in r is k^2 V
    "relay": lambda V, r_d, lag: 1.33 * V / r_d,
    "pd": rate_gain,
    "pi": rate_gain,
    "feedforward": rate_gain,
    "drift": rate_gain,  # flies feedforward while there is no relative motion to trust
    "auto": rate_gain,
}
