"""What the paper proves about its laws: radius reached, gain conditions. SI units, radians."""

from math import pi, sqrt

from circnav_mav.guidance.maths import Number, maximum, minimum


def smooth_gain_bound(r_d: float) -> float:
    """Bound of law 1's gain, 1/m^2: k > 1/(2 r_d^2) converges from every state (theorem `circular`)."""
    return 1 / (2 * r_d**2)


def switching_gain_bound(V: float, r_d: float) -> float:
    """Bound of law 2's gain, rad/s: k > V/r_d converges from every state (theorem `circular-sign-version`)."""
    return V / r_d


def reached_radius(r_d: float, k: float) -> float:
    """Radius r_a that law 1 settles on, m; always above r_d (eq. `r_a`)."""
    return sqrt((r_d**2 + sqrt(r_d**4 + 1 / k**2)) / 2)


def corrected_radius(r_d: float, k: float) -> float:
    """Radius to feed law 1 so that it settles on r_d exactly, m (eq. `tilde_r_d`).

    Raises ValueError unless |k| > 1/(2 r_d^2).
    """
    inside = 1 - 1 / (4 * k**2 * r_d**4)
    if inside <= 0:
        raise ValueError(f"|k| = {abs(k):g} must be above 1/(2 r_d^2) = {smooth_gain_bound(r_d):g}")
    return r_d * sqrt(inside)


def max_range_acceleration(V: Number, max_turn_rate: Number, r: Number) -> Number:
    """Bound of |r''| = |V sin(theta_b) theta_b'| <= V^2/r + V omega_max, m/s^2.

    Nearer than the tightest turn, V/omega_max, the first term is held at its value there.
    """
    return V**2 / maximum(r, V / max_turn_rate) + V * max_turn_rate


def rate_gain(V: Number, r_d: Number, lag: Number) -> Number:
    """Gain k of the range rate, rad/m, that a loop with so much lag (course + filter, s) bears: k V lag = 0.5.

    Above about that value the laws limit-cycle, as flown on real autopilots. No more than 6/r_d, where nothing is won.
    """
    return minimum(0.5 / (V * lag), 6 / r_d)


def tolerated_drift(V: float, r_d: float, max_turn_rate: float, turn_gain: float = 1.0) -> float:
    """Largest drift W, m/s, in which the circle can be held, below V; negative if not even in still air.

    (V + W)^2/(V omega_max) <= r_d: at the most downwind point the ground speed is V + W and the turn of the course
    V/(V + W) times that of the nose. turn_gain: realised over commanded turn rate. Derived; necessary for every law.
    """
    return min(sqrt(r_d * V * max_turn_rate * turn_gain) - V, 0.99 * V)


def settling_time(r: float, V: float, r_d: float, max_turn_rate: float) -> float:
    """Time, s, to the circle from range r in still air at worst: half a turn, then the tangent (inside: outwards).

    Dubins: pi/omega_max + sqrt(r^2 - r_d^2)/V; a prediction for `check`, not a bound.
    """
    way = sqrt(r**2 - r_d**2) if r > r_d else r_d - r
    return pi / max_turn_rate + way / V
