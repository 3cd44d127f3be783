"""The guidance laws: one function per equation, and the table a mission picks from.

Every law takes range r (m) and range rate r_dot (m/s), scalars or arrays of one shape, and returns the turn rate in
rad/s, counter-clockwise positive. The sign of the gain k chooses the sense of rotation: k > 0 clockwise, k < 0
counter-clockwise (the paper's remark after its second theorem). A law knows nothing of the vehicle's limits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import ModuleType
from typing import Protocol

import numpy as np

from circnav_mav.guidance import range_laws, theory
from circnav_mav.guidance.floats import Number, magnitude


class Kind(Enum):
    """What a law needs beside range and range rate."""

    RANGE = "nothing"
    MEMORY = "its own integral"
    RELATIVE = "position relative to the target and drift"
    AUTO = "nothing, but uses the relative motion as soon as it can be trusted"


class LawFunction(Protocol):
    """The equation of a law: the paper's symbols in, turn rate (rad/s, counter-clockwise positive) out."""

    def __call__(
        self, r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np
    ) -> Number: ...


def smooth(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np) -> Number:
    """Law 1 of the paper, smooth and unsaturated (eq. `omega`).

    omega = k [2 r V cos(pi - asin(r_d/r)) - 2 r r_dot] where r >= r_d, else 0. k in 1/m^2.
    """
    turn: Number = xp.where(r >= r_d, k * (2 * r * _tangent_rate(r, V, r_d, xp) - 2 * r * r_dot), 0.0)
    return turn


def switching(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np) -> Number:
    """Law 2 of the paper, switching and saturated (eq. `omega-sign-version`).

    omega = k sign(V cos(pi - asin(r_d/r)) - r_dot) where r >= r_d, else 0. k in rad/s; |omega| <= |k|.
    """
    turn: Number = xp.where(r >= r_d, k * xp.sign(_tangent_rate(r, V, r_d, xp) - r_dot), 0.0)
    return turn


def _tangent_rate(r: Number, V: Number, r_d: Number, xp: ModuleType) -> Number:
    """Range rate while flying at the tangent point of the circle, m/s; inside the circle it is not used."""
    rate: Number = V * xp.cos(np.pi - xp.arcsin(xp.minimum(r_d / xp.maximum(r, 1e-9), 1.0)))
    return rate


def _as_asked(V: float, r_d: float, k: float) -> float:
    """A law that flies the radius that it is fed."""
    return r_d


@dataclass(frozen=True, slots=True)
class Law:
    """A law with what a mission and its check need to know of it.

    gain_bound: (V, r_d) -> magnitude of k, exclusive: the source's condition. Default gains are in `tuning`.
    reached_radius: (V, r_d, k) -> radius flown when fed r_d. fed_radius: the r_d to feed to fly a given radius.
    """

    name: str
    function: LawFunction
    gain_unit: str
    gain_condition: str
    gain_bound: Callable[[float, float], float]
    reached_radius: Callable[[float, float, float], float] = _as_asked
    fed_radius: Callable[[float, float, float], float] = _as_asked
    switches: bool = False
    kind: Kind = Kind.RANGE

    @property
    def flies_relative_motion(self) -> bool:
        """Whether it goes by where the target is, and not only by how far, once that is known."""
        return self.kind in (Kind.RELATIVE, Kind.AUTO)


def bounded(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np) -> Number:
    """`range_laws.bounded` with the sense in the sign of k. |k| > 1/r_d."""
    turn: Number = -xp.sign(k) * range_laws.bounded(r, r_dot, V=V, r_d=r_d, k=magnitude(k), xp=xp)
    return turn


RELAY_LAG = 0.55
"""Lag of turn and filter, s, that the relay's boundary layer is made for."""


def relay(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np) -> Number:
    """`range_laws.relay` with w = |k|: approach at half the speed at most; the boundary layer makes the slope w/phi
    what the loop bears."""
    turn: Number = -xp.sign(k) * range_laws.relay(
        r, r_dot, V=V, r_d=r_d, w=magnitude(k), gamma=V / r_d, v_star=range_laws.closing_speed(V, 0.0, 0.5, xp),
        phi=magnitude(k) / theory.rate_gain(V, r_d, RELAY_LAG, xp), xp=xp,
    )  # fmt: skip
    return turn


def pd(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np) -> Number:
    """`range_laws.pd` with k_d = |k| and k_p for a damping of 1; e is cut where it asks for half the speed."""
    k_p = magnitude(k) ** 2 * V / 4
    turn: Number = -xp.sign(k) * range_laws.pd(
        r, r_dot, V=V, r_d=r_d, k_p=k_p, k_d=magnitude(k), e_max=magnitude(k) * 0.5 * V / k_p, xp=xp
    )
    return turn


def feedforward(r: Number, r_dot: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np) -> Number:
    """`range_laws.feedforward` with gamma = |k| V/6 and an approach at 0.55 V, which a wind of 0.3 V leaves flyable."""
    turn: Number = -xp.sign(k) * range_laws.feedforward(
        r, r_dot, V=V, r_d=r_d, k=magnitude(k), gamma=magnitude(k) * V / 6,
        v_star=range_laws.closing_speed(V, 0.3 * V, 0.55, xp), r_floor=0.43 * r_d, xp=xp,
    )  # fmt: skip
    return turn


def pi(
    r: Number, r_dot: Number, memory: Number, dt: Number, *, V: Number, r_d: Number, k: Number, xp: ModuleType = np
) -> tuple[Number, Number]:
    """`range_laws.pi` with k_p = |k| and an integral ten times slower than the turn; memory in, memory out."""
    k_i = magnitude(k) * V / r_d
    turn, memory = range_laws.pi(
        r, r_dot, memory, dt, r_d=r_d, k_p=magnitude(k), k_i=k_i, c=range_laws.closing_speed(V, 0.0, 0.5, xp),
        delta=0.5 * r_d, I_max=2 * V / (r_d * k_i), xp=xp,
    )  # fmt: skip
    return -xp.sign(k) * turn, memory


LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        Law(
            "smooth", smooth, "1/m^2", "k > 1/(2 r_d^2)",
            gain_bound=lambda V, r_d: theory.smooth_gain_bound(r_d),
            reached_radius=lambda V, r_d, k: theory.reached_radius(r_d, k),
            fed_radius=lambda V, r_d, k: theory.corrected_radius(r_d, k),
        ),
        Law(
            "switching", switching, "rad/s", "k > V/r_d",
            gain_bound=lambda V, r_d: theory.switching_gain_bound(V, r_d),
            switches=True,
        ),
        Law(
            "bounded", bounded, "1/m", "k > 1/r_d",
            gain_bound=lambda V, r_d: 1 / r_d,
        ),
        Law(
            "relay", relay, "rad/s", "k > V/r_d",
            gain_bound=lambda V, r_d: V / r_d,
        ),
        Law(
            "pd", pd, "rad/m", "k > 0",
            gain_bound=lambda V, r_d: 0.0,
        ),
        Law(
            "pi", feedforward, "rad/m", "k > 0",
            gain_bound=lambda V, r_d: 0.0,
            kind=Kind.MEMORY,
        ),
        Law(
            "feedforward", feedforward, "rad/m", "k > 0",
            gain_bound=lambda V, r_d: 0.0,
        ),
        Law(
            "drift", feedforward, "rad/m", "k > 0",
            gain_bound=lambda V, r_d: 0.0,
            kind=Kind.RELATIVE,
        ),
        Law(
            "auto", feedforward, "rad/m", "k > 0",
            gain_bound=lambda V, r_d: 0.0,
            kind=Kind.AUTO,
        ),
    )
}  # fmt: skip
"""The laws by their mission names."""
