"""Arcs: how far and where a vehicle gets that turns at a steady rate."""

from typing import Any

import numpy as np

Array = Any


def wrap(angle: Array) -> Array:
    """An angle in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


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
