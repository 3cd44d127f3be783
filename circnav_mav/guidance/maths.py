"""Arcs at a steady turn rate, angles, bounds, and horizontal ranges from slant ranges."""

import math

Vector = tuple[float, float]
"""Components x and y."""
REACHABLE = 0.98
"""Largest sine of the angle between heading and ground course, and so the largest drift, in units
of V, for which a course is planned. A stronger wind makes the course impossible: then the nose
points nearly across the course."""
MAX_SIGMA_GROWTH = 5.0
"""Largest ratio of the noise of the horizontal range to the noise of the slant range. It is reached
at an elevation of 78 deg. Samples with a larger ratio are rejected."""


def clip(value: float, low: float, high: float) -> float:
    """Return the value limited to [low, high]. A value of NaN stays NaN."""
    return min(max(value, low), high)


def wrap(angle: float) -> float:
    """Return the angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def chord(V: float, psi: float, turn: float, dt: float) -> Vector:
    """Return the exact displacement (m) in dt (s) at V (m/s), turning steadily by `turn` (rad) from
    heading psi (rad).

    Its length is V dt sin(turn/2)/(turn/2) and its direction psi + turn/2. An Euler step would
    cause a radius error of -0.3 m.
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
    """Return a text: radius error per error of height and of ranges. radius, height: m.

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
    """Return horizontal range rate and its standard deviation, m/s, in level flight.

    slant: slant range, m.
    rate: rate of the slant range, m/s.
    sigma: standard deviation of `rate`, m/s.

    rho' = slant slant'/rho. None if the target is (nearly) below the vehicle.
    """
    flat = horizontal(slant, sigma, height)
    return None if flat is None else (rate * slant / flat[0], flat[1])
