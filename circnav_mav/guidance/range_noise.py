"""Whether ranges scatter more than their sensor says: drivers fill in a standard deviation of 1 cm, or any other.

Three samples in a row, evenly spaced, bend by |z0 - 2 z1 + z2|: white noise of sigma gives a normal distribution of
sqrt(6) sigma, and the motion at most a dt^2, which is taken off. The lower quartile of many does not mind outliers,
each of which spoils three bends.
"""

from collections import deque
from math import sqrt

KEPT, ENOUGH = 60, 20
"""Bends that are remembered, and how many it takes at least."""
TOO_MUCH = 3.0
"""What is measured counts where it is so many times what is said: the quartile of 60 bends is some 25 % off, and one
range in ten that is an outlier makes it half as large again."""
EVEN = 0.2
"""Two intervals are the same when they differ by less than this share."""
QUARTILE_OF_NORMAL = 0.3186
"""Lower quartile of |x| for a standard normal x."""


class NoiseCheck:
    """Corrects what ranges say of their noise, upwards only. One for each flight."""

    def __init__(self, speed: float, max_turn_rate: float) -> None:
        """speed: V, m/s. max_turn_rate: rad/s."""
        self._speed, self._max_turn_rate = speed, max_turn_rate
        self._before: deque[tuple[float, float]] = deque(maxlen=2)
        self._bends: deque[float] = deque(maxlen=KEPT)
        self.found: tuple[float, float] | None = None
        """The standard deviations said and measured, m, of the first range that said too little."""

    def inflate(self, stamp: float, r: float, sigma: float) -> float:
        """Standard deviation, m, of a range r (m; measured at stamp, s) that says sigma (m): as measured, where it says
        less than a third of that."""
        self._bend(stamp, r)
        if len(self._bends) < ENOUGH:
            return sigma
        measured = sorted(self._bends)[len(self._bends) // 4] / (QUARTILE_OF_NORMAL * sqrt(6))
        if measured <= TOO_MUCH * sigma:
            return sigma
        self.found = self.found or (sigma, measured)
        return measured

    def _bend(self, stamp: float, r: float) -> None:
        """Note the bend of the newest three ranges beyond what motion can do."""
        if len(self._before) == 2:
            (oldest, r_oldest), (middle, r_middle) = self._before
            last, first = stamp - middle, middle - oldest
            if abs(last - first) < EVEN * first:
                acceleration = self._speed**2 / max(r_middle, self._speed / self._max_turn_rate)
                motion = (acceleration + self._speed * self._max_turn_rate) * last * first
                self._bends.append(max(abs(r - 2 * r_middle + r_oldest) - motion, 0.0))
        self._before.append((stamp, r))
