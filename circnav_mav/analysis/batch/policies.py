"""Estimator and law together, for B flights: what the benchmark flies."""

from typing import Any

import numpy as np

from circnav_mav.analysis.batch.flight import Circle, Seen, True_
from circnav_mav.core.air_path import chord, wrap
from circnav_mav.core.drift_law import DriftGains, drift, drift_gains, mirrored
from circnav_mav.core.estimators.bank import KAPPA, position
from circnav_mav.core.estimators.bank import drift as drift_of
from circnav_mav.core.estimators.drift_bank import BankSettings, DriftBank
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

EXPLORE = "guess"


class Auto:
    """Feedforward on the Kalman filter until the bank is trusted, then the drift law; see `circnav_mav.core.auto`."""

    def __init__(self, circle: Circle, sense: Array) -> None:
        flights = sense.size
        self._circle, self._sense = circle, sense
        self.kalman = BatchKalman(circle.speed, circle.max_turn_rate, flights)
        self.bank = DriftBank(BankSettings(circle.speed), flights)
        self._gains = drift_gains(circle.speed, circle.radius, circle.lag)
        self._psi: Array | None = None
        self._share = np.zeros(flights)
        self.trusted = np.zeros(flights, bool)
        self.estimate: tuple[Array, Array] = (0.0, 0.0)

    def command(self, seen: Seen, true: True_) -> Array:
        cfg, s = self._circle, self._sense
        before = seen.psi if self._psi is None else self._psi
        path = chord(seen.airspeed, before, wrap(seen.psi - before), seen.dt if self._psi is not None else 0.0)
        dt = seen.dt if self._psi is not None else 0.0
        self._psi = seen.psi
        self.kalman.step(dt, seen.z, seen.sigma, seen.arrived)
        self.bank.step(dt, path, seen.z, seen.sigma, seen.arrived)
        self.trusted = self.bank.trusted
        x = self.bank.mean
        V = x[KAPPA] * seen.airspeed
        p, d = position(x), drift_of(x)
        here = mirrored(p, d, seen.psi, seen.turn_rate, s)
        with np.errstate(divide="ignore", invalid="ignore"):
            by_bank = drift(*here, V=np.maximum(V, 1.0), r_d=cfg.radius, max_turn_rate=cfg.max_turn_rate, gains=self._gains)
        by_range = feedforward(self.kalman.r, self.kalman.r_dot, V=cfg.speed, r_d=cfg.radius, k=0.06, gamma=0.15, v_star=0.55 * cfg.speed, r_floor=0.43 * cfg.radius)
        by_range = np.where(self.kalman.ready, by_range, cfg.speed / cfg.radius)
        self._share = np.clip(self._share + np.where(self.trusted, seen.dt, -seen.dt), 0.0, 1.0)
        limit = cfg.max_turn_rate
        self._searched = np.where(self.trusted, 0.0, getattr(self, "_searched", 0.0) + seen.dt)
        if EXPLORE in ("weave", "both"):
            by_range = by_range + np.where(self._searched > 3.0, 0.25 * np.sign(np.sin(2 * np.pi * self._searched / 6)), 0.0)
        if EXPLORE in ("guess", "both"):
            by_bank = by_bank + (np.where(self._searched > 6.0, 0.25 * np.sign(np.sin(2 * np.pi * self._searched / 6)), 0.0) if EXPLORE == "both" else 0.0)
            by_range = np.where((self.bank.stage == 1) & (self._searched > 1.5) , by_bank, by_range)
        omega = np.clip(by_range, -limit, limit)
        omega = omega + self._share * (np.clip(np.where(self.bank.stage==2, by_bank, by_range), -limit, limit) - omega)
        v = V * np.stack([np.cos(seen.psi), np.sin(seen.psi)]) + d
        r = np.hypot(*p)
        self.estimate = np.where(self.trusted, r, self.kalman.r), np.where(self.trusted, (p * v).sum(axis=0) / np.maximum(r, 1e-3), self.kalman.r_dot)
        return s * omega
