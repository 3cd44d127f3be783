"""Arcs that a vehicle flies at a steady turn rate, and slant ranges made horizontal."""

from math import pi, sqrt

import numpy as np

from circnav_mav.guidance.maths import Array, cos, sin, sinc

MAX_SIGMA_GROWTH = 5.0
"""Nearer overhead than this, noise grows so much that the sample says nothing: an elevation of 78 degrees."""


def wrap(angle: Array) -> Array:
    """An angle in [-pi, pi)."""
    return (angle + pi) % (2 * pi) - pi


def chord_parts(V: Array, psi: Array, turn: Array, dt: Array) -> tuple[Array, Array]:
    """Displacement in dt at speed V along an arc from heading psi through the angle `turn`, exactly.

    Its length is V dt sinc(turn/2) and its direction psi + turn/2. An Euler step instead leaves -0.3 m of radius.
    """
    length, middle = V * dt * sinc(turn / (2 * pi)), psi + turn / 2
    return length * cos(middle), length * sin(middle)


def chord(V: Array, psi: Array, turn: Array, dt: Array) -> Array:
    """`chord_parts` as one array (2, ...)."""
    return np.stack(chord_parts(V, psi, turn, dt))


def horizontal(slant: float, sigma: float, height: float) -> tuple[float, float] | None:
    """Horizontal range and its standard deviation from a slant range, all in m.

    rho = sqrt(slant^2 - height^2), sigma_rho = sigma slant/rho. None where the target is (nearly) below.
    """
    inside = slant**2 - height**2
    if inside <= 0:
        return None
    rho = sqrt(inside)
    growth = slant / rho
    return None if growth > MAX_SIGMA_GROWTH else (rho, sigma * growth)


def horizontal_rate(slant: float, rate: float, sigma: float, height: float) -> tuple[float, float] | None:
    """Horizontal range rate and its standard deviation, m/s, from those of a slant range (m), in level flight:
    rho' = slant slant'/rho. None as `horizontal`."""
    flat = horizontal(slant, sigma, height)
    return None if flat is None else (rate * slant / flat[0], flat[1])
