"""Estimator and law together, for B flights: what the benchmark flies. The equations are those of the flight."""

from typing import Any

import numpy as np

from circnav_mav.experiments.batch.banks import Banks
from circnav_mav.experiments.batch.filters import BatchKalman
from circnav_mav.experiments.batch.flight import Circle, Make, Seen, Truth
from circnav_mav.guidance.air_path import chord, wrap
from circnav_mav.guidance.estimators.multiple_model import BankSettings, Stage
from circnav_mav.guidance.estimators.relative_ekf import KAPPA, Felt, R, position
from circnav_mav.guidance.estimators.relative_ekf import drift as drift_of
from circnav_mav.guidance.estimators.unicycle import SURE, UnicycleFilter
from circnav_mav.guidance.law_selector import at_start, hand_over, merged
from circnav_mav.guidance.laws import LAWS, Kind, pi
from circnav_mav.guidance.step import LONGEST_STEP
from circnav_mav.guidance.turn_response import Pending, PendingTurn, Response
from circnav_mav.guidance.vector_field import drift, drift_gains, mirrored, orbit_turn_rate

Array = Any
STALE = 0.5
"""Oldest range that may steer, s; the default of `limits.stale_s`."""


class _Freshness:
    """Which flights (B,) have a range that is young enough to steer; the others hold the circle's own turn."""

    def __init__(self, flights: int) -> None:
        self._age = np.full(flights, np.inf)

    def step(self, seen: Seen) -> Array:
        self._age = np.where(seen.arrived, 0.0, self._age + seen.dt)
        return self._age < STALE + 1e-9


class _Answer:
    """What is commanded but not turned yet, of vehicles that answer as their circle says."""

    def __init__(self, circle: Circle) -> None:
        self._response = Response(dead=0.0, lag=circle.lag, settles=1 / circle.lag, learnt=True)
        self._limit, self._pending, self._time = circle.max_turn_rate, PendingTurn(), 0.0

    def pending(self, seen: Seen) -> Pending:
        self._time += seen.dt
        return self._pending.at(self._time, self._response, seen.turn_rate)

    def told(self, command: Array) -> Array:
        """The command, within the limit, as the vehicles are told it."""
        command = np.clip(command, -self._limit, self._limit)
        self._pending.command(self._time, command)
        return command


class FullInformation:
    """The reference: the drift law with the truth in place of an estimate."""

    def __init__(self, circle: Circle, sense: Array) -> None:
        self._circle, self._sense, self._answer = circle, sense, _Answer(circle)
        self.belief: tuple[Array, Array] | None = None
        self.estimate: tuple[Array, Array] = (0.0, 0.0)

    def command(self, seen: Seen, true: Truth) -> Array:
        cfg, r = self._circle, np.hypot(true.p[0], true.p[1])
        v = cfg.speed * np.stack([np.cos(true.psi), np.sin(true.psi)]) + true.d
        self.estimate = r, (true.p * v).sum(axis=0) / np.maximum(r, 1.0)
        pending = self._answer.pending(seen)
        here = mirrored(true.p, true.d, true.psi, pending, self._sense)
        gains = drift_gains(cfg.speed, pending.ahead, pending.settles)
        turn = drift(*here, V=cfg.speed, r_d=cfg.radius, max_turn_rate=cfg.max_turn_rate, gains=gains)
        return self._answer.told(self._sense * turn)


class ByRange:
    """A law on range and range rate, fed by `kalman` or `unicycle`."""

    def __init__(self, circle: Circle, sense: Array, law: str, estimator: str, gain: float | None = None) -> None:
        flights = sense.size
        self._circle, self._sense, self._law = circle, sense, LAWS[law]
        V, r_d = circle.speed, circle.radius
        self._k = self._law.default_gain(V, r_d) if gain is None else gain
        self._fed = self._law.fed_radius(V, r_d, self._k)
        self.belief: tuple[Array, Array] | None = None
        self._memory = np.zeros(flights)
        self._filter = _Unicycle(circle, flights) if estimator == "unicycle" else _Kalman(circle, flights)
        self._freshness = _Freshness(flights)
        self.estimate: tuple[Array, Array] = (0.0, 0.0)

    def command(self, seen: Seen, true: Truth) -> Array:
        cfg = self._circle
        r, r_dot, ready = self._filter.step(seen)
        self.estimate = r, r_dot
        ready = ready & self._freshness.step(seen)
        # k < 0 is counter-clockwise: the command for that sense, then mirrored
        if self._law.kind is Kind.MEMORY:
            turn, memory = pi(r, r_dot, self._memory, seen.dt, V=cfg.speed, r_d=cfg.radius, k=-self._k)
            self._memory = np.where(ready, memory, self._memory)
        else:
            turn = self._law.function(r, r_dot, V=cfg.speed, r_d=self._fed, k=-self._k)
        return self._sense * np.where(ready, turn, cfg.speed / cfg.radius)


class Auto:
    """`auto`, or `drift` alone, which does not try guesses out: the same bank, laws and handover as in the air."""

    def __init__(self, circle: Circle, sense: Array, tries: bool = True) -> None:
        flights = sense.size
        self._circle, self._sense, self._tries = circle, sense, tries
        self._kalman = _Kalman(circle, flights)
        self.bank = Banks(BankSettings(circle.speed), flights)
        self._answer = _Answer(circle)
        self._law = LAWS["feedforward"]
        self._k = self._law.default_gain(circle.speed, circle.radius)
        self._before: tuple[Array, Array] | None = None
        self._freshness, self._unsteered = _Freshness(flights), np.zeros(flights)
        self.handover = at_start(flights)
        self.belief: tuple[Array, Array] | None = None
        self.estimate: tuple[Array, Array] = (0.0, 0.0)

    def command(self, seen: Seen, true: Truth) -> Array:
        cfg, s = self._circle, self._sense
        r, r_dot, ready = self._kalman.step(seen)
        (before, V_before), dt = ((seen.psi, seen.airspeed), 0.0) if self._before is None else (self._before, seen.dt)
        path = chord((V_before + seen.airspeed) / 2, before, wrap(seen.psi - before), dt)
        felt = None
        if seen.felt is not None and self._before is not None:
            air = seen.airspeed * _nose(seen.psi) - V_before * _nose(before)
            felt = Felt(seen.felt, air, dt * (_nose(seen.psi) + _nose(before)) / 2, seen.airspeed * seen.turn_rate)
        self._before = seen.psi, seen.airspeed
        self.bank.step(np.full(s.size, dt), path, seen.z, seen.sigma, seen.arrived, felt)
        x, trusted = self.bank.mean, self.bank.trusted
        V, p, d = x[KAPPA] * seen.airspeed, position(x), drift_of(x)
        pending = self._answer.pending(seen)
        here = mirrored(p, d, seen.psi, pending, s)
        safe = np.where(self.bank.stage == Stage.EMPTY, cfg.speed, np.maximum(V, 0.1 * cfg.speed))
        gains = drift_gains(safe, pending.ahead, pending.settles)
        by_bank = drift(*here, V=safe, r_d=cfg.radius, max_turn_rate=cfg.max_turn_rate, gains=gains)
        by_range = self._law.function(r, r_dot, V=cfg.speed, r_d=cfg.radius, k=-self._k)
        favourite = self.bank.favourite if self._tries else np.full(s.size, -1)
        self._unsteered += seen.dt
        since = np.where(self.handover.flies < 0, 0.0, np.minimum(self._unsteered, LONGEST_STEP))
        after = hand_over(
            self.handover, since, trusted=trusted, favourite=favourite, by_range=by_range, by_bank=by_bank,
            limit=cfg.max_turn_rate, r=np.where(trusted, x[R], r), r_d=cfg.radius,
        )  # fmt: skip
        ready = (ready | trusted) & self._freshness.step(seen)
        self.handover = merged(ready, after, self.handover)  # nothing is handed over before a first command
        self._unsteered[ready] = 0.0
        v = V * np.stack([np.cos(seen.psi), np.sin(seen.psi)]) + d
        by_drift = (p * v).sum(axis=0) / np.maximum(x[R], 1.0)
        P = self.bank.covariance
        self.belief = np.where(trusted, x[:2], np.nan), P[:2, :2]
        self.estimate = np.where(trusted, x[R], r), np.where(trusted, by_drift, r_dot)
        ahead = here[2] + here[3].turn
        hold = np.where(trusted, orbit_turn_rate(here[1], ahead, V=safe, r_d=cfg.radius), cfg.speed / cfg.radius)
        return self._answer.told(s * np.where(ready, self.handover.command, hold))


def _nose(psi: Array) -> Array:
    """Unit vector of headings, (2, B)."""
    return np.stack([np.cos(psi), np.sin(psi)])


class _Kalman:
    def __init__(self, circle: Circle, flights: int) -> None:
        self._filter = BatchKalman(circle.speed, circle.max_turn_rate, flights)
        self._begun = False

    def step(self, seen: Seen) -> tuple[Array, Array, Array]:
        """Range, range rate, and whether they may steer."""
        self._filter.step(seen.dt if self._begun else 0.0, seen.z, seen.sigma, seen.arrived)
        self._begun = True
        return self._filter.r, self._filter.r_dot, self._filter.ready


class _Unicycle:
    def __init__(self, circle: Circle, flights: int) -> None:
        self._filter = UnicycleFilter(5.0, flights)
        self._psi: Array | None = None

    def step(self, seen: Seen) -> tuple[Array, Array, Array]:
        """Range, range rate, and whether they may steer."""
        if self._psi is not None:
            self._filter.predict(seen.airspeed, wrap(seen.psi - self._psi), seen.dt)
        self._psi = seen.psi
        self._filter.update(seen.z, seen.sigma, seen.arrived)
        (r, eta), P = self._filter.likelier
        return r, -seen.airspeed * np.cos(eta), (self._filter.samples >= 5) & (P[1, 1] < SURE**2)


def by_range(law: str, estimator: str) -> Make:
    """A policy by the names of its law and its estimator."""
    return lambda circle, sense: ByRange(circle, sense, law, estimator)


POLICIES: dict[str, Make] = {
    "auto": Auto,
    "drift": lambda circle, sense: Auto(circle, sense, tries=False),
    "feedforward": by_range("feedforward", "kalman"),
    "feedforward+unicycle": by_range("feedforward", "unicycle"),
    "smooth": by_range("smooth", "kalman"),
    "smooth+unicycle": by_range("smooth", "unicycle"),
    "switching": by_range("switching", "kalman"),
    "bounded": by_range("bounded", "kalman"),
    "relay": by_range("relay", "kalman"),
    "pd": by_range("pd", "kalman"),
    "pi": by_range("pi", "kalman"),
    "full information": FullInformation,
}
"""What the benchmark flies, law[+estimator]; without a name the estimator is `kalman`."""
