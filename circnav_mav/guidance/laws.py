"""Guidance laws: one function per equation, their proved properties, and the table of laws for
missions.

Every law takes range r (m) and range rate r_dot (m/s). It returns the turn rate in rad/s,
counter-clockwise positive. The sign of the gain k chooses the sense of rotation: k > 0 clockwise,
k < 0 counter-clockwise (the paper's remark after its second theorem). A law does not apply the
vehicle's limits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from math import asin, copysign, cos, pi, sqrt, tanh
from typing import Any

from circnav_mav.guidance.maths import REACHABLE
from circnav_mav.guidance.own_code import NameTable, call, checked
from circnav_mav.guidance.types import Orbit, OwnLaw

LEAST = 1.2
"""Least ratio of the default gain of law 1 or 2 to the paper's bound on this gain."""
LawFunction = Callable[..., Any]
"""The equation of a law: (r, r_dot, *, V, r_d, k) in the paper's symbols -> turn rate. For a
user-defined law: `Orbit` -> `OwnLaw`."""


class Kind(Enum):
    """Inputs of a law beside range and range rate."""

    RANGE = "nothing"
    RELATIVE = "position relative to the target and drift"
    AUTO = "nothing, but uses the relative motion as soon as it can be trusted"
    OWN = "user-defined: everything that the estimator provides"


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
    """Input radius with which law 1 settles on r_d exactly, m (eq. `tilde_r_d`).

    Raises ValueError unless |k| > 1/(2 r_d^2).
    """
    inside = 1 - 1 / (4 * k**2 * r_d**4)
    if inside <= 0:
        raise ValueError(f"|k| = {abs(k):g} must be above 1/(2 r_d^2) = {smooth_gain_bound(r_d):g}")
    return r_d * sqrt(inside)


def max_range_acceleration(V: float, max_turn_rate: float, r: float) -> float:
    """Return the bound of |r''| = |V sin(theta_b) theta_b'| <= V^2/r + V omega_max, m/s^2.

    theta_b: bearing of the target from the heading. At ranges below V/omega_max, the radius of the
    tightest turn, the first term keeps its value at that radius.
    """
    return V**2 / max(r, V / max_turn_rate) + V * max_turn_rate


def rate_gain(V: float, r_d: float, lag: float) -> float:
    """Return the largest gain k on the range rate, rad/m, for a loop with this lag (course +
    filter, s): k V lag = 0.5.

    With k V lag above about 0.5, real autopilots flew limit cycles. A gain above 6/r_d has no
    benefit.
    """
    return min(0.5 / (V * lag), 6 / r_d)


def tolerated_drift(V: float, r_d: float, max_turn_rate: float) -> float:
    """Return the largest drift W (m/s, below V) in which the circle can be held; negative if not
    even in still air.

    (V + W)^2/(V omega_max) <= r_d: where the drift is a tailwind, the ground speed is V + W, and
    the course turns V/(V + W) times as fast as the nose. max_turn_rate: reached by the vehicle,
    rad/s. This condition is derived, and is necessary for every law.
    """
    return min(sqrt(r_d * V * max_turn_rate) - V, REACHABLE * V)


def settling_time(r: float, V: float, r_d: float, max_turn_rate: float) -> float:
    """Return the worst-case time, s, to the circle from range r (m) in still air.

    Dubins path: half a turn, then the tangent to the circle: pi/omega_max + sqrt(r^2 - r_d^2)/V.
    From inside, the straight way is r_d - r. A prediction for `circnav check`, not a bound.
    """
    way = sqrt(r**2 - r_d**2) if r > r_d else r_d - r
    return pi / max_turn_rate + way / V


def smooth(r: float, r_dot: float, *, V: float, r_d: float, k: float) -> float:
    """Law 1 of the paper, smooth and unsaturated (eq. `omega`), k in 1/m^2:
    omega = k [2 r V cos(pi - asin(r_d/r)) - 2 r r_dot] where r >= r_d, else 0."""
    if r < r_d:
        return 0.0
    return k * (2 * r * _tangent_rate(r, V, r_d) - 2 * r * r_dot)


def switching(r: float, r_dot: float, *, V: float, r_d: float, k: float) -> float:
    """Law 2 of the paper, switching and saturated (eq. `omega-sign-version`), k in rad/s:
    omega = k sign(V cos(pi - asin(r_d/r)) - r_dot) where r >= r_d, else 0."""
    if r < r_d:
        return 0.0
    excess = _tangent_rate(r, V, r_d) - r_dot
    return copysign(k, k * excess) if excess else 0.0


def _tangent_rate(r: float, V: float, r_d: float) -> float:
    """Return the range rate on a course to the tangent point of the circle, m/s, for r >= r_d."""
    return V * cos(pi - asin(r_d / r))


@dataclass(frozen=True, slots=True)
class Law:
    """A law and its properties for missions and their checks.

    default_gain: (V, r_d, lag of the loop in s) -> magnitude of k.
    gain_bound: (V, r_d) -> bound that the magnitude of k must exceed.
    reached_radius: (V, r_d, k) -> radius on which the vehicle settles if the law receives r_d, m.
    fed_radius: (V, r_d, k) -> radius that the law must receive for the vehicle to settle on r_d, m.
    """

    name: str
    function: LawFunction
    gain_unit: str
    gain_condition: str
    default_gain: Callable[[float, float, float], float] = rate_gain
    gain_bound: Callable[[float, float], float] = lambda V, r_d: 0.0
    reached_radius: Callable[[float, float, float], float] = lambda V, r_d, k: r_d
    fed_radius: Callable[[float, float, float], float] = lambda V, r_d, k: r_d
    kind: Kind = Kind.RANGE

    @property
    def flies_relative_motion(self) -> bool:
        """True if the law uses the position relative to the target as soon as it is trusted."""
        return self.kind in (Kind.RELATIVE, Kind.AUTO)


def feedforward(r: float, r_dot: float, *, V: float, r_d: float, k: float) -> float:
    """Law without radius bias, derived for this product:
    omega = sqrt(V^2 - r'^2)/max(r, 0.43 r_d) + |k| (r' + chi), chi = v* tanh(gamma e/v*).

    The equation holds for k < 0 (counter-clockwise), its mirror image for k > 0. e = r - r_d. |k|
    is in rad/m. The first term is the turn of the circle through the present point, so the radius
    has no bias for any k. With v* = 0.55 V the approach can be flown in a wind of 0.3 V.

    gamma = |k| V/6 satisfies the condition gamma <= |k| V/4 (damping of at least 1). A second
    condition is that |k| V (course lag + filter lag) is below about 0.5.
    """
    gamma = abs(k) * V / 6
    v_star = 0.55 * V
    chi = v_star * tanh(gamma * (r - r_d) / v_star)
    circle = sqrt(max(V**2 - r_dot**2, 0.0)) / max(r, 0.43 * r_d)
    return copysign(1.0, -k) * (circle + abs(k) * (r_dot + chi))


def _smooth_gain(V: float, r_d: float, lag: float) -> float:
    """Return the default gain of law 1: twice its bound, as in the paper's example, or less if the
    loop would oscillate with this lag (s)."""
    bound = smooth_gain_bound(r_d)
    # Largest loop gain 2 k r_d V lag of law 1. From about 0.45 on, vehicles have limit cycles.
    return max(LEAST * bound, min(2 * bound, 0.35 / (2 * r_d * V * lag)))


def _own_law(name: str, make: Any) -> Law:
    form = "a function from the circle to a law, which is a function of the estimate"
    make_law = checked(name, make, form, callable)

    def made_by(orbit: Orbit) -> OwnLaw:
        return partial(call, name, call(name, make_law, orbit))

    return Law(name, made_by, "", "", kind=Kind.OWN)


_BUILT_IN = (
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
    ),
    Law("feedforward", feedforward, "rad/m", "k > 0"),
    # `drift` flies feedforward until the estimate is trusted.
    Law("drift", feedforward, "rad/m", "k > 0", kind=Kind.RELATIVE),
    Law("auto", feedforward, "rad/m", "k > 0", kind=Kind.AUTO),
)
LAWS = NameTable("circnav.laws", {law.name: law for law in _BUILT_IN}, _own_law)
"""Laws by their mission names."""
