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
    length = V * dt * np.sinc(turn / (2 * np.pi))
    middle = psi + turn / 2
    return np.stack([length * np.cos(middle), length * np.sin(middle)])
