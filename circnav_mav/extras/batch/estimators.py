"""The estimators of the flight for B flights that are stepped together."""

from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from circnav_mav.extras.batch.range_rate import RangeRate, observe, observe_rate
from circnav_mav.extras.batch.world import Truth, along
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.multiple_model import DriftBank, Stage
from circnav_mav.guidance.estimators.relative_ekf import KAPPA, Felt, R, Rates, drift, position
from circnav_mav.guidance.estimators.unicycle import SURE, UnicycleFilter
from circnav_mav.guidance.maths import Array, chord, wrap
from circnav_mav.guidance.types import RelativeMotion

T = TypeVar("T", bound=tuple[Any, ...])
BLOCK = 250
"""Flights of one bank: one of this size stays in the processor's cache, which is four times as fast."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What flights get in one step, arrays (B,): heading, turn rate and airspeed as reported; range where arrived.
    flies: who is steered by us. felt (2, B): change of the velocity since the step before, m/s, by accelerometers.
    rate: range rates (B,) measured with the ranges that arrived, and their standard deviation, m/s."""

    dt: float
    psi: Array
    turn_rate: Array
    airspeed: Array
    z: Array
    sigma: Array
    arrived: Array
    flies: Array
    felt: Array | None = None
    rate: tuple[Array, float] | None = None


class Estimator(Protocol):
    """r, r_dot (B,): the estimate. ready: who may be steered by it. taken: whose newest range was taken in. relative:
    the relative motion, in arrays. belief: mean (2, B) and covariance (2, 2, B) of (r, theta), nan without trust."""

    r: Array
    r_dot: Array
    ready: Array
    taken: Array
    relative: RelativeMotion | None = None
    belief: tuple[Array, Array] | None = None

    def observe(self, seen: Seen, true: Truth) -> None:
        """Time passes, and ranges come in where they arrived. Only the full information may look at `true`."""
        ...


def merged(which: Array, after: T, before: T) -> T:
    """A frozen state of B flights: after a step for some (mask), before it for the others."""
    if which.all() or not which.any():
        return after if which.any() else before

    def one(new: Any, old: Any) -> Any:
        return merged(which, new, old) if isinstance(new, tuple) else np.where(which, new, old)

    return type(before)(*map(one, after, before))


class Kalman(Estimator):
    """`kalman`. The settings may hold arrays (B,)."""

    def __init__(self, settings: EstimatorSettings, flights: int) -> None:
        self._settings, self._age = settings, np.zeros(flights)
        self._state = RangeRate(*(np.full(flights, value) for value in RangeRate()))
        self.r, self.r_dot = np.zeros((2, flights))
        self.ready, self.taken = np.zeros((2, flights), bool)

    def observe(self, seen: Seen, true: Truth) -> None:
        self._age = self._age + seen.dt
        if seen.arrived.any():
            after = observe(self._state, self._settings, h=self._age, z=seen.z, sigma=seen.sigma)
            if seen.rate is not None:
                after = observe_rate(after, self._settings, h=0.0, z=seen.rate[0], sigma=seen.rate[1])
            self._state = merged(seen.arrived, after, self._state)
            self._age = np.where(seen.arrived, 0.0, self._age)
            self.ready = np.asarray(self._state.ready(self._settings))
        self.taken = seen.arrived & (self._state.refused == 0)
        self.r_dot = np.asarray(self._state.r_dot)
        self.r = self._state.r + self.r_dot * self._age


class Unicycle(Estimator):
    """`unicycle`."""

    def __init__(self, settings: EstimatorSettings, flights: int) -> None:
        self._filter, self._needed = UnicycleFilter(settings.gate, flights), settings.min_samples
        self._psi: Array | None = None

    def observe(self, seen: Seen, true: Truth) -> None:
        if self._psi is not None:
            self._filter.predict(seen.airspeed, wrap(seen.psi - self._psi), seen.dt)
        self._psi = seen.psi
        self._filter.update(seen.z, seen.sigma, seen.arrived)
        if seen.rate is not None:
            self._filter.update_rate(*seen.rate, seen.airspeed, seen.arrived)
        (self.r, eta), P = self._filter.likelier
        self.r_dot = -seen.airspeed * np.cos(eta)
        self.ready = (self._filter.samples >= self._needed) & (P[1, 1] < SURE**2)
        self.taken = seen.arrived & (self._filter.refused == 0)


class Auto(Estimator):
    """`auto`: `kalman` and the bank of relative-motion filters; `drift` flies by the same. Flights are in several banks
    and do not know of each other."""

    def __init__(self, settings: EstimatorSettings, flights: int, speed: float) -> None:
        self._kalman = Kalman(settings, flights)
        cfg = replace(settings, speed=speed, gate=float(np.max(settings.gate)))
        self._parts = [slice(first, min(first + BLOCK, flights)) for first in range(0, flights, BLOCK)]
        self._banks = [DriftBank(cfg, part.stop - part.start) for part in self._parts]
        self._speed = speed
        self._before: tuple[Array, Array] | None = None

    def observe(self, seen: Seen, true: Truth) -> None:
        self._kalman.observe(seen, true)
        psi, before = self._before or (seen.psi, seen.airspeed)
        dt = np.where(seen.flies, 0.0 if self._before is None else seen.dt, 0.0)
        path = chord((before + seen.airspeed) / 2, psi, wrap(seen.psi - psi), dt)
        felt = None
        if seen.felt is not None:
            air, nose = seen.airspeed * along(seen.psi) - before * along(psi), (along(seen.psi) + along(psi)) / 2
            felt = Felt(seen.felt, air, dt * nose, seen.airspeed * seen.turn_rate)
        self._before, valid = (seen.psi, seen.airspeed), seen.arrived & seen.flies
        rates = None
        if seen.rate is not None:
            sigma = np.full(valid.shape, seen.rate[1])
            rates = Rates(seen.rate[0], sigma, valid, seen.airspeed * along(seen.psi))
        for part, bank in zip(self._parts, self._banks, strict=True):
            theirs = None if felt is None else felt.of(part)
            measured = None if rates is None else rates.of(part)
            bank.step(dt[part], path[:, part], seen.z[part], seen.sigma[part], valid[part], theirs, measured)
        x, P, trusted, stage = (self._all(name) for name in ("mean", "covariance", "trusted", "stage"))
        p, d = position(x), drift(x)
        V: Array = np.where(stage == Stage.EMPTY, self._speed, x[KAPPA] * seen.airspeed)
        sigma = np.sqrt(np.maximum(P[0, 0] + x[R] ** 2 * P[1, 1], 0.0))
        self.relative = RelativeMotion(
            p[0], p[1], sigma, d[0], d[1], seen.psi, seen.turn_rate, V, x[KAPPA], trusted, self._all("favourite")
        )
        v = V * along(seen.psi) + d
        r_dot = (p * v).sum(axis=0) / np.maximum(x[R], 1.0)
        self.r, self.r_dot = np.where(trusted, x[R], self._kalman.r), np.where(trusted, r_dot, self._kalman.r_dot)
        self.ready = self._kalman.ready | trusted
        self.taken = np.where(trusted & ~self._all("refused"), valid, self._kalman.taken)
        self.belief = np.where(trusted, x[:2], np.nan), P[:2, :2]

    def _all(self, name: str) -> Array:
        return np.concatenate([getattr(bank, name) for bank in self._banks], axis=-1)


class FullInformation(Estimator):
    """The reference: the truth in place of an estimate."""

    def __init__(self, speed: Array, flights: int) -> None:
        self._speed = speed
        self.ready: Array = np.ones(flights, bool)

    def observe(self, seen: Seen, true: Truth) -> None:
        self.r, self.taken = np.hypot(true.p[0], true.p[1]), self.ready
        v = self._speed * along(true.psi) + true.d
        self.r_dot = (true.p * v).sum(axis=0) / np.maximum(self.r, 1.0)
        (x, y), d = true.p, true.d
        self.relative = RelativeMotion(x, y, 0.0, d[0], d[1], true.psi, seen.turn_rate, self._speed, 1.0, self.ready)
