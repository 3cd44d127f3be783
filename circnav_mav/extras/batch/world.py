"""Vehicles of a batch, wind, gusts, targets, and random numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from circnav_mav.guidance.maths import Array

BLOCK = 64
"""Draws per call of numpy: a call costs as much as some hundred numbers."""


class Draws:
    """Normal and uniform random numbers of every flight, (normals + uniforms, B) per step.

    Each flight has its own stream. `part` distinguishes the streams of one seed.
    """

    def __init__(self, seeds: Sequence[Sequence[int]], part: int, normals: int, uniforms: int = 0) -> None:
        self._streams = [np.random.default_rng([*seed, part]) for seed in seeds]
        self._normals, self._uniforms, self._at = normals, uniforms, BLOCK
        self._block = np.empty((BLOCK, normals + uniforms, len(seeds)))

    def next(self) -> Array:
        if self._at == BLOCK:
            for flight, stream in enumerate(self._streams):
                self._block[:, : self._normals, flight] = stream.standard_normal((BLOCK, self._normals))
                self._block[:, self._normals :, flight] = stream.random((BLOCK, self._uniforms))
            self._at = 0
        self._at += 1
        return self._block[self._at - 1]


GAUSS_AT = np.array([0.5 - np.sqrt(15) / 10, 0.5, 0.5 + np.sqrt(15) / 10])
"""Places of the Gauss-Legendre rule with three points on 0 to 1, exact to the fifth degree."""
GAUSS_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18
"""Weights of this Gauss-Legendre rule."""
VEER_TIME, VEER_EVERY = 10.0, 50.0
"""Duration of a turn of the wind, and its period, s."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Wind and targets; numbers or arrays (B,).

    wind: steady part (2, B), m/s. gust: standard deviation of each horizontal component, m/s. Gusts are a first-order
    Gauss-Markov process of correlation time gust_time, s (the longitudinal Dryden spectrum at constant airspeed).
    veer: angle by which the wind turns within VEER_TIME, once per VEER_EVERY, rad.

    target_speed (m/s), target_course (rad): initial values. target_turn: turn rate of the course, rad/s. target_push:
    acceleration along the course, m/s^2. target_walk: RMS of a random walk of the velocity, limited to the initial
    speed, m/s per sqrt(s). stands: time for which the target moves and then stops, in turn, s; 0: it never stops.
    phase: initial phase of these periods and of those of veer, 0 to 1.
    """

    wind: Array
    gust: Array = 0.0
    gust_time: Array = 10.0
    target_speed: Array = 0.0
    target_course: Array = 0.0
    target_turn: Array = 0.0
    target_push: Array = 0.0
    target_walk: Array = 0.0
    veer: Array = 0.0
    stands: float = 0.0
    phase: Array = 0.0


@dataclass(frozen=True, slots=True)
class Airframe:
    """Dynamics; numbers or arrays (B,). speed: airspeed, m/s. limit: turn-rate limit, rad/s. lag: turn lag, s."""

    speed: Array
    limit: Array
    lag: Array


@dataclass(frozen=True, slots=True)
class Truth:
    """True state: p = vehicle - target (2, B), d = wind - target velocity (2, B), psi, turn_rate (B,)."""

    p: Array
    d: Array
    psi: Array
    turn_rate: Array


class World:
    """B vehicles and their targets. p: vehicle - target (2, B), m. psi, turn_rate: of the vehicles (B,).

    carried (B,): 1 if the vehicle drifts with the wind.
    """

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
        self._now, self._steady = 0.0, surroundings.wind

    @property
    def wind(self) -> Array:
        """Present wind, (2, B), m/s."""
        return self._steady + self._gust

    @property
    def target_velocity(self) -> Array:
        """Present velocity of the targets, (2, B), m/s."""
        return self._speed * self._goes * along(self._course)

    @property
    def _goes(self) -> Array:
        """1 where the target moves, 0 where it has stopped."""
        w = self._around
        return np.where((self._now / (2 * w.stands) + w.phase) % 1 < 0.5, 1.0, 0.0) if w.stands else 1.0

    @property
    def truth(self) -> Truth:
        """Present true state."""
        return Truth(self.p, self.wind - self.target_velocity, self.psi, self.turn_rate)

    @property
    def velocity(self) -> Array:
        """Velocity over the ground, (2, B), m/s, of flights under control."""
        return self.airframe.speed * along(self.psi) + self.wind * self.carried

    @property
    def r(self) -> Array:
        """Horizontal range, (B,), m."""
        return np.hypot(self.p[0], self.p[1])

    @property
    def r_dot(self) -> Array:
        """Horizontal range rate, (B,), m/s, of flights under control."""
        v = self.velocity - self.target_velocity
        return (self.p * v).sum(axis=0) / np.maximum(self.r, 1e-9)

    def step(self, dt: float, command: Array, flies: Array = 1.0) -> None:
        """Advance by dt with constant commands, rad/s. flies (B,): 1 or 0; a vehicle with 0 hovers."""
        a = self.airframe
        goal = np.clip(command, -a.limit, a.limit) * flies
        way = flown(a.speed * flies, self.psi, self.turn_rate, goal, a.lag, dt)
        self.p = self.p + way + self.wind * (self.carried * flies * dt)
        self.turn_rate, angle = turn_step(self.turn_rate, goal, a.lag, dt)
        self.psi = self.psi + angle
        w = self._around
        if self._moves:
            way = (self._speed + w.target_push * dt / 2) * dt * along(self._course + w.target_turn * dt / 2)
            self.p = self.p - way * self._goes
            self._speed, self._course = self._speed + w.target_push * dt, self._course + w.target_turn * dt
        self._now += dt
        if np.any(w.veer):  # the wind turns in the first VEER_TIME of every period
            times, since = np.divmod(self._now + w.phase * VEER_EVERY, VEER_EVERY)
            self._steady = turned(w.wind, w.veer * (times + np.minimum(since / VEER_TIME, 1.0)))
        if self._random:
            draws, kept = self._draws.next(), np.exp(-dt / w.gust_time)
            self._gust = kept * self._gust + w.gust * np.sqrt(1 - kept**2) * draws[:2]  # the process's exact transition
            if np.any(w.target_walk):
                x, y = self.target_velocity + w.target_walk * np.sqrt(dt) * draws[2:]
                self._speed, self._course = np.minimum(np.hypot(x, y), w.target_speed), np.arctan2(y, x)


def along(angle: Array) -> Array:
    """Return the unit vectors (2, B) at angles (B,), rad."""
    return np.stack([np.cos(angle), np.sin(angle)])


def turned(vector: Array, angle: Array) -> Array:
    """Return the vectors (2, B) turned to the left by angles (B,), rad."""
    c, s = along(angle)
    return np.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def turn_step(omega: Array, command: Array, lag: Array, dt: float) -> tuple[Array, Array]:
    """Return turn rate and turned angle after dt with a constant command: the exact first-order lag."""
    late = np.maximum(lag, 1e-9)
    keep = np.exp(-dt / late)
    return command + (omega - command) * keep, command * dt + (omega - command) * late * (1 - keep)


def flown(V: Array, psi: Array, omega: Array, command: Array, lag: Array, dt: float) -> Array:
    """Return the displacement through the air (2, B) in a step as in `turn_step`, by 3-point Gauss quadrature."""
    headings = (psi + turn_step(omega, command, lag, at * dt)[1] for at in GAUSS_AT)
    return V * dt * sum(weight * along(heading) for weight, heading in zip(GAUSS_WEIGHT, headings, strict=True))
