"""Slant range to horizontal range."""

from math import sqrt

MAX_SIGMA_GROWTH = 5.0
"""Nearer overhead than this, noise grows so much that the sample says nothing: an elevation of 78 degrees."""


def horizontal(slant: float, sigma: float, height: float) -> tuple[float, float] | None:
    """Horizontal range and its standard deviation from a slant range, all in m.

    rho = sqrt(slant^2 - height^2), sigma_rho = sigma slant/rho. None where the geometry is singular: the target is
    (nearly) below, and neither value can be told.
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
