"""Window of the last seconds of ranges, averaged in short bins, and their white noise."""

from collections import deque
from math import nan
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.estimators.relative_ekf import BIAS_TIME
from circnav_mav.guidance.maths import Vector
from circnav_mav.guidance.white_noise import WhiteNoise, is_even, residual

WIDTH = 0.25
"""Width of a bin, s. Within a bin the range deviates from a straight line by centimeters only."""


class Sample(NamedTuple):
    """One range, or the means of the samples of a bin.

    time: time since the start of the window, s.
    x, y: path flown since the start of the window, m.
    z: range, m.
    """

    time: float
    x: float
    y: float
    z: float


class Bins(NamedTuple):
    """N averaged ranges, newest last, without empty bins.

    age: time since each range, (N,), s.
    path: path flown since each range, (2, N), m.
    z: range, (N,), m.
    variance: variance of the range, (N,), m^2.
    """

    age: NDArray[np.float64]
    path: NDArray[np.float64]
    z: NDArray[np.float64]
    variance: NDArray[np.float64]


class RangeWindow:
    """Bins of ranges. now: time since the start, s. path: flown since the start, m."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._open: list[Sample] = []
        self._opened = 0.0
        # 64: number of stored bins. They cover 16 s, longer than a turn that distinguishes all
        # directions.
        self._bins: deque[tuple[Sample, int] | None] = deque(maxlen=64)
        """Mean and number of the samples of each bin. None: empty bin."""
        self._noise = WhiteNoise()
        self._newest: deque[tuple[float, float]] = deque(maxlen=3)
        """Times and ranges of the newest samples, oldest first."""
        self.now = 0.0
        self.path: Vector = (0.0, 0.0)

    def add(self, dt: float, chord: Vector, z: float | None, sigma: float) -> bool:
        """Advance time by dt and path by chord, and add a range unless it is None. Return True if a
        bin was closed."""
        self.now += dt
        self.path = (self.path[0] + chord[0], self.path[1] + chord[1])
        due = self.now - self._opened >= WIDTH - 1e-9
        if due:
            self._close(sigma)
        if z is not None:
            self._open.append(Sample(self.now, *self.path, z))
            self._newest.append((self.now, z))
            if len(self._newest) == 3 and is_even(*self._newest):
                self._noise.add(residual(*self._newest))
        return due

    def white(self, sigma: float) -> float:
        """Return the standard deviation of the white part of the noise, m. It is at most sigma, and
        equals sigma while there are too few residuals."""
        if not self._noise.enough:
            return sigma
        return min(self._noise.sigma, sigma)

    def bins(self, sigma: float) -> Bins:
        """Return the bins, oldest first. sigma: range noise, m."""
        filled = [one for one in self._bins if one is not None]
        t, x, y, z = np.array([mean for mean, _ in filled]).reshape(-1, 4).T
        count = np.array([count for _, count in filled])
        age = self.now - t
        white = self.white(sigma)
        drifting = max(sigma**2 - 2 * white**2, 0.0)
        # A drifting error is common to the bins within about 2 BIAS_TIME. `common` is their number.
        # A slow radio has few.
        common = 2 * BIAS_TIME * len(filled) / max(age.max(initial=0.0), WIDTH)
        # 0.01: process noise of the drift, m^2/s^3.
        variance = white**2 / count + drifting * common + 0.01 * age**3 / 3
        path = np.array((self.path[0] - x, self.path[1] - y))
        return Bins(age, path, z, variance)

    def _close(self, sigma: float) -> None:
        """Close the open bin: average the samples that are near their median."""
        middle = median(sample.z for sample in self._open) if self._open else nan
        near = self._speed * WIDTH + 4 * sigma
        good = [sample for sample in self._open if abs(sample.z - middle) <= near]
        if good:
            mean = Sample(*(sum(values) / len(good) for values in zip(*good, strict=True)))
            self._bins.append((mean, len(good)))
        else:
            self._bins.append(None)
        self._open.clear()
        self._opened = self.now
