"""Consistency check of measured range rates with the ranges: z = r - (integral of the rate) must
stay constant.

A rate with a wrong sign, a wrong scale, a frozen value or a bias makes z diverge. While z stays
constant, such an error is harmless. The slope of z over some seconds is the error of the rate. The
slope is the median over pairs of ranges half the span apart, as in the Theil-Sen estimator. The
median is robust to outliers.
"""

from collections import deque
from math import pi, sqrt
from statistics import median
from typing import NamedTuple

QUICK = 2.5
"""Span of the slope that shows large errors, s."""
SLOW = 15.0
"""Span of the slope that shows a bias, s."""
APART = 0.1
"""Shortest time between two stored ranges, s."""
GAP = 1.0
"""Gap between rates, s, after which their integral restarts."""
SURE = 4.0
"""A slope of z above this number of standard deviations shows a wrong rate. The number is large
because slopes are tested ten times a second, for hours."""
RETRY = 10.0
"""Time, s, for which a rejected rate must agree with the ranges before the rate is trusted again.
The time doubles with each rejection."""


class RateCheck:
    """Compares slant range rates with slant ranges on one clock. One instance per flight."""

    def __init__(self) -> None:
        self.reset()
        self.trusted = True
        """True while the rates are used."""
        self.why = ""
        """Human-readable reason of the last rejection."""
        self._retry = RETRY / 2
        self._opposite = False
        self._agreed = self._judged_at = 0.0

    def reset(self) -> None:
        """Discard the stored ranges and rates, after a gap or a change of the clock: new values are
        not comparable with them."""
        self._integral = 0.0
        self._rate: tuple[float, float] | None = None
        self._ranges: deque[tuple[float, float, float]] = deque()
        self.bias = 0.0
        """Recent bias of the rates, m/s, as estimated from the ranges."""

    def add_rate(self, stamp: float, rate: float) -> None:
        """Add a measured rate (m/s) at stamp (s)."""
        if self._rate is not None:
            step = stamp - self._rate[0]
            if not 0 <= step <= GAP:
                self.reset()
            else:
                self._integral += step * (rate + self._rate[1]) / 2
        self._rate = stamp, rate

    def add_range(self, stamp: float, r: float, sigma: float, rate_sigma: float) -> None:
        """Add a range (m) at stamp (s), with the standard deviations of ranges (m) and rates
        (m/s)."""
        if self._rate is None or abs(stamp - self._rate[0]) > GAP:
            return
        if self._ranges and stamp - self._ranges[-1][0] < APART - 1e-3:
            return
        change = self._integral + (stamp - self._rate[0]) * self._rate[1]
        self._ranges.append((stamp, r - change, r))
        while self._ranges[0][0] < stamp - SLOW - 1e-3:
            self._ranges.popleft()
        self._judge(stamp, sigma, rate_sigma)

    def _judge(self, now: float, sigma: float, rate_sigma: float) -> None:
        slopes = [
            slope for span in (QUICK, SLOW) if (slope := self._slope(now, span, sigma)) is not None
        ]
        # 2.0: additional tolerance, in standard deviations of the rate.
        wrong = next((s for s in slopes if abs(s.off) > SURE * s.sigma + 2.0 * rate_sigma), None)
        step = now - self._judged_at
        self._judged_at = now
        if wrong is not None:
            self._agreed = 0.0
            if self.trusted:
                self.trusted = False
                self._retry *= 2
                self.why = wrong.words
            self._opposite = wrong.opposite
            self.reset()
        elif slopes and not self.trusted:
            # An opposite sign is not observable while the range hardly changes, as on the circle.
            shows = not self._opposite or abs(slopes[0].change) > SURE * slopes[0].sigma
            self._agreed += min(step, GAP) if shows else 0.0
            self.trusted = self._agreed > self._retry
        if len(slopes) == 2 and wrong is None:  # weighted by the variances of rate and slope
            slow = slopes[1]
            self.bias = slow.off * rate_sigma**2 / (rate_sigma**2 + slow.sigma**2)

    def _slope(self, now: float, span: float, sigma: float) -> "_Slope | None":
        """Return the slope over a span (s), or None if the ranges do not cover it."""
        kept = [one for one in self._ranges if one[0] >= now - span - 1e-3]
        half = len(kept) // 2
        # 4: least number of pairs for a slope.
        if half < 4 or kept[0][0] > now - 0.8 * span:
            return None
        pairs = list(zip(kept, kept[-half:], strict=False))
        apart = median(after[0] - before[0] for before, after in pairs)
        off, change = (
            median((after[i] - before[i]) / (after[0] - before[0]) for before, after in pairs)
            for i in (1, 2)
        )
        # With white noise, the variance of the median is pi/2 times that of the mean. 0.1: share of
        # a range's variance that does not average out over a span, because radios also have slow
        # errors.
        variance = 2 * (pi / 2 / half + 0.1) * sigma**2
        return _Slope(-off, sqrt(variance) / apart, change)


class _Slope(NamedTuple):
    """Slopes over a span, m/s.

    off: error of the rates: minus the slope of z.
    sigma: standard deviation of `off`.
    change: slope of the ranges.
    """

    off: float
    sigma: float
    change: float

    @property
    def words(self) -> str:
        """Human-readable description."""
        advice = ", opposite sign: see ranging.rate_sign" if self.opposite else ""
        reported = f"the radio reports a range rate of {self.change + self.off:+.1f} m/s"
        return f"{reported}, but its ranges change by {self.change:+.1f} m/s{advice}"

    @property
    def opposite(self) -> bool:
        """True if the reported rate is about the slope of the ranges with the opposite sign."""
        return abs(self.change + self.off + self.change) < 0.5 * abs(self.change)
