"""White noise of measured values, from second differences, which motion hardly affects.

A residual is the difference of the middle of three values from the line through its neighbors.
The residual is scaled so that white noise of standard deviation sigma gives residuals of standard
deviation sigma. An outlier spoils three residuals. The median of many magnitudes tolerates some
spoiled residuals.
"""

from collections import deque
from collections.abc import Sequence
from math import nan, sqrt
from statistics import median

KEPT = 60
"""Number of residuals that are stored."""
ENOUGH = 20
"""Fewest residuals from which the white noise is estimated."""
MEDIAN = 0.6745
"""Ratio of median magnitude to standard deviation of normal noise."""
BULK = 4.0
"""Magnitude of a residual above which it is discarded as an outlier, in standard deviations by the
median of the residuals."""
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


def bulk_sigma(residuals: Sequence[float]) -> float:
    """Return the standard deviation of residuals without outliers. For fifty values, the root mean
    square of the bulk scatters by 14 %, a result from its median by 20 %."""
    bulk = [abs(one) for one in residuals]
    # Outliers also increase the median. The second pass uses the median without the outliers of the
    # first pass.
    for _ in range(2):
        most = BULK * median(bulk) / MEDIAN
        bulk = [size for size in bulk if size <= most]
    return sqrt(sum(size**2 for size in bulk) / len(bulk))


class WhiteNoise:
    """Stores the newest residuals, and estimates the white noise. count: number of residuals so
    far."""

    def __init__(self, kept: int = KEPT) -> None:
        """kept: number of residuals that are stored."""
        self._sizes: deque[float] = deque(maxlen=kept)
        self.count = 0

    def add(self, residual: float) -> None:
        """Add one residual."""
        self._sizes.append(abs(residual))
        self.count += 1

    @property
    def enough(self) -> bool:
        """True after ENOUGH residuals."""
        return self.count >= ENOUGH

    @property
    def sigma(self) -> float:
        """Standard deviation of the white noise; NaN before the first residual."""
        return median(self._sizes) / MEDIAN if self._sizes else nan
