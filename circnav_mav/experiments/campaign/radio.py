"""The emulator's ranging radio for many flights at once, up to the sample that the pilot makes of its message."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from circnav_mav.experiments.campaign.draws import Uniforms, gauss
from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.guidance.slant import MAX_SIGMA_GROWTH
from sim.sensor import CHARACTERS

Array = Any


class Radio:
    """True slant ranges in; horizontal ranges, their standard deviations and which of them count, out. All (B,)."""

    def __init__(self, runs: Sequence[Run]) -> None:
        configs = [run.vehicle.ranging for run in runs]
        kinds = [CHARACTERS[config.preset] for config in configs]
        self._uniforms = Uniforms([run.vehicle.seed for run in runs], "ranging", 6)
        self._message = runs[0].mission.file.ranging.message
        self._farthest = _array(c.max_range_m for c in configs)
        self._bias, self._wild = _array(c.bias_m for c in configs), _array(c.outlier_fraction for c in configs)
        self._outlier, self._stamp = _array(c.outlier_m for c in configs), _array(c.noise_m for c in configs)
        self._white = _array(c.noise_m if k.white is None else k.white for c, k in zip(configs, kinds, strict=True))
        self._loss = 1 - (1 - _array(c.dropout_fraction for c in configs)) * (1 - _array(k.loss for k in kinds))
        self._wander, self._near_bias = _array(k.drift for k in kinds), _array(k.near_bias for k in kinds)
        self._near, self._gap = _array(k.near for k in kinds), _array(k.gap for k in kinds)
        step = 1 / configs[0].rate_hz
        self._gap_chance = step * _array(k.gap_rate for k in kinds)
        self._kept = np.exp(-step / _array(k.drift_time for k in kinds))
        self._reports = np.array([c.report_accuracy for c in configs])
        self._least = _array(run.mission.file.ranging.min_range_m for run in runs)
        self._most = _array(run.mission.max_range for run in runs)
        self._sigma = _array(run.mission.file.ranging.sigma_m for run in runs)
        self._height = _array(run.mission.file.orbit.height_above_target_m or 0.0 for run in runs)
        first, self._sine = gauss(*self._uniforms.first(2))
        self._drift = self._wander * first
        self._deaf_until = np.zeros(len(runs))

    def measure(self, slant: Array, now: float) -> tuple[Array, Array, Array]:
        """One sample of each radio, by the equations of the emulator's sensor; `now` in s."""
        lost, wild, spread, gap, turn, size = self._uniforms.next()
        noise = self._sine
        fresh, self._sine = gauss(turn, size)
        self._drift = self._kept * self._drift + self._wander * np.sqrt(1 - self._kept**2) * fresh
        begins = (slant > 0.85 * self._farthest) & (gap < self._gap_chance)
        self._deaf_until = np.where(begins, now + self._gap, self._deaf_until)
        heard = (lost >= self._loss) & (slant <= self._farthest) & (now >= self._deaf_until)
        z = slant + self._bias + self._drift + self._white * noise
        z = z + self._near_bias * np.maximum(0.0, 1 - slant / self._near)
        z = z + np.where(wild < self._wild, self._outlier * (2 * spread - 1), 0.0)
        return self._read(np.maximum(z, 0.0), heard)

    def _read(self, z: Array, heard: Array) -> tuple[Array, Array, Array]:
        """What a message can carry of it, and what the pilot's reader accepts and makes of that."""
        z, sigma = self._carried(z)
        if self._message == "distance_sensor":
            heard = heard & (z < np.rint(100 * self._farthest) / 100) & (z < 655.35)
        heard = heard & (z > 0) & (z >= self._least) & (z <= self._most)
        flat = z**2 - self._height**2
        rho = np.sqrt(np.maximum(flat, 1e-9))
        growth = np.where(self._height > 0, z / rho, 1.0)
        rho = np.where(self._height > 0, rho, z)
        overhead = (self._height > 0) & ((flat <= 0) | (growth > MAX_SIGMA_GROWTH))
        return rho, sigma * growth, heard & ~overhead

    def _carried(self, z: Array) -> tuple[Array, Array]:
        """Range as the message has it, m, and the standard deviation that it tells or leaves to the mission."""
        if self._message == "distance_sensor":
            variance = np.maximum(1, np.rint((self._stamp * 100) ** 2))
            told = np.where(variance < 255, np.sqrt(variance) / 100, self._sigma)
            return np.minimum(np.rint(100 * z), 65535) / 100, np.where(self._reports, told, self._sigma)
        if self._message == "ranging_beacon":
            told = np.maximum(1, np.rint(self._stamp * 1000)) / 1000
            return np.rint(1000 * z) / 1000, np.where(self._reports, told, self._sigma)
        return z.astype(np.float32).astype(float), self._sigma


def _array(values: Any) -> Array:
    return np.array(list(values), float)
