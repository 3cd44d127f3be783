"""Whether a measured range rate goes with the ranges: z = r - (integral of the rate) must stay constant.

A wrong sign, a wrong scale, a frozen number or a bias all make z run away, however the vehicle flies; where they do
not, they do no harm yet. The slope of z over some seconds is the error of the rate: the median over pairs half the span
apart (as the Theil-Sen estimator), which does not mind outliers.
"""

from collections import deque
from math import sqrt
from statistics import median
from typing import NamedTuple

QUICK, SLOW = 2.5, 15.0
"""Spans, s, over which the slope is taken: what is far off shows in the first, a bias in the second."""
APART = 0.1
"""Least time, s, between two ranges that are kept."""
GAP = 1.0
"""Time, s, without a rate after which its integral begins anew."""
FEWEST = 4
"""Pairs that it takes at least."""
DRIFTING = 0.1
"""Share of a range's variance that does not average out over a span: radios err slowly, too."""
SURE = 4.0
"""Standard deviations of the slope that are no accident: it is looked at ten times a second, for hours."""
TOLERATED = 2.0
"""A rate may be off by so many of its own standard deviations beyond that."""
RETRY, LONGEST_RETRY = 10.0, 160.0
"""Time, s, for which a dropped rate must agree with the ranges before it counts again; twice as long each time."""


class RateCheck:
    """Compares rates with ranges, both slant, on one clock. One for each flight."""

    def __init__(self) -> None:
        self.reset()
        self.trusted = True
        """Whether the rates count."""
        self.why = ""
        """Why they were dropped the last time, for people."""
        self._retry, self._opposite = RETRY / 2, False
        self._agreed = self._judged_at = 0.0

    def reset(self) -> None:
        """Another clock, or a gap: nothing before can be compared with what comes."""
        self._integral, self._rate = 0.0, None
        self._ranges: deque[tuple[float, float, float]] = deque()
        self.bias = 0.0
        """By how much the rates are off lately, m/s, as far as the ranges tell."""

    _rate: tuple[float, float] | None

    def add_rate(self, stamp: float, rate: float) -> None:
        """A measured rate, m/s, at stamp, s."""
        if self._rate is not None:
            step = stamp - self._rate[0]
            if not 0 <= step <= GAP:
                self.reset()
            else:
                self._integral += step * (rate + self._rate[1]) / 2
        self._rate = stamp, rate

    def add_range(self, stamp: float, r: float, sigma: float, rate_sigma: float) -> None:
        """A range, m, at stamp, s, and the standard deviations of ranges (m) and rates (m/s)."""
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
        slopes = [slope for span in (QUICK, SLOW) if (slope := self._slope(now, span, sigma)) is not None]
        wrong = next((s for s in slopes if abs(s.off) > SURE * s.sigma + TOLERATED * rate_sigma), None)
        step, self._judged_at = now - self._judged_at, now
        if wrong is not None:
            self._agreed = 0.0
            if self.trusted:
                self.trusted, self._retry = False, min(2 * self._retry, LONGEST_RETRY)
                self.why = wrong.words
            self._opposite = wrong.opposite(0.75)
            self.reset()
        elif slopes and not self.trusted:
            # while the range hardly changes, as on the circle, no sign shows
            shows = not self._opposite or abs(slopes[0].change) > SURE * slopes[0].sigma
            self._agreed += min(step, GAP) if shows else 0.0
            self.trusted = self._agreed > self._retry
        if len(slopes) == 2 and wrong is None:  # as far as the ranges know it better than the rate's own sigma
            slow = slopes[1]
            self.bias = slow.off * rate_sigma**2 / (rate_sigma**2 + slow.sigma**2)

    def _slope(self, now: float, span: float, sigma: float) -> "_Slope | None":
        """None where the span is not covered."""
        kept = [one for one in self._ranges if one[0] >= now - span - 1e-3]
        half = len(kept) // 2
        if half < FEWEST or kept[0][0] > now - 0.8 * span:
            return None
        pairs = list(zip(kept, kept[-half:], strict=False))
        apart = median(after[0] - before[0] for before, after in pairs)
        off, change = (
            median((after[i] - before[i]) / (after[0] - before[0]) for before, after in pairs) for i in (1, 2)
        )
        return _Slope(-off, sigma * sqrt(2 * (1.57 / half + DRIFTING)) / apart, change)  # 1.57: of a median


class _Slope(NamedTuple):
    """off: by how much the rates say too much, m/s, and the standard deviation of that. change: of the ranges, m/s."""

    off: float
    sigma: float
    change: float

    @property
    def words(self) -> str:
        """For people."""
        advice = ", the opposite: see ranging.rate_sign" if self.opposite(0.25) else ""
        return f"reported {self.change + self.off:+.1f} m/s, ranges change by {self.change:+.1f} m/s{advice}"

    def opposite(self, within: float) -> bool:
        """Whether the rate is that of the ranges with the other sign, within a share of it."""
        return abs(self.change + self.off + self.change) < within * abs(self.change)
