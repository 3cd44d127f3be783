"""The guidance laws: one function per equation, what is proved about them, and the table a mission picks from.

Every law takes range r (m) and range rate r_dot (m/s), floats or arrays of one shape, and returns the turn rate in
rad/s, counter-clockwise positive. The sign of the gain k chooses the sense of rotation: k > 0 clockwise, k < 0
counter-clockwise (the paper's remark after its second theorem). A law knows nothing of the vehicle's limits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import wraps

import numpy as np

from circnav_mav.guidance.maths import Number, arcsin, clip, cos, magnitude, maximum, minimum, sign, sqrt, tanh, where

LEAST = 1.2
"""Default gains stay this many times above the paper's bound."""
SMOOTH_LOOP = 0.35
"""What 2 k r_d V lag is for law 1 at the most; from about .45 on, vehicles limit-cycle."""
LOOP_LAG = 0.55
"""Lag of turn and filter, s, that the gain of `bounded` and the boundary layer of `relay` are made for."""
LawFunction = Callable[..., Number]
"""The equation of a law: (r, r_dot, *, V, r_d, k) in the paper's symbols -> turn rate."""


class Kind(Enum):
    """What a law needs beside range and range rate."""

    RANGE = "nothing"
    MEMORY = "its own integral"
    RELATIVE = "position relative to the target and drift"
    AUTO = "nothing, but uses the relative motion as soon as it can be trusted"


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


def tolerated_drift(V: float, r_d: float, max_turn_rate: float) -> float:
    """Largest drift W, m/s, in which the circle can be held, below V; negative if not even in still air.

    (V + W)^2/(V omega_max) <= r_d: at the most downwind point the ground speed is V + W and the turn of the course
    V/(V + W) times that of the nose. max_turn_rate: as the vehicle reaches it. Derived; necessary for every law.
    """
    return min(sqrt(r_d * V * max_turn_rate) - V, 0.99 * V)


def settling_time(r: float, V: float, r_d: float, max_turn_rate: float) -> float:
    """Time, s, to the circle from range r in still air at worst: half a turn, then the tangent (inside: outwards).

    Dubins: pi/omega_max + sqrt(r^2 - r_d^2)/V; a prediction for `check`, not a bound.
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
    """Range rate while flying at the tangent point of the circle, m/s; inside the circle it is not used."""
    return V * cos(np.pi - arcsin(minimum(r_d / maximum(r, 1e-9), 1.0)))


@dataclass(frozen=True, slots=True)
class Law:
    """A law with what a mission and its check need to know of it.

    default_gain: (V, r_d, lag of the loop in s) -> magnitude of k. gain_bound: (V, r_d) -> magnitude of k, exclusive.
    reached_radius: (V, r_d, k) -> radius flown when fed r_d. fed_radius: the r_d to feed to fly a given radius.
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
        """Whether it goes by where the target is, and not only by how far, once that is known."""
        return self.kind in (Kind.RELATIVE, Kind.AUTO)


def counterclockwise(law: LawFunction) -> LawFunction:
    """A law that is written for k > 0 and a counter-clockwise orbit (omega > 0 turns left), for both senses: range and
    range rate do not change under reflection."""

    @wraps(law)
    def either(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
        return -sign(k) * law(r, r_dot, V=V, r_d=r_d, k=magnitude(k))

    return either


@counterclockwise
def bounded(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = k [r' + V sqrt(1 - (r_s/r)^2)] outside r_s = sqrt(r_d^2 - 1/k^2), k [r' - V sqrt(1 - (r/r_s)^2)] inside.

    k > 1/r_d, in 1/m; exact radius, |omega| <= 2 k V. Source: Cao, "UAV circumnavigating an unknown target under a
    GPS-denied environment with range-only measurements", Automatica 55 (2015); inside in its two-sided form.
    A smaller r_d, as a trim can make it, counts as 1/k, the smallest circle that this k flies (r_s = 0).
    """
    r_s = sqrt(maximum(r_d**2 - 1 / k**2, 1e-12))  # not 0, by which the inside divides
    outside = V * sqrt(maximum(1 - (r_s / maximum(r, 1e-6)) ** 2, 0.0))
    inside = V * sqrt(maximum(1 - (r / r_s) ** 2, 0.0))
    return k * (r_dot + where(r >= r_s, outside, -inside))


@counterclockwise
def relay(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = k sat((r' + chi)/phi) + V/r_d with chi = clip(V e/r_d, -V/2, V/2): sliding on r' = -chi. e = r - r_d.

    k > V/r_d, rad/s. The boundary layer phi (m/s), without which it chatters, makes the slope k/phi what the loop
    bears. Copes with a moving target. Source: Matveev, Teimoori, Savkin, "Range-only measurements based target
    following for wheeled mobile robots", Automatica 47 (2011).
    """
    chi = clip(V / r_d * (r - r_d), -0.5 * V, 0.5 * V)
    phi = k / rate_gain(V, r_d, LOOP_LAG)
    return k * clip((r_dot + chi) / phi, -1.0, 1.0) + V / r_d


@counterclockwise
def pd(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = V/r_d + k_p sat(e) + k r'. k in rad/m; k_p = k^2 V/4, for a damping of 1.

    Source: Dong, You, Xie, Hu, coordinate-free circumnavigation with range-based PD control. Far out r' settles to
    k_p e_max/k + V/(r_d k): e is cut to the e_max that asks for half the speed.
    """
    k_p = k**2 * V / 4
    e_max = k * 0.5 * V / k_p
    return V / r_d + k_p * clip(r - r_d, -e_max, e_max) + k * r_dot


@counterclockwise
def feedforward(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number) -> Number:
    """omega = sqrt(V^2 - r'^2)/max(r, .43 r_d) + k (r' + chi), chi = v* tanh(gamma e/v*). k in rad/m.

    The first term is the turn of the circle through the present point, so the radius has no bias for any k. v* = .55 V,
    an approach that a wind of .3 V leaves flyable. gamma = k V/6; condition: gamma <= k V/4 (damping at least 1) and
    k V (course lag + filter lag) < about .5. Derived for this product.
    """
    gamma, v_star = k * V / 6, 0.55 * V
    chi = v_star * tanh(gamma * (r - r_d) / v_star)
    return sqrt(maximum(V**2 - r_dot**2, 0.0)) / maximum(r, 0.43 * r_d) + k * (r_dot + chi)


def pi(
    r: Number, r_dot: Number, memory: Number, dt: Number, *, V: Number, r_d: Number, k: Number
) -> tuple[Number, Number]:
    """s = r' + c tanh(e/delta); omega = |k| s + k_i int s. Memory (the integral, m) in, turn rate and memory out.

    c = V/2 and delta = r_d/2; k_i = |k| V/r_d, ten times slower than the turn. The integral comes to rest at
    V/(r_d k_i) by itself and is held within twice that, so that it cannot wind up while the turn saturates. Source:
    Dong, You, Wang, isoline tracking with PI control: any field that falls with range will do.
    """
    k_i = magnitude(k) * V / r_d
    s = r_dot + 0.5 * V * tanh((r - r_d) / (0.5 * r_d))
    memory = clip(memory + s * dt, 0.0, 2 * V / (r_d * k_i))
    return -sign(k) * (magnitude(k) * s + k_i * memory), memory


def _smooth_gain(V: float, r_d: float, lag: float) -> float:
    """Twice the bound, as in the paper's example, or less where the delay would make the circle oscillate."""
    bound = smooth_gain_bound(r_d)
    return max(LEAST * bound, min(2 * bound, SMOOTH_LOOP / (2 * r_d * V * lag)))


LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        Law(
            "smooth", smooth, "1/m^2", "k > 1/(2 r_d^2)", _smooth_gain,
            gain_bound=lambda V, r_d: smooth_gain_bound(r_d),
            reached_radius=lambda V, r_d, k: reached_radius(r_d, k),
            fed_radius=lambda V, r_d, k: corrected_radius(r_d, k),
        ),
        Law(
            "switching", switching, "rad/s", "k > V/r_d",
            lambda V, r_d, lag: LEAST * switching_gain_bound(V, r_d),  # as in the paper's example
            gain_bound=switching_gain_bound,
            switches=True,
        ),
        Law(
            "bounded", bounded, "1/m", "k > 1/r_d",
            lambda V, r_d, lag: max(0.5 * rate_gain(V, r_d, LOOP_LAG), 1.5 / r_d),  # its slope in r is k^2 V
            gain_bound=lambda V, r_d: 1 / r_d,
        ),
        Law(
            "relay", relay, "rad/s", "k > V/r_d", lambda V, r_d, lag: 1.33 * V / r_d,
            gain_bound=switching_gain_bound,
        ),
        Law("pd", pd, "rad/m", "k > 0"),
        Law("pi", feedforward, "rad/m", "k > 0", kind=Kind.MEMORY),
        Law("feedforward", feedforward, "rad/m", "k > 0"),
        Law("drift", feedforward, "rad/m", "k > 0", kind=Kind.RELATIVE),  # until there is relative motion to trust
        Law("auto", feedforward, "rad/m", "k > 0", kind=Kind.AUTO),
    )
}  # fmt: skip
"""The laws by their mission names."""
