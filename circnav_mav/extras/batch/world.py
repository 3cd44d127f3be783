"""The vehicles of a batch and what surrounds them: wind, gusts, targets, how a vehicle turns; and random numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from circnav_mav.guidance.maths import Array

BLOCK = 64
"""Draws made at once: a call of numpy costs as much as some hundred numbers."""


class Draws:
    """So many normal and uniform numbers of every flight at a time, (normals + uniforms, B). One seed, one stream; part
    tells the streams of one seed apart."""

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
"""Its weights."""
VEER_TIME, VEER_EVERY = 10.0, 50.0
"""In what time a wind turns, and how often, s."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What flights meet; numbers or arrays (B,). wind: steady part (2, B), m/s. gust: standard deviation of each
    horizontal component, m/s, a first-order Gauss-Markov process of correlation time gust_time, s (the longitudinal
    Dryden spectrum at constant airspeed).

    veer: angle by which the wind turns within VEER_TIME, once in every VEER_EVERY, rad. target_speed (m/s),
    target_course (rad): at first. target_turn: of its course, rad/s. target_push: along its course, m/s^2. target_walk:
    RMS of a random walk of its velocity, held within its first speed, m/s per sqrt(s). stands: time for which the
    target stands, and then goes on for as long, s; 0: it never stands. phase: share of these periods that is over.
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
    """How vehicles turn; numbers or arrays (B,). speed: through the air, m/s. limit: rad/s. lag: first order, s."""

    speed: Array
    limit: Array
    lag: Array


@dataclass(frozen=True, slots=True)
class Truth:
    """What is true: p = vehicle - target (2, B), d = wind - target velocity (2, B), psi, turn_rate (B,)."""

    p: Array
    d: Array
    psi: Array
    turn_rate: Array


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
        self._now, self._steady = 0.0, surroundings.wind

    @property
    def wind(self) -> Array:
        """Now, (2, B), m/s."""
        return self._steady + self._gust

    @property
    def target_velocity(self) -> Array:
        """Now, (2, B), m/s."""
        return self._speed * self._goes * along(self._course)

    @property
    def _goes(self) -> Array:
        """1 where the target is under way, 0 where it stands."""
        w = self._around
        return np.where((self._now / (2 * w.stands) + w.phase) % 1 < 0.5, 1.0, 0.0) if w.stands else 1.0

    @property
    def truth(self) -> Truth:
        """Now."""
        return Truth(self.p, self.wind - self.target_velocity, self.psi, self.turn_rate)

    @property
    def velocity(self) -> Array:
        """Over ground, (2, B), m/s, of those who fly."""
        return self.airframe.speed * along(self.psi) + self.wind * self.carried

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
        self.turn_rate, angle = turn_step(self.turn_rate, goal, a.lag, dt)
        self.psi = self.psi + angle
        w = self._around
        if self._moves:
            way = (self._speed + w.target_push * dt / 2) * dt * along(self._course + w.target_turn * dt / 2)
            self.p = self.p - way * self._goes
            self._speed, self._course = self._speed + w.target_push * dt, self._course + w.target_turn * dt
        self._now += dt
        if np.any(w.veer):  # in the first VEER_TIME of every period
            times, since = np.divmod(self._now + w.phase * VEER_EVERY, VEER_EVERY)
            self._steady = turned(w.wind, w.veer * (times + np.minimum(since / VEER_TIME, 1.0)))
        if self._random:
            draws, kept = self._draws.next(), np.exp(-dt / w.gust_time)
            self._gust = kept * self._gust + w.gust * np.sqrt(1 - kept**2) * draws[:2]  # the process's exact transition
            if np.any(w.target_walk):
                x, y = self.target_velocity + w.target_walk * np.sqrt(dt) * draws[2:]
                self._speed, self._course = np.minimum(np.hypot(x, y), w.target_speed), np.arctan2(y, x)


def along(angle: Array) -> Array:
    """Unit vectors (2, B) at angles (B,), rad."""
    return np.stack([np.cos(angle), np.sin(angle)])


def turned(vector: Array, angle: Array) -> Array:
    """Vectors (2, B) turned to the left by angles (B,), rad."""
    c, s = along(angle)
    return np.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def turn_step(omega: Array, command: Array, lag: Array, dt: float) -> tuple[Array, Array]:
    """Turn rate after dt under a held command, and the angle turned: first-order lag, exactly."""
    late = np.maximum(lag, 1e-9)
    keep = np.exp(-dt / late)
    return command + (omega - command) * keep, command * dt + (omega - command) * late * (1 - keep)


def flown(V: Array, psi: Array, omega: Array, command: Array, lag: Array, dt: float) -> Array:
    """Displacement through the air (2, B) during that step, by three-point Gauss quadrature of the exact heading."""
    headings = (psi + turn_step(omega, command, lag, at * dt)[1] for at in GAUSS_AT)
    return V * dt * sum(weight * along(heading) for weight, heading in zip(GAUSS_WEIGHT, headings, strict=True))
