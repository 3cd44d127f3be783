"""Arcs at a steady turn rate, angles, bounds, and horizontal ranges from slant ranges."""

import math

Vector = tuple[float, float]
"""Components x and y."""
MAX_SIGMA_GROWTH = 5.0
"""Largest growth of the noise from slant to horizontal range, at 78 deg of elevation. Above it a
sample is useless."""


def clip(value: float, low: float, high: float) -> float:
    """Return the value limited to [low, high]. A value of NaN stays NaN."""
    return min(max(value, low), high)


def wrap(angle: float) -> float:
    """Return the angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def chord(V: float, psi: float, turn: float, dt: float) -> Vector:
    """Return the exact displacement (m) in dt (s) at V (m/s), turning steadily by `turn` (rad) from
    heading psi (rad).

    Its length is V dt sin(turn/2)/(turn/2) and its direction psi + turn/2. An Euler step instead
    causes -0.3 m of radius error.
    """
    half = turn / 2
    length = V * dt * (math.sin(half) / half if half else 1.0)
    return length * math.cos(psi + half), length * math.sin(psi + half)


def horizontal(slant: float, sigma: float, height: float) -> tuple[float, float] | None:
    """Return horizontal range and its standard deviation from a slant range, all in m.

    rho = sqrt(slant^2 - height^2), sigma_rho = sigma slant/rho. None if the target is (nearly)
    below the vehicle.
    """
    inside = slant**2 - height**2
    if inside <= 0:
        return None
    rho = math.sqrt(inside)
    growth = slant / rho
    return None if growth > MAX_SIGMA_GROWTH else (rho, sigma * growth)


def radius_sensitivity(radius: float, height: float) -> str:
    """Return the radius errors due to errors of height and ranges, as text. radius, height: m.

    rho^2 = slant^2 - height^2, so that d rho = slant/rho d slant - height/rho dh.
    """
    share = abs(height) / radius
    return (
        f"1 m of height: {share:.2f} m of radius, 1 m of range offset:"
        f" {math.hypot(1.0, share):.2f} m of radius"
    )


def horizontal_rate(
    slant: float, rate: float, sigma: float, height: float
) -> tuple[float, float] | None:
    """Return horizontal range rate and its standard deviation, m/s, from a slant range (m), its
    rate and the sigma of this rate (m/s), in level flight: rho' = slant slant'/rho. None as for
    `horizontal`."""
    flat = horizontal(slant, sigma, height)
    return None if flat is None else (rate * slant / flat[0], flat[1])
