"""Where the targets of many flights are: the bank of each, asked as the `DriftEstimator` of the pilot asks it."""

from typing import Any

import numpy as np

from circnav_mav.analysis.batch.banks import BLOCK
from circnav_mav.analysis.campaign.own_paths import Knots
from circnav_mav.core.estimators.bank import STATES
from circnav_mav.core.estimators.drift import GAP
from circnav_mav.core.estimators.drift_bank import BankSettings, DriftBank, Stage
from circnav_mav.core.estimators.prediction import Belief, Prediction, predict_belief

Array = Any


class Seekers:
    """Arrays (B,): ready, whether the bank could be trusted with its newest range; stage and favourite of the bank;
    beyond, who was without ranges for so long that the pilot would search anew with what it remembers."""

    def __init__(self, speed: Array, gate: Array) -> None:
        count = len(speed)
        self._V = speed
        self._banks: list[tuple[Array, DriftBank]] = []
        for V, sigmas in dict.fromkeys(zip(speed.tolist(), gate.tolist(), strict=True)):
            alike = np.flatnonzero((speed == V) & (gate == sigmas))
            for first in range(0, len(alike), BLOCK):
                who = alike[first : first + BLOCK]
                self._banks.append((who, DriftBank(BankSettings(V, gate=sigmas), len(who))))
        self._trusted = BankSettings(1.0).trusted
        self._time, self._x, self._y = np.full(count, np.nan), np.zeros(count), np.zeros(count)
        self._mean, covariance = np.zeros((STATES, count)), np.zeros((count, STATES, STATES))
        self._belief = Belief(self._mean, covariance, np.zeros(count), np.zeros(count))
        self.ready, self.beyond = np.zeros(count, bool), np.zeros(count, bool)
        self.stage, self.favourite = np.full(count, Stage.EMPTY), np.full(count, -1)

    def observe(self, here: Knots, z: Array, sigma: Array, heard: Array) -> Array:
        """Ranges of some flights (mask), measured here; tells which of them are refused."""
        more = heard & ~np.isnan(self._time)
        dt = np.where(more, here.time - self._time, 0.0)
        chord = np.where(more, [here.x - self._x, here.y - self._y], 0.0)
        self.beyond |= dt > GAP
        refused = np.zeros(len(z), bool)
        for who, bank in self._banks:
            if heard[who].any():
                tracked = bank.stage == Stage.TRACK
                bank.step(dt[who], chord[:, who], z[who], sigma[who], heard[who])
                refused[who] = bank.refused & ~(tracked & (bank.stage != Stage.TRACK))
                self._note(who, bank, heard[who])
        self._time = np.where(heard, here.time, self._time)
        self._x, self._y = np.where(heard, here.x, self._x), np.where(heard, here.y, self._y)
        return refused & heard

    def at(self, here: Knots) -> tuple[Prediction, Array]:
        """What is believed of a moment, and whether it may steer, (B,)."""
        since, chord = here.time - self._time, (here.x - self._x, here.y - self._y)
        at = predict_belief(self._belief, since, chord, heading=here.heading, airspeed=self._V, xp=np)
        return at, self.ready & (at.r_variance / at.r**2 + at.direction_variance < self._trusted**2)

    def _note(self, who: Array, bank: DriftBank, heard: Array) -> None:
        """Keep what the bank believes of those who heard."""
        to, noise, belief = who[heard], bank.likely_noise, self._belief
        self._mean[:, to] = bank.mean[:, heard]
        belief.covariance[to] = np.moveaxis(bank.covariance[..., heard], -1, 0)
        belief.drift_psd[to], belief.gust[to] = noise.drift_psd[0, heard], noise.gust[0, heard]
        self.ready[to], self.stage[to], self.favourite[to] = (
            bank.trusted[heard],
            bank.stage[heard],
            bank.favourite[heard],
        )
