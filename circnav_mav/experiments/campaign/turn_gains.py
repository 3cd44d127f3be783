"""The learnt turn-rate gain of many flights at once: the equations of `circnav_mav.guidance.turn_gain`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.guidance.air_path import wrap
from circnav_mav.guidance.turn_gain import DEAF, LEAST_COMMAND, TurnGainSettings
from circnav_mav.guidance.types import SAME_TIME

Array = Any
ATTITUDE_EVERY = 0.05
"""Time, s, from one ATTITUDE to the next, as asked for."""


class TurnGains:
    """Realised over commanded turn rate, (B,); 1 at first, or for ever what the mission says."""

    def __init__(self, runs: Sequence[Run], step: float) -> None:
        learns = [run.mission.file.vehicle.turn_gain == "learn" for run in runs]
        told = [1.0 if learn else run.mission.file.vehicle.turn_gain for run, learn in zip(runs, learns, strict=True)]
        settings = TurnGainSettings()
        lags = np.array([run.mission.file.vehicle.turn_lag_s for run in runs])
        self._settings, self._step = settings, step
        self._fixed = ~np.array(learns)
        self._follow = np.where(lags > 0, 1 - np.exp(-step / np.maximum(lags, 1e-9)), 1.0)
        self._smooth = 1 - np.exp(-step / settings.smoothing)
        self._forget = np.exp(-step / settings.memory)
        self.now = np.array(told, float)
        self._heading = np.full(len(runs), np.nan)
        self._rate, self._lagged, self._command = (np.zeros(len(runs)) for _ in range(3))
        self._age, self._square, self._product = (np.zeros(len(runs)) for _ in range(3))

    def feel(self, now: float, heading: Array, told: Array, ours: Array) -> None:
        """One heading of each flight that is ours, measured while it was told to turn at `told`, rad/s."""
        if not ours.any():
            return
        first, cfg, step = ours & np.isnan(self._heading), self._settings, self._step
        more = ours & ~first
        turned = wrap(heading - self._heading)
        lagged = self._lagged + (told - self._lagged) * self._follow
        command = self._command + (lagged - self._command) * self._smooth
        rate = self._rate + (turned / step - self._rate) * self._smooth
        self._lagged = np.where(first, told, np.where(more, lagged, self._lagged))
        self._command = np.where(first, told, np.where(more, command, self._command))
        self._rate = np.where(first, told, np.where(more, rate, self._rate))
        self._age = self._age + np.where(more, step, 0.0)
        self._heading = np.where(ours, heading, self._heading)
        size = np.abs(self._command)
        followed = (size < LEAST_COMMAND) | (self._rate * np.sign(self._command) > DEAF * size)
        self._age = np.where(more & ~followed, 0.0, self._age)
        learns = more & followed & (self._age >= 4 * cfg.smoothing - SAME_TIME)
        square = self._square * self._forget + self._command**2 * step
        product = self._product * self._forget + self._command * self._rate * step
        self._square, self._product = np.where(learns, square, self._square), np.where(learns, product, self._product)
        gain = np.clip((self._product + cfg.prior) / (self._square + cfg.prior), cfg.lowest, cfg.highest)
        self.now = np.where(learns & ~self._fixed, gain, self.now)
