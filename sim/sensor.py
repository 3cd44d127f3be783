"""The ranging sensor: true slant range in, what the radio would report out."""

from random import Random
from typing import NamedTuple

from sim.config import Ranging


class Sample(NamedTuple):
    """One measurement, as long as it is not lost. Seconds and metres."""

    taken_us: int
    distance: float
    sequence: int


class RangeSensor:
    """Noise, bias, outliers, dropouts and the end of the range. Draws the same numbers whatever is configured."""

    def __init__(self, config: Ranging, seed: int) -> None:
        self._config = config
        self._rng = Random(f"{seed}:ranging")
        self._sequence = 0

    def measure(self, true_range: float, now: int) -> Sample | None:
        c, rng = self._config, self._rng
        lost, wild, spread, noise = rng.random(), rng.random(), rng.uniform(-1.0, 1.0), rng.gauss(0.0, 1.0)
        if lost < c.dropout_fraction or true_range > c.max_range_m:
            return None
        distance = true_range + c.bias_m + c.noise_m * noise
        if wild < c.outlier_fraction:
            distance += c.outlier_m * spread
        self._sequence = (self._sequence + 1) % 256
        return Sample(now, max(0.0, distance), self._sequence)


class Rangefinder:
    """The autopilot's rangefinder driver: holds the last value until it is too old."""

    TOO_OLD_US = 450_000

    def __init__(self) -> None:
        self._sample: Sample | None = None
        self._heard = 0

    def update(self, sample: Sample, now: int) -> None:
        self._sample, self._heard = sample, now

    def latest(self, now: int) -> Sample | None:
        return self._sample if self._sample is not None and now - self._heard <= self.TOO_OLD_US else None
