"""Check of the standard deviation that a sensor reports with its ranges, or range rates: drivers fill in 1 cm, or any
other number. `white_noise` measures it."""

from collections import deque
from collections.abc import Callable
from math import inf, nan, sqrt

from circnav_mav.guidance.laws import max_range_acceleration
from circnav_mav.guidance.white_noise import WhiteNoise, is_even, residual

KEPT, ENOUGH, QUARTILE = 60, 20, 0.25
"""Residuals from sample to sample that are kept, the fewest that count, and the quantile of them that does."""
TOO_MUCH = 3.0
"""The measured sigma replaces a reported one that it exceeds by this factor: the quartile of 60 residuals is some 25 %
off, and one range in ten that is an outlier makes it half as large again."""
WIDE, KEPT_WIDE = 0.4, 200
"""Spacing, s, of the residuals that must be small, too, before a sigma is lowered, and their number: 20 s at 10 Hz."""
TOO_LITTLE, MARGIN = 3.5, 2.0
"""A sigma that is so many times the measured one is lowered to the measured one times the second: residuals hardly
show the slow part of a radio's error (UWB: a third)."""
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
        self._still, self._raw, self._wide = (WhiteNoise(kept, QUARTILE) for kept in (KEPT, KEPT, KEPT_WIDE))
        """Residuals beyond what motion can do, as they are, and those of a wider spacing."""
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
        if self._still.count[0] >= ENOUGH and (measured := float(self._still.sigma[0])) > TOO_MUCH * sigma:
            self.found = self.found or (sigma, measured)
            return measured
        if self._wide.count[0] < KEPT_WIDE or self._raw.count[0] < ENOUGH:  # uneven values have no residuals
            return sigma
        measured = max(float(self._raw.sigma[0]), float(self._wide.sigma[0]))
        if self.lowered is None and sigma <= TOO_LITTLE * measured:
            return sigma
        least = max(RESOLUTION, 0.0 if self._step == inf else UNIFORM * self._step)
        lower = min(max(MARGIN * measured, least), sigma)
        self.lowered = self.lowered or (sigma, lower)
        return lower

    def _bend(self, stamp: float, value: float) -> None:
        """Note the residuals of the newest values."""
        newest, now = self._newest, (stamp, value)
        if len(newest) > 1 and is_even(newest[-2], newest[-1], now):
            (oldest, before), (middle, between) = newest[-2], newest[-1]
            self._resolve(abs(value - 2 * between + before))
            off = abs(residual(newest[-2], newest[-1], now))
            self._raw.add(off)
            by_motion = self._bend_of(between) * (stamp - middle) * (middle - oldest) / sqrt(6)
            self._still.add(max(off - by_motion, 0.0))
        newest.append(now)
        while newest[0][0] < stamp - 4 * WIDE and len(newest) > 2:
            newest.popleft()
        halfway = self._before(stamp - WIDE)
        begin = self._before(2 * halfway[0] - stamp)
        # a sensor that froze has not become quiet
        if self._same < FEW and is_even(begin, halfway, now):
            self._wide.add(residual(begin, halfway, now))

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
            self._noise = float(self._raw.sigma[0]) if self._raw.count[0] >= ENOUGH else sigma
        if value != before or not moving:
            self._same_since = stamp
        self._same += 1
        same = stamp - self._same_since
        cannot_be = self._step == inf or self._noise > self._step
        frozen = cannot_be and self._same >= REPEATS and same >= self._patience
        self.repeated = same if frozen else 0.0
