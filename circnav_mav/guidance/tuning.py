"""Where every default gain comes from: the mission check, the pilot and the benchmark all ask here.

A gain follows from the circle and from one delay: that of the turn, which a mission states, and that of the range-rate
filter, which follows from the radio's noise and rate. (The heading loop of `drift` and `auto` is tuned in flight, by
the answer that is measured there: see `vector_field.drift_gains`.)
"""

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import steady_state
from circnav_mav.guidance.laws import LAWS


def loop_lag(turn_lag: float, settings: EstimatorSettings, *, r_d: float, sigma: float, period: float) -> float:
    """Delay, s, from a change of the range rate to the vehicle's turn: the turn's own, and that of the filter on ranges
    of noise sigma (m) every `period` (s)."""
    return turn_lag + steady_state(settings, r=r_d, sigma=sigma, period=period).lag


def default_gain(law: str, V: float, r_d: float, lag: float) -> float:
    """Magnitude of a law's gain k at speed V (m/s) on a circle of r_d (m), with so much delay in the loop (s). The rule
    is the law's own, see `laws`."""
    return float(LAWS[law].default_gain(V, r_d, lag))
