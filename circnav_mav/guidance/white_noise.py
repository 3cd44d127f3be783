"""White noise of measured values, from second differences, which motion hardly affects.

A residual is the difference of the middle of three values from the line through its neighbors.
The residual is scaled so that white noise of standard deviation sigma gives residuals of standard
deviation sigma. An outlier spoils three residuals. A quantile of many magnitudes tolerates some
spoiled residuals: the lower quartile tolerates more than the median, but the median scatters less.
"""

from collections import deque
from collections.abc import Sequence
from math import ceil, nan, sqrt
from statistics import NormalDist

FAR = 5.0
"""Magnitude of a residual above which the first pass discards it as an outlier, in standard
deviations by the median of all residuals."""
BULK = 3.5
"""Magnitude of a residual above which the second pass discards it, in standard deviations by the
median of the residuals that are left."""
Moment = tuple[float, float]
"""Time and value."""


def is_even(before: Moment, middle: Moment, after: Moment) -> bool:
    """Return True if the steps between the times are equal."""
    first = middle[0] - before[0]
    last = after[0] - middle[0]
    # 0.19: largest relative difference of two equal time steps. A lost sample causes a much larger
    # difference.
    return abs(last - first) < 0.19 * first


def residual(before: Moment, middle: Moment, after: Moment) -> float:
    """Return the scaled difference of the middle value from the line through its neighbors, in the
    unit of the values.

    An acceleration a over steps h contributes a h^2/sqrt(6).
    """
    share = (middle[0] - before[0]) / (after[0] - before[0])
    line = before[1] + share * (after[1] - before[1])
    return (middle[1] - line) / sqrt(1 + share**2 + (1 - share) ** 2)


def quantile(values: Sequence[float], share: float) -> float:
    """Return a quantile of the values, or NaN without values. A quantile between two values is
    their mean."""
    if not values:
        return nan
    rank = share * len(values)
    ordered = sorted(values)
    return (ordered[ceil(rank) - 1] + ordered[int(rank)]) / 2


def bulk_sigma(residuals: Sequence[float]) -> float:
    """Return the standard deviation of residuals without outliers. For fifty values, the root mean
    square of the bulk scatters by 14 %, a result from its median by 20 %."""
    sizes = [abs(one) for one in residuals]
    bulk = sizes
    for reach in (FAR, BULK):
        # 1.4826: ratio of standard deviation to median magnitude of normal noise.
        most = reach * 1.4826 * quantile(bulk, 0.5)
        bulk = [size for size in sizes if size <= most]
    return sqrt(sum(size**2 for size in bulk) / len(bulk))


class WhiteNoise:
    """Stores the newest residuals, and estimates the white noise. count: number of residuals so
    far."""

    def __init__(self, kept: int, share: float) -> None:
        """kept: number of residuals kept. share: quantile of their magnitudes, 0 to 1, that gives
        sigma."""
        self._sizes: deque[float] = deque(maxlen=kept)
        self._share = share
        self._of_normal = NormalDist().inv_cdf((1 + share) / 2)
        self.count = 0

    def add(self, residual: float) -> None:
        """Add one residual."""
        self._sizes.append(abs(residual))
        self.count += 1

    @property
    def sigma(self) -> float:
        """Standard deviation of the white noise; NaN before the first residual."""
        return quantile(self._sizes, self._share) / self._of_normal
