"""What surrounds the vehicles of a batch: wind, targets, and how a vehicle turns. SI, paper frame, exact steps."""

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any
GAUSS_AT = np.array([0.5 - np.sqrt(15) / 10, 0.5, 0.5 + np.sqrt(15) / 10])
GAUSS_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18


@dataclass(frozen=True, slots=True)
class Wind:
    """speed: mean, m/s, from any direction. gust: standard deviation of each horizontal component, m/s: a first-order
    Gauss-Markov process of correlation time gust_time, s (the longitudinal Dryden spectrum at constant airspeed)."""

    speed: float = 0.0
    gust: float = 0.0
    gust_time: float = 10.0


@dataclass(frozen=True, slots=True)
class Target:
    """speed: m/s, in any direction at first. turn_rate: rad/s. acceleration: RMS of a random walk of the velocity
    held within `speed`, m/s per sqrt(s)."""

    speed: float = 0.0
    turn_rate: float = 0.0
    acceleration: float = 0.0


class Air:
    """Wind of B flights: a mean in a random direction, and gusts."""

    def __init__(self, wind: Wind, flights: int, rng: np.random.Generator) -> None:
        self._wind, self._rng = wind, rng
        angle = rng.uniform(0, 2 * np.pi, flights)
        self._mean = wind.speed * np.stack([np.cos(angle), np.sin(angle)])
        self._gust = wind.gust * rng.standard_normal((2, flights))

    @property
    def velocity(self) -> Array:
        """Now, (2, B)."""
        return self._mean + self._gust

    def step(self, dt: float) -> None:
        """Carry the gusts on, by the exact transition of the process."""
        if self._wind.gust:
            keep = np.exp(-dt / self._wind.gust_time)
            fresh = self._wind.gust * np.sqrt(1 - keep**2) * self._rng.standard_normal(self._gust.shape)
            self._gust = keep * self._gust + fresh


class Targets:
    """Targets of B flights."""

    def __init__(self, target: Target, flights: int, rng: np.random.Generator) -> None:
        self._target, self._rng = target, rng
        angle = rng.uniform(0, 2 * np.pi, flights)
        self._turn = target.turn_rate * rng.choice([-1.0, 1.0], flights)
        self.velocity = target.speed * np.stack([np.cos(angle), np.sin(angle)])

    def step(self, dt: float) -> None:
        """Turn and accelerate."""
        if self._target.turn_rate:
            c, s = np.cos(self._turn * dt), np.sin(self._turn * dt)
            x, y = self.velocity
            self.velocity = np.stack([c * x - s * y, s * x + c * y])
        if self._target.acceleration:
            pushed = self.velocity + self._target.acceleration * np.sqrt(dt) * self._rng.standard_normal(
                self.velocity.shape
            )
            speed = np.maximum(np.hypot(*pushed), 1e-9)
            self.velocity = pushed * np.minimum(self._target.speed / speed, 1.0)


def turn_step(omega: Array, command: Array, lag: float, dt: float) -> tuple[Array, Array]:
    """Turn rate after dt under a held command, and the angle turned: first-order lag, exactly."""
    if lag <= 0:
        return command, command * dt
    keep = np.exp(-dt / lag)
    return command + (omega - command) * keep, command * dt + (omega - command) * lag * (1 - keep)


def flown(V: Array, psi: Array, omega: Array, command: Array, lag: float, dt: float) -> Array:
    """Displacement through the air (2, B) during that step, by three-point Gauss quadrature of the exact heading."""
    total = np.zeros((2, *np.shape(psi)))
    for at, weight in zip(GAUSS_AT, GAUSS_WEIGHT, strict=True):
        heading = psi + turn_step(omega, command, lag, at * dt)[1]
        total += weight * np.stack([np.cos(heading), np.sin(heading)])
    return V * dt * total
