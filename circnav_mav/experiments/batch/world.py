"""The vehicles of a batch and what surrounds them: wind, gusts, targets, and how a vehicle turns."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from circnav_mav.experiments.batch.draws import Draws

Array = Any
GAUSS_AT = np.array([0.5 - np.sqrt(15) / 10, 0.5, 0.5 + np.sqrt(15) / 10])
GAUSS_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What flights meet; numbers or arrays (B,). wind: steady part (2, B), m/s. gust: standard deviation of each
    horizontal component, m/s, a first-order Gauss-Markov process of correlation time gust_time, s (the longitudinal
    Dryden spectrum at constant airspeed).

    target_speed (m/s), target_course (rad): at first. target_turn: of its course, rad/s. target_push: along its course,
    m/s^2. target_walk: RMS of a random walk of its velocity, held within its first speed, m/s per sqrt(s).
    """

    wind: Array
    gust: Array = 0.0
    gust_time: Array = 10.0
    target_speed: Array = 0.0
    target_course: Array = 0.0
    target_turn: Array = 0.0
    target_push: Array = 0.0
    target_walk: Array = 0.0


@dataclass(frozen=True, slots=True)
class Airframe:
    """How vehicles turn; numbers or arrays (B,). speed: through the air, m/s. limit: rad/s. lag: first order, s."""

    speed: Array
    limit: Array
    lag: Array


class World:
    """B vehicles under way. p: vehicle - target (2, B), m. psi, turn_rate: of the vehicle (B,). carried (B,): 1 where
    the wind carries a vehicle."""

    def __init__(
        self, surroundings: Surroundings, airframe: Airframe, p: Array, psi: Array, seeds: Sequence[Sequence[int]],
        carried: Array = 1.0,
    ) -> None:  # fmt: skip
        flights = len(seeds)
        self._around, self.airframe, self.carried = surroundings, airframe, carried
        self.p, self.psi, self.turn_rate = p, psi, np.zeros(flights)
        self._speed = surroundings.target_speed + np.zeros(flights)
        self._course = surroundings.target_course + np.zeros(flights)
        self._moves = bool(np.any(surroundings.target_speed) or np.any(surroundings.target_push))
        self._random = bool(np.any(surroundings.gust) or np.any(surroundings.target_walk))
        self._draws = Draws(seeds, 0, 4)
        self._gust = surroundings.gust * self._draws.next()[:2]

    @property
    def wind(self) -> Array:
        """Now, (2, B), m/s."""
        return self._around.wind + self._gust

    @property
    def target_velocity(self) -> Array:
        """Now, (2, B), m/s."""
        return self._speed * _along(self._course)

    @property
    def drift(self) -> Array:
        """Wind less target velocity, (2, B), m/s."""
        return self.wind - self.target_velocity

    @property
    def velocity(self) -> Array:
        """Over ground, (2, B), m/s, of those who fly."""
        return self.airframe.speed * _along(self.psi) + self.wind * self.carried

    @property
    def r(self) -> Array:
        """Horizontal range, (B,), m."""
        return np.hypot(self.p[0], self.p[1])

    @property
    def r_dot(self) -> Array:
        """Its rate, (B,), m/s, of those who fly."""
        v = self.velocity - self.target_velocity
        return (self.p * v).sum(axis=0) / np.maximum(self.r, 1e-9)

    def step(self, dt: float, command: Array, flies: Array = 1.0) -> None:
        """Go on for dt under held commands, rad/s; who does not fly (0) hovers."""
        a = self.airframe
        goal = np.clip(command, -a.limit, a.limit) * flies
        way = flown(a.speed * flies, self.psi, self.turn_rate, goal, a.lag, dt)
        self.p = self.p + way + self.wind * (self.carried * flies * dt)
        self.turn_rate, turned = turn_step(self.turn_rate, goal, a.lag, dt)
        self.psi = self.psi + turned
        if self._moves:
            self._move_targets(dt)
        if self._random:
            self._draw(dt)

    def _move_targets(self, dt: float) -> None:
        w = self._around
        self.p = self.p - (self._speed + w.target_push * dt / 2) * dt * _along(self._course + w.target_turn * dt / 2)
        self._speed, self._course = self._speed + w.target_push * dt, self._course + w.target_turn * dt

    def _draw(self, dt: float) -> None:
        """New gusts, by the exact transition of the process, and pushes of the targets."""
        w, draws = self._around, self._draws.next()
        kept = np.exp(-dt / w.gust_time)
        self._gust = kept * self._gust + w.gust * np.sqrt(1 - kept**2) * draws[:2]
        if np.any(w.target_walk):
            x, y = self.target_velocity + w.target_walk * np.sqrt(dt) * draws[2:]
            self._speed, self._course = np.minimum(np.hypot(x, y), w.target_speed), np.arctan2(y, x)


def _along(angle: Array) -> Array:
    """Unit vectors (2, B)."""
    return np.stack([np.cos(angle), np.sin(angle)])


def turn_step(omega: Array, command: Array, lag: Array, dt: float) -> tuple[Array, Array]:
    """Turn rate after dt under a held command, and the angle turned: first-order lag, exactly."""
    late = np.maximum(lag, 1e-9)
    keep = np.exp(-dt / late)
    return command + (omega - command) * keep, command * dt + (omega - command) * late * (1 - keep)


def flown(V: Array, psi: Array, omega: Array, command: Array, lag: Array, dt: float) -> Array:
    """Displacement through the air (2, B) during that step, by three-point Gauss quadrature of the exact heading."""
    headings = (psi + turn_step(omega, command, lag, at * dt)[1] for at in GAUSS_AT)
    return V * dt * sum(weight * _along(heading) for weight, heading in zip(GAUSS_WEIGHT, headings, strict=True))
