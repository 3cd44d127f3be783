"""The estimators of the flight stack for B flights that are stepped together."""

from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from circnav_mav.extras.batch.range_rate import RangeRate, observe, observe_rate
from circnav_mav.extras.batch.world import Truth, along
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.multiple_model import MultipleModelFilter, Stage
from circnav_mav.guidance.estimators.relative_ekf import KAPPA, R, Rates, VelocityChange, drift, position
from circnav_mav.guidance.estimators.unicycle import SURE, UnicycleFilter
from circnav_mav.guidance.maths import Array, chord, wrap
from circnav_mav.guidance.types import RelativeMotion

T = TypeVar("T", bound=tuple[Any, ...])
BLOCK = 250
"""Flights per filter object: this size fits into the processor's cache, which is four times as fast."""


@dataclass(frozen=True, slots=True)
class Measurements:
    """Measurements of one step, arrays (B,).

    psi, turn_rate, airspeed: as reported. z, sigma: range and its standard deviation, valid where `arrived`.
    flies: True for flights under control. velocity_change (2, B): change of the velocity since the previous step,
    measured by accelerometers, m/s. rate: range rates (B,) measured with the ranges, and their standard deviation, m/s.
    """

    dt: float
    psi: Array
    turn_rate: Array
    airspeed: Array
    z: Array
    sigma: Array
    arrived: Array
    flies: Array
    velocity_change: Array | None = None
    rate: tuple[Array, float] | None = None


class Estimator(Protocol):
    """Estimator of B flights.

    r, r_dot (B,): the estimate. ready: True if it may steer. taken: True if the newest range was accepted. relative:
    the relative motion, in arrays. belief: mean (2, B) and covariance (2, 2, B) of (r, theta), NaN if not trusted.
    """

    r: Array
    r_dot: Array
    ready: Array
    taken: Array
    relative: RelativeMotion | None = None
    belief: tuple[Array, Array] | None = None

    def observe(self, measured: Measurements, true: Truth) -> None:
        """Advance by one step with its measurements. Only `FullInformation` may use `true`."""
        ...


def merged(which: Array, after: T, before: T) -> T:
    """Return the state `after` a step for the flights in the mask `which`, the state `before` it for the others."""
    if which.all() or not which.any():
        return after if which.any() else before

    def one(new: Any, old: Any) -> Any:
        return merged(which, new, old) if isinstance(new, tuple) else np.where(which, new, old)

    return type(before)(*map(one, after, before))


class Kalman(Estimator):
    """The estimator `kalman`. The settings may contain arrays (B,)."""

    def __init__(self, settings: EstimatorSettings, flights: int) -> None:
        self._settings, self._age = settings, np.zeros(flights)
        self._state = RangeRate(*(np.full(flights, value) for value in RangeRate()))
        self.r, self.r_dot = np.zeros((2, flights))
        self.ready, self.taken = np.zeros((2, flights), bool)

    def observe(self, measured: Measurements, true: Truth) -> None:
        self._age = self._age + measured.dt
        if measured.arrived.any():
            after = observe(self._state, self._settings, h=self._age, z=measured.z, sigma=measured.sigma)
            if measured.rate is not None:
                after = observe_rate(after, self._settings, h=0.0, z=measured.rate[0], sigma=measured.rate[1])
            self._state = merged(measured.arrived, after, self._state)
            self._age = np.where(measured.arrived, 0.0, self._age)
            self.ready = np.asarray(self._state.ready(self._settings))
        self.taken = measured.arrived & (self._state.refused == 0)
        self.r_dot = np.asarray(self._state.r_dot)
        self.r = self._state.r + self.r_dot * self._age


class Unicycle(Estimator):
    """The estimator `unicycle`."""

    def __init__(self, settings: EstimatorSettings, flights: int) -> None:
        self._filter, self._needed = UnicycleFilter(settings.gate, flights), settings.min_samples
        self._psi: Array | None = None

    def observe(self, measured: Measurements, true: Truth) -> None:
        if self._psi is not None:
            self._filter.predict(measured.airspeed, wrap(measured.psi - self._psi), measured.dt)
        self._psi = measured.psi
        self._filter.update(measured.z, measured.sigma, measured.arrived)
        if measured.rate is not None:
            self._filter.update_rate(*measured.rate, measured.airspeed, measured.arrived)
        (self.r, eta), P = self._filter.likelier
        self.r_dot = -measured.airspeed * np.cos(eta)
        self.ready = (self._filter.samples >= self._needed) & (P[1, 1] < SURE**2)
        self.taken = measured.arrived & (self._filter.refused == 0)


class Auto(Estimator):
    """The estimator `auto`: `kalman` and the relative-motion filter. The law `drift` uses it as well.

    The flights are distributed over several filter objects for speed. They do not affect each other.
    """

    def __init__(self, settings: EstimatorSettings, flights: int, speed: float) -> None:
        self._kalman = Kalman(settings, flights)
        cfg = replace(settings, speed=speed, gate=float(np.max(settings.gate)))
        self._parts = [slice(first, min(first + BLOCK, flights)) for first in range(0, flights, BLOCK)]
        self._banks = [MultipleModelFilter(cfg, part.stop - part.start) for part in self._parts]
        self._speed = speed
        self._before: tuple[Array, Array] | None = None

    def observe(self, measured: Measurements, true: Truth) -> None:
        self._kalman.observe(measured, true)
        psi, before = self._before or (measured.psi, measured.airspeed)
        dt = np.where(measured.flies, 0.0 if self._before is None else measured.dt, 0.0)
        path = chord((before + measured.airspeed) / 2, psi, wrap(measured.psi - psi), dt)
        felt = None
        if measured.velocity_change is not None:
            air = measured.airspeed * along(measured.psi) - before * along(psi)
            nose = (along(measured.psi) + along(psi)) / 2
            felt = VelocityChange(measured.velocity_change, air, dt * nose, measured.airspeed * measured.turn_rate)
        self._before, valid = (measured.psi, measured.airspeed), measured.arrived & measured.flies
        rates = None
        if measured.rate is not None:
            sigma = np.full(valid.shape, measured.rate[1])
            rates = Rates(measured.rate[0], sigma, valid, measured.airspeed * along(measured.psi))
        for part, bank in zip(self._parts, self._banks, strict=True):
            part_change = None if felt is None else felt.of(part)
            rate_part = None if rates is None else rates.of(part)
            bank.step(
                dt[part], path[:, part], measured.z[part], measured.sigma[part], valid[part], part_change, rate_part
            )
        x, P, trusted, stage = (self._all(name) for name in ("mean", "covariance", "trusted", "stage"))
        p, d = position(x), drift(x)
        V: Array = np.where(stage == Stage.EMPTY, self._speed, x[KAPPA] * measured.airspeed)
        sigma = np.sqrt(np.maximum(P[0, 0] + x[R] ** 2 * P[1, 1], 0.0))
        self.relative = RelativeMotion(
            p[0],
            p[1],
            sigma,
            d[0],
            d[1],
            measured.psi,
            measured.turn_rate,
            V,
            x[KAPPA],
            trusted,
            self._all("most_likely"),
        )
        v = V * along(measured.psi) + d
        r_dot = (p * v).sum(axis=0) / np.maximum(x[R], 1.0)
        self.r, self.r_dot = np.where(trusted, x[R], self._kalman.r), np.where(trusted, r_dot, self._kalman.r_dot)
        self.ready = self._kalman.ready | trusted
        self.taken = np.where(trusted & ~self._all("refused"), valid, self._kalman.taken)
        self.belief = np.where(trusted, x[:2], np.nan), P[:2, :2]

    def _all(self, name: str) -> Array:
        return np.concatenate([getattr(bank, name) for bank in self._banks], axis=-1)


class FullInformation(Estimator):
    """The truth instead of an estimate, as a reference."""

    def __init__(self, speed: Array, flights: int) -> None:
        self._speed = speed
        self.ready: Array = np.ones(flights, bool)

    def observe(self, measured: Measurements, true: Truth) -> None:
        self.r, self.taken = np.hypot(true.p[0], true.p[1]), self.ready
        v = self._speed * along(true.psi) + true.d
        self.r_dot = (true.p * v).sum(axis=0) / np.maximum(self.r, 1.0)
        (x, y), d = true.p, true.d
        self.relative = RelativeMotion(
            x, y, 0.0, d[0], d[1], true.psi, measured.turn_rate, self._speed, 1.0, self.ready
        )
