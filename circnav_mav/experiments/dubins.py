"""The shortest time to the circle: Dubins paths in still air, the yardstick for settling.

Formulas: Shkel and Lumelsky, "Classification of the Dubins set", Robotics and Autonomous Systems 34 (2001). Arrays
broadcast; lengths in units of the turning radius inside, SI outside.
"""

from typing import Any

import numpy as np

Array = Any
ARRIVALS = 720
"""Points of the circle that are tried; the time is smooth between them."""


def circle_time(p: Array, psi: Array, sense: Array, *, V: float, r_d: float, max_turn_rate: float) -> Array:
    """Shortest time (s), (B,), from p = vehicle - target (2, B), heading psi (B,), onto the circle in the right sense.

    sense: +1 counter-clockwise, -1 clockwise. The path ends on the circle and along it.
    """
    rho = V / max_turn_rate
    x, y, heading = p[0] / rho, p[1] * sense / rho, psi * sense
    at = 2 * np.pi * np.arange(ARRIVALS)[:, None] / ARRIVALS
    length = shortest(x, y, heading, r_d / rho * np.cos(at), r_d / rho * np.sin(at), at + np.pi / 2)
    best: Array = length.min(axis=0) * rho / V
    return best


def tangent_time(p: Array, psi: Array, sense: Array, *, V: float, r_d: float, max_turn_rate: float) -> Array:
    """Time (s), (B,), to the tangent point: one turn at the limit, then the straight line that touches the circle.

    For starts outside, p (2, B). Longer than `circle_time`, which may cut into the circle and meet it from within.
    """
    rho = V / max_turn_rate
    best = np.full(np.shape(psi), np.inf)
    x, y, heading = p[0], p[1] * sense, psi * sense
    for side in (1.0, -1.0):
        cx, cy = x - side * rho * np.sin(heading), y + side * rho * np.cos(heading)
        D, offset = np.hypot(cx, cy), r_d - side * rho
        exists = abs(offset) <= D
        line = np.sqrt(np.maximum(D**2 - offset**2, 0.0))
        course = np.arctan2(-cy, -cx) - np.arcsin(np.minimum(offset / np.maximum(D, 1e-9), 1.0))
        length = _turn(side * (course - heading)) * rho + line
        best = np.minimum(best, np.where(exists, length, np.inf))
    return best / V


def shortest(x0: Array, y0: Array, h0: Array, x1: Array, y1: Array, h1: Array) -> Array:
    """Length of the shortest Dubins path between two poses with turning radius 1."""
    dx, dy = x1 - x0, y1 - y0
    D, along = np.hypot(dx, dy), np.arctan2(dy, dx)
    a, b = _turn(h0 - along), _turn(h1 - along)
    sa, sb, ca, cb, cab = np.sin(a), np.sin(b), np.cos(a), np.cos(b), np.cos(a - b)
    lsl = _straight(2 + D**2 - 2 * cab + 2 * D * (sa - sb), lambda s: (np.arctan2(cb - ca, D + sa - sb), s))
    rsr = _straight(2 + D**2 - 2 * cab + 2 * D * (sb - sa), lambda s: (np.arctan2(ca - cb, D - sa + sb), s))
    lsr = _straight(
        -2 + D**2 + 2 * cab + 2 * D * (sa + sb),
        lambda s: (np.arctan2(-ca - cb, D + sa + sb) - np.arctan2(-2.0, s), s),
    )
    rsl = _straight(
        -2 + D**2 + 2 * cab - 2 * D * (sa + sb),
        lambda s: (np.arctan2(ca + cb, D - sa - sb) - np.arctan2(2.0, s), s),
    )
    lengths = [
        _turn(-a + lsl[0]) + lsl[1] + _turn(b - lsl[0]),
        _turn(a - rsr[0]) + rsr[1] + _turn(-b + rsr[0]),
        _turn(-a + lsr[0]) + lsr[1] + _turn(-b + lsr[0]),
        _turn(a - rsl[0]) + rsl[1] + _turn(b - rsl[0]),
        _three_turns(a, b, (6 - D**2 + 2 * cab + 2 * D * (sa - sb)) / 8, np.arctan2(ca - cb, D - sa + sb)),
        _three_turns(-a, -b, (6 - D**2 + 2 * cab + 2 * D * (sb - sa)) / 8, np.arctan2(ca - cb, D + sa - sb)),
    ]
    return np.minimum.reduce(lengths)


def _turn(angle: Array) -> Array:
    return np.mod(angle + 1e-9, 2 * np.pi) - 1e-9


def _straight(square: Array, path: Any) -> tuple[Array, Array]:
    """Heading of the straight part and its length, infinite where it does not exist."""
    exists = square >= 0
    heading, length = path(np.sqrt(np.where(exists, square, 0.0)))
    return heading, np.where(exists, length, np.inf)


def _three_turns(a: Array, b: Array, cosine: Array, bend: Array) -> Array:
    """Right, left, right (or its mirror image)."""
    exists = np.abs(cosine) <= 1
    middle = _turn(2 * np.pi - np.arccos(np.where(exists, cosine, 1.0)))
    first = _turn(a - bend + middle / 2)
    return np.where(exists, first + middle + _turn(a - b - first + middle), np.inf)
