"""Window of the last seconds of ranges, averaged in short bins, and their white noise. The last
axis B is over flights. Each flight has its own clock."""

from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.estimators.relative_ekf import BIAS_TIME
from circnav_mav.guidance.maths import Batch
from circnav_mav.guidance.white_noise import WhiteNoise, is_even, quantile, residual

WIDTH = 0.25
"""Width of a bin, s: within it the range deviates from a straight line by centimeters only."""
SLOTS = 8
"""Samples kept per bin. More would hardly improve the average."""
COUNT = 64
"""Bins kept: 16 s, more than a turn needs to distinguish all directions."""
ROUGH = 40
ROUGH_ENOUGH = 16
"""Residuals kept to measure the white part of the noise, and fewest that are used."""
DRIFT_PSD = 0.01
"""Process noise of the drift, m^2/s^3."""


class Bins(NamedTuple):
    """N averaged ranges of B flights, newest last, shape (B, N): age (s), path (2, B, N) flown
    since (m), range z (m) and its variance (m^2, infinite for an empty bin)."""

    age: Batch
    path: Batch
    z: Batch
    variance: Batch


class RangeWindow:
    """Bins of B flights that are stepped together."""

    def __init__(self, flights: int, speed: float) -> None:
        self._speed = speed
        self._open = np.full((4, SLOTS, flights), np.nan)
        self._filled = np.zeros(flights, int)
        self._opened = np.zeros(flights)
        self._bins = np.zeros((5, COUNT, flights))
        self._bins[4] = np.inf
        self._closed = np.zeros(flights, int)
        self._noise = WhiteNoise(ROUGH, 0.5, flights)
        self._newest = np.full((2, 2, flights), np.nan)
        """Times and ranges of the newest two samples, oldest first."""
        self.now = np.zeros(flights)
        self.path = np.zeros((2, flights))

    def add(self, dt: Batch, chord: Batch, z: Batch, sigma: Batch, valid: Batch) -> Batch:
        """Advance time by dt (B,) and path by chord (2, B), and add the valid ranges. Return True,
        (B,), for flights whose bin was closed."""
        self.now = self.now + dt
        self.path = self.path + chord
        due = self.now - self._opened >= WIDTH - 1e-9
        if due.any():
            self._close(np.flatnonzero(due), sigma)
        if valid.any():
            at = np.flatnonzero(valid)
            self._open[:, self._filled[at] % SLOTS, at] = np.array([self.now, *self.path, z])[:, at]
            self._filled[at] += 1
            self._roughen(z, valid)
        return due

    def white(self, sigma: Batch) -> Batch:
        """Return the standard deviation of the white part of the noise, m, (B,): sigma until enough
        was measured."""
        return np.where(
            self._noise.count >= ROUGH_ENOUGH, np.minimum(self._noise.sigma, sigma), sigma
        )

    def bins(self, at: Batch, sigma: Batch) -> Bins:
        """Return the bins of the flights with the indices `at`, oldest first. sigma: range noise of
        all flights, m."""
        closed = self._closed[at]
        used = min(closed.max(initial=0), COUNT)
        order = (
            closed - used + np.arange(used)[:, None]
        ) % COUNT  # includes empty bins for flights with fewer bins
        t, x, y, z, n = self._bins[:, order, at]
        age = self.now[at] - t
        white = self.white(sigma)[at]
        drifting = np.maximum(sigma[at] ** 2 - 2 * white**2, 0.0)
        # A drifting error is common to the bins of about 2 BIAS_TIME. A slow radio leaves some of
        # them empty.
        share = np.isfinite(n).sum(axis=0) / np.clip(closed, 1, COUNT)
        variance = white**2 * n + drifting * share * 2 * BIAS_TIME / WIDTH + DRIFT_PSD * age**3 / 3
        path = self.path[:, None, at] - np.stack([x, y])
        return Bins(age.T, np.swapaxes(path, 1, 2), z.T, np.maximum(variance, 1e-4).T)

    def filled(self, at: Batch) -> Batch:
        """Return the number of bins with at least one sample, for each of the flights with the
        indices `at`."""
        return np.isfinite(self._bins[4][:, at]).sum(axis=0)

    def _roughen(self, z: Batch, valid: Batch) -> None:
        """Record the residual of equally spaced samples."""
        three = [*self._newest, np.array([self.now, z])]
        at = np.flatnonzero(valid & is_even(*three))
        self._noise.add(residual(*(moment[:, at] for moment in three)), at)
        self._newest = np.where(valid, three[1:], self._newest)

    def _close(self, at: Batch, sigma: Batch) -> None:
        """Close the open bins of the flights with the indices `at`: average the samples that are
        near their median."""
        open_ = self._open[..., at]
        z = open_[3]
        good = np.abs(z - quantile(z, 0.5)) <= self._speed * WIDTH + 4 * sigma[at]
        count = good.sum(axis=0)
        slot = self._closed[at] % COUNT
        with np.errstate(invalid="ignore", divide="ignore"):
            self._bins[:4, slot, at] = np.where(
                count > 0, np.where(good, open_, 0.0).sum(axis=1) / count, 0.0
            )
            self._bins[4, slot, at] = np.where(count > 0, 1.0 / count, np.inf)
        self._closed[at] += 1
        self._open[..., at] = np.nan
        self._filled[at], self._opened[at] = 0, self.now[at]
