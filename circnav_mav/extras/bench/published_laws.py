"""Four published laws on range and range rate, for comparison, written as user-defined laws
(docs/own-law.md).

Each function here returns, for a circle, a function from an estimate to a turn rate (rad/s,
counter-clockwise positive). e is the radius error r - r_d, V the speed, and k the gain at `lag`,
the delay of the loop in s.
"""

from math import sqrt, tanh

from circnav_mav.guidance.laws import rate_gain
from circnav_mav.guidance.types import Orbit, OwnLaw, RangeEstimate

LAG = 0.55
"""Delay of turn and filter, s, for which the gains are chosen."""


def bounded(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """omega = k [r' + V sqrt(1 - (r_s/r)^2)] outside r_s = sqrt(r_d^2 - 1/k^2), and
    k [r' - V sqrt(1 - (r/r_s)^2)] inside.

    k > 1/r_d, in 1/m. The vehicle settles on the exact radius, and |omega| <= 2 k V.

    Source: Cao, "UAV circumnavigating an unknown target under a GPS-denied environment with
    range-only measurements", Automatica 55 (2015). Inside r_s, the law's two-sided form is used.
    """
    V = orbit.speed
    k = max(0.5 * rate_gain(V, orbit.radius, lag), 1.5 / orbit.radius)
    r_s = sqrt(orbit.radius**2 - 1 / k**2)

    def law(estimate: RangeEstimate) -> float:
        r = max(estimate.r, 0.0)
        if r >= r_s:
            closing = V * sqrt(1 - (r_s / r) ** 2)
        else:
            closing = -V * sqrt(1 - (r / r_s) ** 2)
        return orbit.direction.turn_sign * k * (estimate.r_dot + closing)

    return law


def relay(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """omega = k sat((r' + chi)/phi) + V/r_d with chi = clip(V e/r_d, -V/2, V/2): sliding on
    r' = -chi.

    k > V/r_d, rad/s. The boundary layer phi (m/s) avoids chattering: it limits the slope k/phi to
    `rate_gain`. Suitable for a moving target. Source: Matveev, Teimoori, Savkin, "Range-only
    measurements based target following for wheeled mobile robots", Automatica 47 (2011).
    """
    V = orbit.speed
    r_d = orbit.radius
    k = 1.33 * V / r_d
    phi = k / rate_gain(V, r_d, lag)

    def law(estimate: RangeEstimate) -> float:
        chi = min(max(V / r_d * (estimate.r - r_d), -0.5 * V), 0.5 * V)
        slide = min(max((estimate.r_dot + chi) / phi, -1.0), 1.0)
        return orbit.direction.turn_sign * (k * slide + V / r_d)

    return law


def pd(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """omega = V/r_d + k_p sat(e) + k r'. k in rad/m; k_p = k^2 V/4, for a damping of 1.

    Source: Dong, You, Xie, Hu, coordinate-free circumnavigation with range-based PD control. e is
    limited to +-e_max, with k_p e_max/k = V/2. Far out, the approach speed -r' settles to
    k_p e_max/k + V/(r_d k).
    """
    V = orbit.speed
    r_d = orbit.radius
    k = rate_gain(V, r_d, lag)
    k_p = k**2 * V / 4
    e_max = 0.5 * V * k / k_p

    def law(estimate: RangeEstimate) -> float:
        e = min(max(estimate.r - r_d, -e_max), e_max)
        return orbit.direction.turn_sign * (V / r_d + k_p * e + k * estimate.r_dot)

    return law


def pi(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """s = r' + c tanh(e/delta); omega = k s + k_i int s. A law with a state: the integral, m.

    c = V/2, delta = r_d/2, and k_i = k V/r_d, with which the integral acts ten times slower than
    the turn. The steady state of the integral is V/(r_d k_i). The limit of the integral is twice
    that value, which prevents windup while the turn saturates.

    Source: Dong, You, Wang, isoline tracking with PI control, for any field that decreases with
    range.
    """
    V = orbit.speed
    r_d = orbit.radius
    k = rate_gain(V, r_d, lag)
    k_i = k * V / r_d
    integral = 0.0
    before: float | None = None

    def law(estimate: RangeEstimate) -> float:
        nonlocal integral, before
        s = estimate.r_dot + 0.5 * V * tanh((estimate.r - r_d) / (0.5 * r_d))
        dt = 0.0 if before is None else estimate.time - before
        before = estimate.time
        integral = min(max(integral + s * dt, 0.0), 2 * V / (r_d * k_i))
        return orbit.direction.turn_sign * (k * s + k_i * integral)

    return law
