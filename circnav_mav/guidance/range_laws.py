"""Laws on range and range rate beside the paper's, each with its source, its condition and its rule for gains.

Written for a counter-clockwise orbit: omega > 0 turns left. For the clockwise one multiply by -1: range and range rate
do not change under reflection. r (m), r_dot (m/s): scalars or arrays; the turn rate is in rad/s, before any limit.
e = r - r_d. chi(e), where it appears, is the closing speed asked for; it never exceeds v*, see `closing_speed`.
xp: numpy, or `floats` for one flight.
"""

from types import ModuleType

import numpy as np

from circnav_mav.guidance.floats import Number

SHARE_OF_MARGIN = 0.8
"""v* <= this times (V - W): a faster approach against the wind W cannot be flown, and asking for it turns for ever."""


def closing_speed(V: Number, W: Number, wish: Number, xp: ModuleType = np) -> Number:
    """v*, m/s: the wish, cut to what is flyable in wind W on every bearing."""
    cut: Number = xp.minimum(wish * V, SHARE_OF_MARGIN * (V - W))
    return cut


def bounded(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np) -> Number:
    """omega = k [r' + V sqrt(1 - (r_s/r)^2)] outside r_s = sqrt(r_d^2 - 1/k^2), k [r' - V sqrt(1 - (r/r_s)^2)] inside.

    k > 1/r_d, in 1/m; exact radius, |omega| <= 2 k V. Source: Cao, "UAV circumnavigating an unknown target under a
    GPS-denied environment with range-only measurements", Automatica 55 (2015); inside in its two-sided form.
    A smaller r_d, as a trim can make it, counts as 1/k, the smallest circle that this k flies (r_s = 0).
    """
    r_s = xp.sqrt(xp.maximum(r_d**2 - 1 / k**2, 1e-12))  # not 0, by which the inside divides
    outside = V * xp.sqrt(xp.maximum(1 - (r_s / xp.maximum(r, 1e-6)) ** 2, 0.0))
    inside = V * xp.sqrt(xp.maximum(1 - (r / r_s) ** 2, 0.0))
    turn: Number = k * (r_dot + xp.where(r >= r_s, outside, -inside))
    return turn


def relay(
    r: Number, r_dot: Number, *, V: Number, r_d: Number, w: Number, gamma: Number, v_star: Number, phi: Number,
    xp: ModuleType = np,
) -> Number:  # fmt: skip
    """omega = w sat((r' + chi)/phi) + V/r_d with chi = clip(gamma e, -v*, v*): sliding on r' = -chi.

    w > V/r_d, rad/s; v* < V - W; phi > 0, m/s, is the boundary layer, without which it chatters. Copes with a moving
    target. Source: Matveev, Teimoori, Savkin, "Range-only measurements based target following for wheeled mobile
    robots", Automatica 47 (2011).
    """
    chi = xp.clip(gamma * (r - r_d), -v_star, v_star)
    turn: Number = w * xp.clip((r_dot + chi) / phi, -1.0, 1.0) + V / r_d
    return turn


def pd(
    r: Number, r_dot: Number, *, V: Number, r_d: Number, k_p: Number, k_d: Number, e_max: Number, xp: ModuleType = np
) -> Number:
    """omega = V/r_d + k_p sat(e) + k_d r', e cut to +-e_max. k_p in rad/(s m), k_d in rad/m.

    Source: Dong, You, Xie, Hu, coordinate-free circumnavigation with range-based PD control. Condition (closing speed
    asked for far out): k_p e_max/k_d + V/(r_d k_d) is what r' settles to, so e_max <= (k_d v* - V/r_d)/k_p.
    """
    turn: Number = V / r_d + k_p * xp.clip(r - r_d, -e_max, e_max) + k_d * r_dot
    return turn


def pi(
    r: Number, r_dot: Number, memory: Number, dt: Number, *, r_d: Number, k_p: Number, k_i: Number, c: Number,
    delta: Number, I_max: Number, xp: ModuleType = np,
) -> tuple[Number, Number]:  # fmt: skip
    """s = r' + c tanh(e/delta); omega = k_p s + k_i int s. Memory (the integral, m) in, turn rate and memory out.

    c < V - W, m/s; the integral comes to rest at V/(r_d k_i) by itself and is held within 0..I_max, so that it cannot
    wind up while the turn saturates. Source: Dong, You, Wang, isoline tracking with PI control: any field that falls
    with range will do.
    """
    s = r_dot + c * xp.tanh((r - r_d) / delta)
    memory = xp.clip(memory + s * dt, 0.0, I_max)
    return k_p * s + k_i * memory, memory


def feedforward(
    r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, gamma: Number, v_star: Number, r_floor: Number,
    xp: ModuleType = np,
) -> Number:  # fmt: skip
    """omega = sqrt(V^2 - r'^2)/max(r, r_floor) + k (r' + chi), chi = v* tanh(gamma e/v*). k in rad/m, gamma in 1/s.

    The first term is the turn of the circle through the present point, so the radius has no bias for any k. Condition:
    gamma <= k V/4 (damping at least 1) and k V (course lag + filter lag) < about .5. Derived for this product.
    """
    chi = v_star * xp.tanh(gamma * (r - r_d) / v_star)
    turn: Number = xp.sqrt(xp.maximum(V**2 - r_dot**2, 0.0)) / xp.maximum(r, r_floor) + k * (r_dot + chi)
    return turn
