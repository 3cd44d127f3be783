"""The time along a Dubins path to the circle in still air: the yardstick for settling. SI."""

from typing import Any

import numpy as np

Array = Any


def tangent_time(p: Array, psi: Array, sense: Array, *, V: float, r_d: float, max_turn_rate: float) -> Array:
    """Time (s), (B,), to the tangent point: one turn at the limit, then the straight line that touches the circle.

    For starts outside, p = vehicle - target (2, B), heading psi (B,). sense: +1 counter-clockwise, -1 clockwise.
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


def _turn(angle: Array) -> Array:
    return np.mod(angle + 1e-9, 2 * np.pi) - 1e-9
