"""Estimator and law of many flights at once, each with the numbers of its own mission."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from circnav_mav.experiments.batch.filters import BatchKalman
from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.guidance.laws import LAWS, Kind, Law, pi
from circnav_mav.guidance.step import LONGEST_STEP, LawChoice
from circnav_mav.guidance.types import Orbit

Array = Any


class Circles:
    """What each flight is to fly, (B,): sense (+1 counter-clockwise), speed V (m/s), radius r_d (m) and the radius that
    its law is fed, limit of the turn rate (rad/s), gain k."""

    def __init__(self, runs: Sequence[Run]) -> None:
        orbits, choices = [run.mission.orbit for run in runs], [run.mission.law for run in runs]
        self.sense = np.array([float(orbit.direction.turn_sign) for orbit in orbits])
        self.V: Array = np.array([orbit.speed for orbit in orbits])
        self.r_d: Array = np.array([orbit.radius for orbit in orbits])
        self.limit = np.array([orbit.max_turn_rate for orbit in orbits])
        self.k: Array = np.array([choice.gain for choice in choices])
        self.fed: Array = np.array([_fed(orbit, choice) for orbit, choice in zip(orbits, choices, strict=True)])

    def through_gain(self, turn: Array, gain: Array) -> Array:
        """What to tell vehicles that turn at `gain` times what they are told."""
        return np.clip(turn / gain, -self.limit, self.limit)


class Steering:
    """A law on range and range rate fed by `kalman`. All arrays (B,); turn rates counter-clockwise positive."""

    def __init__(self, runs: Sequence[Run]) -> None:
        circles = self._circles = Circles(runs)
        names = np.array([run.mission.law.name for run in runs])
        self._laws = [(LAWS[name], np.flatnonzero(names == name)) for name in dict.fromkeys(names.tolist())]
        settings = [run.mission.estimation for run in runs]
        self._needed = np.array([s.min_samples for s in settings])
        self._kalman = BatchKalman(circles.V, circles.limit, len(runs), gate=np.array([s.gate for s in settings]))
        self._memory = np.zeros(len(runs))
        self._steered_at = np.full(len(runs), np.nan)
        self.sure_at = np.full(len(runs), -np.inf)

    @property
    def speed(self) -> Array:
        """What each vehicle is told to fly, m/s."""
        return self._circles.V

    @property
    def ready(self) -> Array:
        """Whether the estimate may steer."""
        return self._kalman.informed & (self._kalman.accepted >= self._needed)

    def see(self, now: float, dt: float, z: Array, sigma: Array, arrived: Array) -> None:
        """Let dt pass, s, and take in the ranges that arrived `now`; `sure_at` is when one was last believed."""
        before = self._kalman.accepted
        self._kalman.step(dt, z, sigma, arrived)
        self.sure_at = np.where(arrived & (self._kalman.accepted != before), now, self.sure_at)

    def turn(self, now: float, holding: Array, ours: Array) -> Array:
        """The turn rates wanted at a time, s, within the limit; those that hold fly the circle's own.

        ours: whom the law steers unless they hold; only then does a law with a memory remember.
        """
        c, steers = self._circles, ours & ~holding
        wanted = np.empty_like(c.V)
        since = np.where(steers & ~np.isnan(self._steered_at), np.minimum(now - self._steered_at, LONGEST_STEP), 0.0)
        self._steered_at = np.where(steers, now, self._steered_at)
        for law, mine in self._laws:
            wanted[mine] = self._by(law, mine, since)
        wanted = np.where(holding, c.V / c.r_d, wanted)
        return c.sense * np.clip(wanted, -c.limit, c.limit)

    def _by(self, law: Law, mine: Array, since: Array) -> Array:
        """A law for the flights that fly it, by their numbers. k < 0 is counter-clockwise: that sense, mirrored by the
        caller. since: time that a memory goes on by, s."""
        c, r, r_dot = self._circles, self._kalman.r[mine], self._kalman.r_dot[mine]
        V, k = c.V[mine], -c.k[mine]
        if law.kind is not Kind.MEMORY:
            return law.function(r, r_dot, V=V, r_d=c.fed[mine], k=k)
        before = self._memory[mine]
        turn, self._memory[mine] = pi(r, r_dot, before, since[mine], V=V, r_d=c.r_d[mine], k=k)
        return turn

    def through_gain(self, turn: Array, gain: Array) -> Array:
        """What to tell vehicles that turn at `gain` times what they are told."""
        return self._circles.through_gain(turn, gain)


def _fed(orbit: Orbit, choice: LawChoice) -> float:
    """The radius that the law is fed, m."""
    fed = LAWS[choice.name].fed_radius(orbit.speed, orbit.radius, choice.gain)
    return fed if choice.correct_radius else orbit.radius
