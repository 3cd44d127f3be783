"""The ranging sensor: it converts a true slant range to a measured range."""

import math
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from .config import Ranging


@dataclass(frozen=True)
class Character:
    """Errors of a type of radio in addition to the white noise of the vehicle file: meters,
    seconds, fractions."""

    white: float | None = None  # replaces noise_m
    drift: float = 0.0  # RMS of the slow error, m
    drift_time: float = 2.0
    loss: float = 0.0
    near_bias: float = 0.0  # bias at zero range, m; it falls to 0 at the range `near`
    near: float = 30.0
    gap_rate: float = 0.0  # gaps per second beyond 0.85 of the maximum range
    gap: float = 2.0  # length of a gap, s


# Values from the literature on guidance with ultra-wideband and 2.4 GHz LoRa ranging (SX1280).
CHARACTERS = {
    "gaussian": Character(),
    "uwb": Character(white=0.02, drift=0.15, drift_time=3.0, gap_rate=0.2),
    "lora": Character(white=1.0, drift=2.0, drift_time=5.0, loss=0.1, near_bias=4.0),
}


class Sample(NamedTuple):
    """One measurement: time in microseconds, distance in meters, rate in m/s (positive away from
    the target)."""

    taken_us: int
    distance: float
    sequence: int
    rate: float = 0.0


class RangeSensor:
    """Ranging sensor with noise, drift, bias, outliers, dropouts, gaps and maximum range. Random
    draws do not depend on the settings."""

    def __init__(self, config: Ranging, seed: int) -> None:
        self._config = config
        self._kind = CHARACTERS[config.preset]
        self._rng = Random(f"{seed}:ranging")
        self._sequence = 0
        self._drift = self._kind.drift * self._rng.gauss(0.0, 1.0)
        self._gap_until = 0
        step = 1 / config.rate_hz if config.rate_hz > 0 else 1.0
        self._kept = math.exp(-step / self._kind.drift_time)
        self._gap_chance = self._kind.gap_rate * step

    def _reported(self, true_range: float) -> float:
        """Return the reading without noise, m."""
        table = self._config.table_m
        if len(table) < 2:
            return self._config.scale * true_range + self._config.bias_m
        at = 0
        while at < len(table) - 2 and true_range >= table[at + 1][0]:
            at += 1
        (x0, y0), (x1, y1) = table[at : at + 2]
        return y0 + (true_range - x0) * (y1 - y0) / (x1 - x0)

    def measure(self, true_range: float, now: int) -> Sample | None:
        c = self._config
        kind = self._kind
        rng = self._rng
        lost = rng.random()
        wild = rng.random()
        spread = rng.uniform(-1.0, 1.0)
        gap = rng.random()
        noise = rng.gauss(0.0, 1.0)
        fresh = rng.gauss(0.0, 1.0)
        self._drift = self._kept * self._drift + kind.drift * math.sqrt(1 - self._kept**2) * fresh
        if true_range > 0.85 * c.max_range_m and gap < self._gap_chance:
            self._gap_until = now + round(kind.gap * 1e6)
        if lost < 1 - (1 - c.dropout_fraction) * (1 - kind.loss) or true_range > c.max_range_m:
            return None
        if now < self._gap_until:
            return None
        white = c.noise_m if kind.white is None else kind.white
        distance = self._reported(true_range) + self._drift + white * noise
        distance += kind.near_bias * max(0.0, 1 - true_range / kind.near)
        if wild < c.outlier_fraction:
            distance += c.outlier_m * spread
        self._sequence = (self._sequence + 1) % 256
        return Sample(now, max(0.0, distance), self._sequence)


class DopplerSensor:
    """Sensor of the range rate by the carrier's Doppler shift, with white noise and a slowly
    varying bias from the oscillator's frequency offset."""

    OFFSET_TIME = 60.0  # correlation time of the offset, s

    def __init__(self, config: Ranging, seed: int) -> None:
        self._config = config
        self._rng = Random(f"{seed}:doppler")
        self._offset = config.rate_bias_mps * self._rng.gauss(0.0, 1.0)
        self._kept = (
            math.exp(-1 / (self.OFFSET_TIME * config.rate_hz)) if config.rate_hz > 0 else 1.0
        )

    def measure(self, true_rate: float) -> float:
        c = self._config
        rng = self._rng
        white = rng.gauss(0.0, 1.0)
        fresh = rng.gauss(0.0, 1.0)
        self._offset = (
            self._kept * self._offset + c.rate_bias_mps * math.sqrt(1 - self._kept**2) * fresh
        )
        return true_rate + self._offset + c.rate_noise_mps * white
