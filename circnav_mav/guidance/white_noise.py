"""White noise of measured values, from second differences, which motion hardly affects.

Of three values the middle one differs from the line through its neighbors by a residual. It is scaled so that white
noise of standard deviation sigma gives residuals of sigma. An outlier spoils three residuals: a quantile of many
magnitudes tolerates some of them, the lower quartile more than the median, which scatters less.
"""

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from circnav_mav.guidance.maths import Array, Batch, Flag, Pair, magnitude, sqrt

EVEN = 0.19
"""Largest relative difference of equal time steps. Ratios after lost samples are far from this bound."""
FAR, BULK = 5.0, 3.5
"""Bounds for outliers, in standard deviations: by the median of all residuals, then by the median of the rest."""
MAD = 1.4826
"""Ratio of standard deviation to median magnitude of normal noise."""
FIRST = np.zeros(1, int)
"""Index of the one flight of a scalar."""
Moment = Pair
"""(time, value) of one flight, or arrays (2, B) for many flights."""


def is_even(before: Moment, middle: Moment, after: Moment) -> Flag:
    """Return True if the steps between the times are equal."""
    first, last = middle[0] - before[0], after[0] - middle[0]
    return magnitude(last - first) < EVEN * first


def residual(before: Moment, middle: Moment, after: Moment) -> Array:
    """Return the scaled difference of the middle value from the line through its neighbors, in the unit of the values.

    An acceleration a over steps h contributes a h^2/sqrt(6).
    """
    share = (middle[0] - before[0]) / (after[0] - before[0])
    line = before[1] + share * (after[1] - before[1])
    return (middle[1] - line) / sqrt(1 + share**2 + (1 - share) ** 2)


def quantile(values: Batch, share: float) -> Batch:
    """Return a quantile of each column of (n, B) without its NaN; NaN for an empty one. Between two values it is their
    mean. `np.nanquantile` takes ten times as long for a few values."""
    rank = share * np.isfinite(values).sum(axis=0)
    ordered, column = np.sort(values, axis=0), np.arange(values.shape[1])
    return np.asarray((ordered[np.ceil(rank).astype(int) - 1, column] + ordered[rank.astype(int), column]) / 2)


def bulk_sigma(residuals: Sequence[float]) -> float:
    """Return the standard deviation of residuals without outliers. The root mean square of the bulk scatters less than
    its median: 14 instead of 20 % at fifty values."""
    sizes = bulk = np.abs(residuals)
    for reach in (FAR, BULK):
        bulk = sizes[sizes <= reach * MAD * quantile(bulk[:, None], 0.5)]
    return float(np.sqrt(np.mean(bulk**2)))


class WhiteNoise:
    """Newest residuals of B flights. count (B,): number of residuals so far."""

    def __init__(self, kept: int, share: float, flights: int = 1) -> None:
        """kept: residuals of each flight. share: the quantile of them that is used."""
        self._sizes, self._share = np.full((kept, flights), np.nan), share
        self._of_normal = NormalDist().inv_cdf((1 + share) / 2)
        self.count = np.zeros(flights, int)

    def add(self, residuals: Array, at: Batch = FIRST) -> None:
        """Add one residual for each of the flights `at` (n,)."""
        self._sizes[self.count[at] % len(self._sizes), at] = abs(residuals)
        self.count[at] += 1

    @property
    def sigma(self) -> Batch:
        """Standard deviation of the white noise (B,); NaN before the first residual."""
        return quantile(self._sizes, self._share) / self._of_normal
