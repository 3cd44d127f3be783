"""The guidance laws: one function per equation, and the table a mission picks from.

Every law takes range r (m) and range rate r_dot (m/s), scalars or arrays of one shape, and returns the turn rate in
rad/s, counter-clockwise positive. The sign of the gain k chooses the sense of rotation: k > 0 clockwise, k < 0
counter-clockwise (the paper's remark after its second theorem). A law knows nothing of the vehicle's limits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from circnav_mav.core import theory

Array = Any
"""A float or an array of floats: the same equation serves one flight and a thousand."""


class LawFunction(Protocol):
    """The equation of a law: the paper's symbols in, turn rate (rad/s, counter-clockwise positive) out."""

    def __call__(self, r: Array, r_dot: Array, *, V: float, r_d: float, k: float) -> Array: ...


def smooth(r: Array, r_dot: Array, *, V: float, r_d: float, k: float) -> Array:
    """Law 1 of the paper, smooth and unsaturated (eq. `omega`).

    omega = k [2 r V cos(pi - asin(r_d/r)) - 2 r r_dot] where r >= r_d, else 0. k in 1/m^2.
    """
    return np.where(r >= r_d, k * (2 * r * _tangent_rate(r, V, r_d) - 2 * r * r_dot), 0.0)


def switching(r: Array, r_dot: Array, *, V: float, r_d: float, k: float) -> Array:
    """Law 2 of the paper, switching and saturated (eq. `omega-sign-version`).

    omega = k sign(V cos(pi - asin(r_d/r)) - r_dot) where r >= r_d, else 0. k in rad/s; |omega| <= |k|.
    """
    return np.where(r >= r_d, k * np.sign(_tangent_rate(r, V, r_d) - r_dot), 0.0)


def _tangent_rate(r: Array, V: float, r_d: float) -> Array:
    """Range rate while flying at the tangent point of the circle, m/s; inside the circle it is not used."""
    return V * np.cos(np.pi - np.arcsin(np.minimum(r_d / np.maximum(r, 1e-9), 1.0)))


@dataclass(frozen=True, slots=True)
class Law:
    """A law with what a mission and its check need to know of it.

    default_gain, gain_bound: (V, r_d) -> magnitude of k; the bound is exclusive and the source's condition.
    reached_radius: (V, r_d, k) -> radius flown when fed r_d. fed_radius: the r_d to feed to fly a given radius.
    """

    name: str
    function: LawFunction
    gain_unit: str
    gain_condition: str
    gain_bound: Callable[[float, float], float]
    default_gain: Callable[[float, float], float]
    reached_radius: Callable[[float, float, float], float]
    fed_radius: Callable[[float, float, float], float]
    switches: bool = False


LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        Law(
            "smooth", smooth, "1/m^2", "k > 1/(2 r_d^2)",
            gain_bound=lambda V, r_d: theory.smooth_gain_bound(r_d),
            default_gain=lambda V, r_d: 2 * theory.smooth_gain_bound(r_d),
            reached_radius=lambda V, r_d, k: theory.reached_radius(r_d, k),
            fed_radius=lambda V, r_d, k: theory.corrected_radius(r_d, k),
        ),
        Law(
            "switching", switching, "rad/s", "k > V/r_d",
            gain_bound=lambda V, r_d: theory.switching_gain_bound(V, r_d),
            default_gain=lambda V, r_d: 1.2 * theory.switching_gain_bound(V, r_d),
            reached_radius=lambda V, r_d, k: r_d,
            fed_radius=lambda V, r_d, k: r_d,
            switches=True,
        ),
    )
}  # fmt: skip
"""The laws by their mission names. Default gains are the paper's examples: twice and 1.2 times the bound."""
