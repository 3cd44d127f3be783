"""What the paper proves about its laws: radius reached, gain conditions, kinematics. SI units, radians."""

from math import cos, sin, sqrt


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


def range_rate(V: float, theta_b: float) -> float:
    """r' = -V cos(theta_b), m/s; theta_b from the line of sight to the heading, counter-clockwise (eq. `rdot`)."""
    return -V * cos(theta_b)


def bearing_rate(V: float, r: float, theta_b: float, omega: float) -> float:
    """theta_b' = omega + V sin(theta_b)/r, rad/s (eq. `thetadot`)."""
    return omega + V * sin(theta_b) / r


def max_range_acceleration(V: float, max_turn_rate: float, r: float) -> float:
    """Bound of |r''| = |V sin(theta_b) theta_b'| <= V^2/r + V omega_max, m/s^2.

    Nearer than the tightest turn, V/omega_max, the first term is held at its value there.
    """
    return V**2 / max(r, V / max_turn_rate) + V * max_turn_rate
