"""Check of the standard deviation (sigma) that a sensor reports with its ranges, or range rates.

Many drivers report an arbitrary constant, such as 1 cm. `white_noise` measures the true sigma from
residuals: deviations of a value from the line through its neighbors.
"""

from collections import deque
from collections.abc import Callable
from math import inf, nan, sqrt

from circnav_mav.guidance.laws import max_range_acceleration
from circnav_mav.guidance.white_noise import KEPT, WhiteNoise, is_even, residual

WIDE = 0.4
"""Spacing, s, of the samples of wide residuals. A reported sigma is lowered only if these
residuals are small, too."""
KEPT_WIDE = 200
"""Number of wide residuals that are stored, and needed to lower a sigma: 20 s at 10 Hz."""
TOO_LITTLE = 3.5
"""A reported sigma above this factor times the measured sigma is lowered."""
MARGIN = 2.0
"""A lowered sigma is this factor times the measured sigma. The margin covers the slow part of a
radio's error (a third for UWB), which residuals hardly show."""
FEW = 3
"""Number of equal values in a row from which the wide residuals do not use them."""
REPEATS = 10
"""Fewest equal values in a row of a frozen sensor."""


class NoiseCheck:
    """Corrects the sigma that a sensor reports, and detects a sensor frozen at one value. One
    instance per flight."""

    def __init__(self, bend: Callable[[float], float], patience: float) -> None:
        """bend: function from a value to the largest second derivative (per s^2) that motion can
            cause.
        patience: duration of equal values, s, after which the sensor counts as frozen.
        """
        self._bend_of = bend
        self._patience = patience
        self._newest: deque[tuple[float, float]] = deque(maxlen=KEPT_WIDE)
        self._still = WhiteNoise()
        """Residuals of consecutive samples, minus the largest contribution of motion."""
        self._raw = WhiteNoise()
        """Residuals of consecutive samples, motion included."""
        self._wide = WhiteNoise(KEPT_WIDE)
        """Residuals of samples that are WIDE apart."""
        self._differences: deque[float] = deque(maxlen=2 * KEPT)
        """Newest differences and second differences of the values, without those that are 0."""
        self._same_since = 0.0
        self._same = 0
        self._noise = inf
        self.repeated = 0.0
        """Time for which a frozen sensor has repeated its value, s; 0 if it is not frozen."""
        self.found: tuple[float, float] | None = None
        """Reported and measured sigma of the first value whose reported sigma was too small."""
        self.lowered: tuple[float, float] | None = None
        """Reported and used sigma of the first value whose reported sigma was too large."""

    @classmethod
    def of_ranges(cls, speed: float, max_turn_rate: float) -> "NoiseCheck":
        """Return the check for ranges (m) of a vehicle with this speed (m/s) and turn-rate limit
        (rad/s)."""
        return cls(lambda r: max_range_acceleration(speed, max_turn_rate, r), patience=10.0)

    @classmethod
    def of_rates(cls, speed: float, max_turn_rate: float) -> "NoiseCheck":
        """Return the check for range rates (m/s)."""
        # 0.5: time, s, in which a turn builds up. It bounds the rate of change of the range
        # acceleration.
        most = max_range_acceleration(speed, max_turn_rate, 0.0) / 0.5
        return cls(lambda rate: most, patience=2.0)

    def corrected(self, stamp: float, value: float, sigma: float, *, moving: bool = False) -> float:
        """Return the standard deviation to use for a value measured at stamp (s) with a reported
        sigma.

        moving: True if the vehicle moves, so that a working sensor cannot repeat its value.
        """
        self._repeat(stamp, value, sigma, moving)
        self._bend(stamp, value)
        if self._still.enough:
            measured = self._still.sigma
            # Use the measured sigma instead of the reported one if it is larger by this factor. The
            # median of 60 residuals has an error of about 18 %, and 10 % outliers increase it by
            # half.
            if measured > 3.0 * sigma:
                self.found = self.found or (sigma, measured)
                return measured
        # Without enough residuals (there are none at uneven intervals), use the reported sigma.
        if self._wide.count < KEPT_WIDE or not self._raw.enough:
            return sigma
        # The error of rounding is uniform over a step of the resolution. Without this term, the
        # measured sigma of coarsely rounded values may be 0.
        rounding = 0.0 if self._step == inf else self._step / (2 * sqrt(3))
        measured = max(self._raw.sigma, self._wide.sigma, rounding)
        if self.lowered is None and sigma <= TOO_LITTLE * measured:
            return sigma
        # 0.01: lower bound of a lowered sigma, m or m/s: DISTANCE_SENSOR has a resolution of 1 cm.
        lower = min(max(MARGIN * measured, 0.01), sigma)
        self.lowered = self.lowered or (sigma, lower)
        return lower

    def _bend(self, stamp: float, value: float) -> None:
        """Add the residuals of the newest values."""
        newest = self._newest
        now = (stamp, value)
        if len(newest) > 1 and is_even(newest[-2], newest[-1], now):
            oldest, before = newest[-2]
            middle, between = newest[-1]
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
        # Repeated values of a frozen sensor do not show low noise.
        if self._same < FEW and is_even(begin, halfway, now):
            self._wide.add(residual(begin, halfway, now))

    @property
    def _step(self) -> float:
        """Estimated resolution of the sensor; inf if only one value was received. Differences and
        second differences of the values are multiples of the resolution."""
        return min(self._differences, default=inf)

    def _resolve(self, difference: float) -> None:
        """Add a difference of values. Equal values do not show the resolution."""
        # 1e-6: largest difference that is a rounding error.
        if difference > 1e-6:
            self._differences.append(difference)

    def _before(self, time: float) -> tuple[float, float]:
        """Return the newest (time, value) up to a time, or NaN."""
        return next((one for one in reversed(self._newest) if one[0] <= time + 1e-6), (nan, nan))

    def _repeat(self, stamp: float, value: float, sigma: float, moving: bool) -> None:
        """Count equal values in a row."""
        # A coarse sensor on a steady circle may repeat a value without end. It is frozen only if
        # its noise exceeded its resolution before, or if no other value was ever received.
        before = self._newest[-1][1] if self._newest else None
        if value != before:
            if before is not None:
                self._resolve(abs(value - before))
            self._same = 0
            self._noise = self._raw.sigma if self._raw.enough else sigma
        if value != before or not moving:
            self._same_since = stamp
        self._same += 1
        same = stamp - self._same_since
        cannot_be = self._step == inf or self._noise > self._step
        frozen = cannot_be and self._same >= REPEATS and same >= self._patience
        self.repeated = same if frozen else 0.0
