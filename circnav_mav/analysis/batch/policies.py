"""Estimator and law together, for B flights: what the benchmark flies."""

from typing import Any

import numpy as np

from circnav_mav.analysis.batch.flight import Circle, Seen, True_
from circnav_mav.core.air_path import chord, wrap
from circnav_mav.core.drift_law import DriftGains, drift, drift_gains, mirrored
from circnav_mav.core.auto import at_start, hand_over
from circnav_mav.core.estimators.bank import KAPPA, R, position
from circnav_mav.core.estimators.bank import drift as drift_of
from circnav_mav.core.estimators.drift_bank import BankSettings, DriftBank, Stage
from circnav_mav.analysis.batch.filters import BatchKalman
from circnav_mav.core.range_laws import feedforward

Array = Any


class FullInformation:
    """The reference: the same law with the truth in place of an estimate."""

    def __init__(self, circle: Circle, sense: Array) -> None:
        self._circle, self._sense = circle, sense
        self._gains = drift_gains(circle.speed, circle.radius, circle.lag)
        self.estimate: tuple[Array, Array] = (0.0, 0.0)

    def command(self, seen: Seen, true: True_) -> Array:
        self.estimate = np.hypot(*true.p), 0.0
        cfg = self._circle
        here = mirrored(true.p, true.d, true.psi, true.turn_rate, self._sense)
        return self._sense * drift(
            *here, V=cfg.speed, r_d=cfg.radius, max_turn_rate=cfg.max_turn_rate, gains=self._gains
        )

class Auto:
    """What `auto` does in the air, for B flights: the same bank, laws and handover."""

    def __init__(self, circle: Circle, sense: Array) -> None:
        flights = sense.size
        self._circle, self._sense = circle, sense
        self.kalman = BatchKalman(circle.speed, circle.max_turn_rate, flights)
        self.bank = DriftBank(BankSettings(circle.speed), flights)
        self._gains = drift_gains(circle.speed, circle.radius, circle.lag)
        self._psi: Array | None = None
        self.handover = at_start(flights)
        self.estimate: tuple[Array, Array] = (0.0, 0.0)

    def command(self, seen: Seen, true: True_) -> Array:
        cfg, s = self._circle, self._sense
        before, dt = (seen.psi, 0.0) if self._psi is None else (self._psi, seen.dt)
        path = chord(seen.airspeed, before, wrap(seen.psi - before), dt)
        self._psi = seen.psi
        self.kalman.step(dt, seen.z, seen.sigma, seen.arrived)
        self.bank.step(dt, path, seen.z, seen.sigma, seen.arrived)
        x, trusted = self.bank.mean, self.bank.trusted
        V, p, d = x[KAPPA] * seen.airspeed, position(x), drift_of(x)
        here = mirrored(p, d, seen.psi, seen.turn_rate, s)
        known = self.bank.stage != Stage.EMPTY
        by_bank = drift(
            *here, V=np.where(known, V, cfg.speed), r_d=cfg.radius, max_turn_rate=cfg.max_turn_rate, gains=self._gains
        )
        by_range = feedforward(self.kalman.r, self.kalman.r_dot, V=cfg.speed, r_d=cfg.radius, k=0.06, gamma=0.15, v_star=0.55 * cfg.speed, r_floor=0.43 * cfg.radius)
        by_range = np.where(self.kalman.ready, by_range, cfg.speed / cfg.radius)
        self.handover = hand_over(
            self.handover, dt, trusted=trusted, favourite=self.bank.favourite, by_range=by_range, by_bank=by_bank,
            limit=cfg.max_turn_rate,
        )  # fmt: skip
        v = V * np.stack([np.cos(seen.psi), np.sin(seen.psi)]) + d
        r_dot = (p * v).sum(axis=0) / np.maximum(x[R], 1.0)
        self.estimate = np.where(trusted, x[R], self.kalman.r), np.where(trusted, r_dot, self.kalman.r_dot)
        return s * self.handover.command
