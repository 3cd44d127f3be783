"""What a law flies with where nobody says otherwise: its gain, lowered where turn and filter answer late, and its
estimator."""

from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.theory import rate_gain
from circnav_mav.guidance.types import Orbit

SMOOTH_LOOP = 0.35
"""What 2 k r_d V (turn lag + filter lag) is for a default gain of `smooth`; from about .45 on, flown vehicles
limit-cycle."""
LEAST_GAIN = 1.2
"""Default gains stay this many times above the paper's bound, as in its third example (k = .12 over V/r_d = .1)."""


def default_gain(law_name: str, orbit: Orbit, lag: float) -> float:
    """Magnitude of the law's gain for a loop with so much lag (turn and filter, s), in the law's unit."""
    law, V, r_d = LAWS[law_name], orbit.speed, orbit.radius
    gain, least = law.default_gain(V, r_d), LEAST_GAIN * law.gain_bound(V, r_d)
    if law_name == "smooth":
        return max(least, min(gain, SMOOTH_LOOP / (2 * r_d * V * lag)))
    return max(least, float(rate_gain(V, r_d, lag))) if law.gain_unit == "rad/m" else gain


def default_estimator(law_name: str) -> str:
    """The estimator that a law wants: one that also finds the target, or range and range rate alone."""
    return law_name if law_name in ("auto", "drift") else "kalman"
