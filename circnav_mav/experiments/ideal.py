"""The paper's own world: many vehicles at once that turn exactly as the law says, no noise, no lag, no MAVLink.

Arrays over steps and starts; SI, radians, the paper's frame (x right, y up, angles counter-clockwise).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.geometry import chord

Array = NDArray[np.float64]
Law = Callable[[Array, Array], Array]
"""Range and range rate to turn rate."""

STEP = 0.02


@dataclass(frozen=True, slots=True)
class Starts:
    """x, y, heading of each start."""

    x: Array
    y: Array
    heading: Array

    def mirrored(self, target: tuple[float, float]) -> "Starts":
        """The reflection in the upright line through the target."""
        return Starts(2 * target[0] - self.x, self.y, np.pi - self.heading)


@dataclass(frozen=True, slots=True)
class Tracks:
    """time: of each step. x, y, r, theta_b: (steps, starts); theta_b in [0, 2 pi)."""

    time: Array
    x: Array
    y: Array
    r: Array
    theta_b: Array


def random_starts(count: int, seed: int) -> Starts:
    """The paper's: uniform in [0, 10] x [0, 10] x [0, 2 pi)."""
    x, y, heading = np.random.default_rng(seed).uniform(size=(3, count))
    return Starts(10 * x, 10 * y, 2 * np.pi * heading)


def fly(starts: Starts, law: Law, *, V: float, target: tuple[float, float], seconds: float) -> Tracks:
    """Fly all starts. Each step is an exact arc at the law's turn rate in its middle (second order)."""
    steps = round(seconds / STEP)
    tracks = Tracks(np.linspace(0, steps * STEP, steps + 1), *(np.empty((steps + 1, len(starts.x))) for _ in range(4)))
    x, y, heading = starts.x, starts.y, starts.heading
    for step in range(steps + 1):
        r, theta_b = polar(x, y, heading, target)
        tracks.x[step], tracks.y[step], tracks.r[step], tracks.theta_b[step] = x, y, r, theta_b
        omega = law(r, -V * np.cos(theta_b))
        r, theta_b = polar(*arc(x, y, heading, V, omega, STEP / 2), target)
        x, y, heading = arc(x, y, heading, V, law(r, -V * np.cos(theta_b)), STEP)
    return tracks


def polar(x: Array, y: Array, heading: Array, target: tuple[float, float]) -> tuple[Array, Array]:
    """Range, and bearing angle theta_b from the line of sight to the heading, counter-clockwise."""
    to_x, to_y = target[0] - x, target[1] - y
    return np.hypot(to_x, to_y), np.mod(heading - np.arctan2(to_y, to_x), 2 * np.pi)


def arc(x: Array, y: Array, heading: Array, V: float, omega: Array, step: float) -> tuple[Array, Array, Array]:
    """Where a turn at constant rate leads."""
    east, north = chord(V, heading, omega * step, step)
    return x + east, y + north, heading + omega * step


def lyapunov(r: Array, theta_b: Array, *, r_d: float, r_a: float, k: float) -> Array:
    """The paper's function for law 1: 1 - sin(theta_b) + integral from r_a to r of (-1/z + 2 k z cos asin(r_d/z)) dz.

    The integral in closed form; r >= r_d.
    """

    def integral(z: Array) -> Array:
        root = np.sqrt(np.maximum(z**2 - r_d**2, 0.0))
        return np.asarray(k * (z * root - r_d**2 * np.log(z + root)) - np.log(z))

    return 1 - np.sin(theta_b) + integral(r) - integral(np.asarray(r_a))
