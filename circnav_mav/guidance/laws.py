"""Guidance laws: one function per equation, their proved properties, and the table of laws for
missions.

Every law takes range r (m) and range rate r_dot (m/s), as floats or as arrays of one shape. It
returns the turn rate in rad/s, counter-clockwise positive. The sign of the gain k chooses the sense
of rotation: k > 0 clockwise, k < 0 counter-clockwise (the paper's remark after its second theorem).
A law does not apply the vehicle's limits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import wraps

import numpy as np

from circnav_mav.guidance.maths import (
    Number,
    arcsin,
    clip,
    cos,
    magnitude,
    maximum,
    minimum,
    sign,
    sqrt,
    tanh,
    where,
)

LEAST = 1.2
"""Least ratio of a default gain to the paper's bound."""
SMOOTH_LOOP = 0.35
"""Largest loop gain 2 k r_d V lag of law 1. From about 0.45 on, vehicles have limit cycles."""
LOOP_LAG = 0.55
"""Design lag of turn and filter, s, for the gain of `bounded` and the boundary layer of `relay`."""
LawFunction = Callable[..., Number]
"""The equation of a law: (r, r_dot, *, V, r_d, k) in the paper's symbols -> turn rate."""


class Kind(Enum):
    """Inputs of a law beside range and range rate."""

    RANGE = "nothing"
    MEMORY = "its own integral"
    RELATIVE = "position relative to the target and drift"
    AUTO = "nothing, but uses the relative motion as soon as it can be trusted"


def smooth_gain_bound(r_d: float) -> float:
    """Bound of law 1's gain, 1/m^2: the law converges from every state for k > 1/(2 r_d^2) (theorem
    `circular`)."""
    return 1 / (2 * r_d**2)


def switching_gain_bound(V: float, r_d: float) -> float:
    """Bound of law 2's gain, rad/s: the law converges from every state for k > V/r_d (theorem
    `circular-sign-version`)."""
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
    """Return the bound of |r''| = |V sin(theta_b) theta_b'| <= V^2/r + V omega_max, m/s^2.

    theta_b: bearing of the target from the heading. At ranges below V/omega_max, the radius of the
    tightest turn, the first term keeps its value at that radius.
    """
    return V**2 / maximum(r, V / max_turn_rate) + V * max_turn_rate


def rate_gain(V: Number, r_d: Number, lag: Number) -> Number:
    """Return the largest gain k on the range rate, rad/m, for a loop with this lag (course +
    filter, s): k V lag = 0.5.

    Above about 0.5 the laws have limit cycles, as flown on real autopilots. Above 6/r_d a gain has
    no benefit.
    """
    return minimum(0.5 / (V * lag), 6 / r_d)


def tolerated_drift(V: float, r_d: float, max_turn_rate: float) -> float:
    """Return the largest drift W (m/s, below V) in which the circle can be held; negative if not
    even in still air.

    (V + W)^2/(V omega_max) <= r_d: at the most downwind point the ground speed is V + W, and the
    turn of the course is V/(V + W) times that of the nose. max_turn_rate: reached by the vehicle,
    rad/s. This condition is derived, and is necessary for every law.
    """
    return min(sqrt(r_d * V * max_turn_rate) - V, 0.99 * V)


def settling_time(r: float, V: float, r_d: float, max_turn_rate: float) -> float:
    """Return the worst-case time, s, to the circle from range r (m) in still air.

    Dubins path: half a turn, then the tangent to the circle: pi/omega_max + sqrt(r^2 - r_d^2)/V.
    From inside, the straight way is r_d - r. A prediction for `circnav check`, not a bound.
    """
    way = sqrt(r**2 - r_d**2) if r > r_d else r_d - r
    return np.pi / max_turn_rate + way / V


def smooth(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """Law 1 of the paper, smooth and unsaturated (eq. `omega`), k in 1/m^2:
    omega = k [2 r V cos(pi - asin(r_d/r)) - 2 r r_dot] where r >= r_d, else 0."""
    return where(r >= r_d, k * (2 * r * _tangent_rate(r, V, r_d) - 2 * r * r_dot), 0.0)


def switching(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """Law 2 of the paper, switching and saturated (eq. `omega-sign-version`), k in rad/s:
    omega = k sign(V cos(pi - asin(r_d/r)) - r_dot) where r >= r_d, else 0."""
    return where(r >= r_d, k * sign(_tangent_rate(r, V, r_d) - r_dot), 0.0)


def _tangent_rate(r: Number, V: Number, r_d: Number) -> Number:
    """Return the range rate on a course to the tangent point of the circle, m/s. Not used inside
    the circle."""
    return V * cos(np.pi - arcsin(minimum(r_d / maximum(r, 1e-9), 1.0)))


@dataclass(frozen=True, slots=True)
class Law:
    """A law and its properties for missions and their checks.

    default_gain: (V, r_d, lag of the loop in s) -> magnitude of k. gain_bound: (V, r_d) -> bound
    that the magnitude of k must exceed. reached_radius: (V, r_d, k) -> radius flown when fed r_d.
    fed_radius: (V, r_d, k) -> radius to feed so that r_d is flown.
    """

    name: str
    function: LawFunction
    gain_unit: str
    gain_condition: str
    default_gain: Callable[[float, float, float], Number] = rate_gain
    gain_bound: Callable[[float, float], float] = lambda V, r_d: 0.0
    reached_radius: Callable[[float, float, float], float] = lambda V, r_d, k: r_d
    fed_radius: Callable[[float, float, float], float] = lambda V, r_d, k: r_d
    switches: bool = False
    kind: Kind = Kind.RANGE

    @property
    def flies_relative_motion(self) -> bool:
        """True if the law uses the position relative to the target as soon as it is trusted."""
        return self.kind in (Kind.RELATIVE, Kind.AUTO)


def counterclockwise(law: LawFunction) -> LawFunction:
    """Extend a law written for k > 0 and a counter-clockwise orbit (omega > 0 turns left) to both
    senses. Range and range rate do not change under reflection."""

    @wraps(law)
    def either(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
        return -sign(k) * law(r, r_dot, V=V, r_d=r_d, k=magnitude(k))

    return either


@counterclockwise
def bounded(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = k [r' + V sqrt(1 - (r_s/r)^2)] outside r_s = sqrt(r_d^2 - 1/k^2), k [r' - V sqrt(1 -
    (r/r_s)^2)] inside.

    k > 1/r_d, in 1/m; exact radius, |omega| <= 2 k V. Source: Cao, "UAV circumnavigating an unknown
    target under a GPS-denied environment with range-only measurements", Automatica 55 (2015);
    inside r_s, the law's two-sided form. A trim can make r_d < 1/k. Then r_s = 0 applies, and the
    law flies its smallest circle, of radius 1/k.
    """
    r_s = sqrt(maximum(r_d**2 - 1 / k**2, 1e-12))  # above 0: a divisor below
    outside = V * sqrt(maximum(1 - (r_s / maximum(r, 1e-6)) ** 2, 0.0))
    inside = V * sqrt(maximum(1 - (r / r_s) ** 2, 0.0))
    return k * (r_dot + where(r >= r_s, outside, -inside))


@counterclockwise
def relay(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = k sat((r' + chi)/phi) + V/r_d with chi = clip(V e/r_d, -V/2, V/2): sliding on r' =
    -chi. e = r - r_d.

    k > V/r_d, rad/s. The boundary layer phi (m/s) avoids chattering: it limits the slope k/phi to
    `rate_gain`. Suitable for a moving target. Source: Matveev, Teimoori, Savkin, "Range-only
    measurements based target following for wheeled mobile robots", Automatica 47 (2011).
    """
    chi = clip(V / r_d * (r - r_d), -0.5 * V, 0.5 * V)
    phi = k / rate_gain(V, r_d, LOOP_LAG)
    return k * clip((r_dot + chi) / phi, -1.0, 1.0) + V / r_d


@counterclockwise
def pd(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = V/r_d + k_p sat(e) + k r'. k in rad/m; k_p = k^2 V/4, for a damping of 1.

    Source: Dong, You, Xie, Hu, coordinate-free circumnavigation with range-based PD control. e = r
    - r_d is limited to +-e_max, with k_p e_max/k = V/2. Far out, the approach speed -r' settles to
    k_p e_max/k + V/(r_d k).
    """
    k_p = k**2 * V / 4
    e_max = k * 0.5 * V / k_p
    return V / r_d + k_p * clip(r - r_d, -e_max, e_max) + k * r_dot


@counterclockwise
def feedforward(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = sqrt(V^2 - r'^2)/max(r, 0.43 r_d) + k (r' + chi), chi = v* tanh(gamma e/v*), e = r -
    r_d.

    k in rad/m. The first term is the turn of the circle through the present point, so the radius
    has no bias for any k. With v* = 0.55 V the approach is flyable in a wind of 0.3 V. gamma = k
    V/6; condition: gamma <= k V/4 (damping at least 1) and k V (course lag + filter lag) below
    about 0.5. Derived for this product.
    """
    gamma = k * V / 6
    v_star = 0.55 * V
    chi = v_star * tanh(gamma * (r - r_d) / v_star)
    return sqrt(maximum(V**2 - r_dot**2, 0.0)) / maximum(r, 0.43 * r_d) + k * (r_dot + chi)


def pi(
    r: Number, r_dot: Number, memory: Number, dt: Number, *, V: Number, r_d: Number, k: Number
) -> tuple[Number, Number]:
    """s = r' + c tanh(e/delta); omega = |k| s + k_i int s. Memory (the integral, m) in, turn rate
    and memory out.

    e = r - r_d; c = V/2; delta = r_d/2; k_i = |k| V/r_d: it acts ten times slower than the turn.
    The steady state of the integral is V/(r_d k_i). Its limit is twice that value, which prevents
    windup while the turn saturates. Source: Dong, You, Wang, isoline tracking with PI control, for
    any field that decreases with range.
    """
    k_i = magnitude(k) * V / r_d
    s = r_dot + 0.5 * V * tanh((r - r_d) / (0.5 * r_d))
    memory = clip(memory + s * dt, 0.0, 2 * V / (r_d * k_i))
    return -sign(k) * (magnitude(k) * s + k_i * memory), memory


def _smooth_gain(V: float, r_d: float, lag: float) -> float:
    """Return twice the bound, as in the paper's example, or less if the loop would oscillate with
    this lag (s)."""
    bound = smooth_gain_bound(r_d)
    return max(LEAST * bound, min(2 * bound, SMOOTH_LOOP / (2 * r_d * V * lag)))


LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        Law(
            "smooth",
            smooth,
            "1/m^2",
            "k > 1/(2 r_d^2)",
            _smooth_gain,
            gain_bound=lambda V, r_d: smooth_gain_bound(r_d),
            reached_radius=lambda V, r_d, k: reached_radius(r_d, k),
            fed_radius=lambda V, r_d, k: corrected_radius(r_d, k),
        ),
        Law(
            "switching",
            switching,
            "rad/s",
            "k > V/r_d",
            lambda V, r_d, lag: LEAST * switching_gain_bound(V, r_d),  # as in the paper's example
            gain_bound=switching_gain_bound,
            switches=True,
        ),
        Law(
            "bounded",
            bounded,
            "1/m",
            "k > 1/r_d",
            lambda V, r_d, lag: max(
                0.5 * rate_gain(V, r_d, LOOP_LAG), 1.5 / r_d
            ),  # the slope in r is k^2 V
            gain_bound=lambda V, r_d: 1 / r_d,
        ),
        Law(
            "relay",
            relay,
            "rad/s",
            "k > V/r_d",
            lambda V, r_d, lag: 1.33 * V / r_d,
            gain_bound=switching_gain_bound,
        ),
        Law("pd", pd, "rad/m", "k > 0"),
        Law("pi", feedforward, "rad/m", "k > 0", kind=Kind.MEMORY),
        Law("feedforward", feedforward, "rad/m", "k > 0"),
        Law(
            "drift", feedforward, "rad/m", "k > 0", kind=Kind.RELATIVE
        ),  # until the estimate is trusted
        Law("auto", feedforward, "rad/m", "k > 0", kind=Kind.AUTO),
    )
}
"""Laws by their mission names."""
