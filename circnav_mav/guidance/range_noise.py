"""How much ranges scatter, whatever their sensor says: drivers fill in a standard deviation of 1 cm, or any other.

Three samples, evenly spaced, bend by |z0 - 2 z1 + z2|: white noise of sigma gives a normal distribution of sqrt(6)
sigma, and the motion at most a dt^2. The lower quartile of many does not mind outliers, each of which spoils three
bends. The same of measured range rates.
"""

from bisect import bisect_left, insort
from collections import deque
from collections.abc import Callable
from math import inf, nan, sqrt

from circnav_mav.guidance.laws import max_range_acceleration

KEPT, ENOUGH = 60, 20
"""Bends from sample to sample that are remembered, and how many it takes at least."""
TOO_MUCH = 3.0
"""What is measured counts where it is so many times what is said: the quartile of 60 bends is some 25 % off, and one
range in ten that is an outlier makes it half as large again."""
WIDE, KEPT_WIDE = 0.4, 200
"""Spacing, s, of the bends that must be small, too, before a sigma is lowered, and how many of them: 20 s at 10 Hz."""
TOO_LITTLE, MARGIN = 3.5, 2.0
"""A sigma is lowered once it is so many times what such bends tell, and then goes by that times the second: they hardly
show the slow part of a radio's error (UWB: a third)."""
EVEN = 0.2
"""Two intervals are the same when they differ by less than this share."""
QUARTILE_OF_NORMAL = 0.3186
"""Lower quartile of |x| for a standard normal x."""
RESOLUTION = 0.01
"""Least standard deviation that a sigma is lowered to, m or m/s: DISTANCE_SENSOR counts centimetres."""
UNIFORM = 0.29
"""Standard deviation of rounding, in steps of the resolution."""
TURN_BUILDS = 0.4
"""Time, s, within which a turn builds up: so fast range accelerations come and go."""
ROUNDING = 1e-6
"""Differences below are rounding."""
FEW, REPEATS = 3, 10
"""Same numbers in a row that tell nothing of the noise, and that it takes at least to call a sensor frozen."""


class NoiseCheck:
    """Corrects what a sensor says of its noise, and notices that it says one number for ever. One for each flight."""

    def __init__(self, bend: Callable[[float], float], patience: float) -> None:
        """bend: the most that motion bends a value so large, per s^2. patience: how long the same number may come, s,
        before the sensor counts as frozen."""
        self._bend_of, self._patience = bend, patience
        self._newest: deque[tuple[float, float]] = deque(maxlen=256)
        self._bends, self._raw, self._wide = _Bends(KEPT), _Bends(KEPT), _Bends(KEPT_WIDE)
        self._step, self._same_since, self._same, self._noise = inf, 0.0, 0, inf
        self.repeated = 0.0
        """How long, s, a frozen sensor has said the same number; 0 for one that is not frozen."""
        self.found: tuple[float, float] | None = None
        """The standard deviations said and measured of the first value that said too little."""
        self.lowered: tuple[float, float] | None = None
        """Those said and used of the first value that said too much."""

    @classmethod
    def of_ranges(cls, speed: float, max_turn_rate: float) -> "NoiseCheck":
        """Of ranges, m, of a vehicle at V (m/s) that turns by no more than that (rad/s)."""
        return cls(lambda r: float(max_range_acceleration(speed, max_turn_rate, r)), patience=10.0)

    @classmethod
    def of_rates(cls, speed: float, max_turn_rate: float) -> "NoiseCheck":
        """Of range rates, m/s."""
        most = float(max_range_acceleration(speed, max_turn_rate, 0.0)) / TURN_BUILDS
        return cls(lambda rate: most, patience=2.0)

    def corrected(self, stamp: float, value: float, sigma: float, *, moving: bool = False) -> float:
        """Standard deviation of a value (measured at stamp, s) that says sigma. moving: whether the vehicle moves, so
        that a sensor cannot go on saying the same."""
        self._repeat(stamp, value, sigma, moving)
        self._bend(stamp, value)
        if len(self._bends) >= ENOUGH and (measured := self._bends.spread) > TOO_MUCH * sigma:
            self.found = self.found or (sigma, measured)
            return measured
        if len(self._wide) < KEPT_WIDE or len(self._raw) < ENOUGH:  # unevenly spaced values have no bends
            return sigma
        measured = max(self._raw.spread, self._wide.spread)
        if self.lowered is None and sigma <= TOO_LITTLE * measured:
            return sigma
        least = max(RESOLUTION, 0.0 if self._step == inf else UNIFORM * self._step)
        lower = min(max(MARGIN * measured, least), sigma)
        self.lowered = self.lowered or (sigma, lower)
        return lower

    def _bend(self, stamp: float, value: float) -> None:
        """Note the bends of the newest values: from one to the next, beyond what motion can do and as they are, and
        those of a wider spacing as they are, which is more than the noise."""
        newest = self._newest
        if len(newest) > 1:
            (oldest, before), (middle, between) = newest[-2], newest[-1]
            last, first = stamp - middle, middle - oldest
            if abs(last - first) < EVEN * first:
                bend = abs(value - 2 * between + before)
                self._resolve(bend)
                self._raw.add(bend)
                self._bends.add(max(bend - self._bend_of(between) * last * first, 0.0))
        newest.append((stamp, value))
        while newest[0][0] < stamp - 4 * WIDE and len(newest) > 2:
            newest.popleft()
        middle, between = self._before(stamp - WIDE)
        oldest, before = self._before(2 * middle - stamp)
        # a sensor that froze has not become quiet
        if self._same < FEW and abs((stamp - middle) - (middle - oldest)) < EVEN * (stamp - middle):
            self._wide.add(abs(value - 2 * between + before))

    def _resolve(self, difference: float) -> None:
        """Of a sensor that counts in steps every difference is some of them, and so is every bend."""
        if difference > ROUNDING:
            self._step = min(self._step, difference)

    def _before(self, time: float) -> tuple[float, float]:
        """The newest value that is not newer than a time; of no moment where there is none."""
        return next((one for one in reversed(self._newest) if one[0] <= time + 1e-6), (nan, nan))

    def _repeat(self, stamp: float, value: float, sigma: float, moving: bool) -> None:
        """Count how often the same number came. A coarse sensor on a steady circle may repeat it for ever: it is frozen
        only if it scattered by more than its resolution before, or never said anything else."""
        before = self._newest[-1][1] if self._newest else None
        if value != before:
            if before is not None:
                self._resolve(abs(value - before))
            self._same = 0
            self._noise = self._raw.spread if len(self._raw) >= ENOUGH else sigma
        if value != before or not moving:
            self._same_since = stamp
        self._same += 1
        same = stamp - self._same_since
        cannot_be = self._step == inf or self._noise > self._step
        frozen = cannot_be and self._same >= REPEATS and same >= self._patience
        self.repeated = same if frozen else 0.0


class _Bends:
    """The newest bends, kept in the order of their size too: to sort them for each range cost more than the filter."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._newest: deque[float] = deque()
        self._by_size: list[float] = []

    def __len__(self) -> int:
        return len(self._newest)

    def add(self, bend: float) -> None:
        """Take in one, and forget the oldest."""
        if len(self._newest) == self._most:
            del self._by_size[bisect_left(self._by_size, self._newest.popleft())]
        self._newest.append(bend)
        insort(self._by_size, bend)

    @property
    def spread(self) -> float:
        """Standard deviation that makes such bends."""
        return self._by_size[len(self) // 4] / (QUARTILE_OF_NORMAL * sqrt(6))
