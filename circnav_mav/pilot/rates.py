"""Rates of frames, ranges and setpoints over the last seconds."""

from collections import deque
from math import inf
from typing import NamedTuple

RATE_SPAN = 3.0
"""Time, s, over which rates are averaged. Alarms based on rates wait for this time."""


class Rates(NamedTuple):
    """Rates per second.

    frames: received frames.
    taken: accepted ranges.
    refused: rejected ranges, without the reasons that have an alarm of their own.
    setpoints: sent setpoints.
    """

    frames: float
    taken: float
    refused: float
    setpoints: float

    @property
    def ranges(self) -> float:
        """Ranges accepted or rejected, per second."""
        return self.taken + self.refused


class RateMeter:
    """Converts counts to rates. Read them after the first count.

    newest: rates since the oldest kept count, None before the second count.
    """

    def __init__(self) -> None:
        self.newest: Rates | None = None
        self._counts: deque[tuple[float, Rates]] = deque()
        """Time, s, and counts at this time."""
        self._not_steered = -inf
        """Time of the newest count without steering, s."""

    def take(self, now: float, counts: Rates, *, steering: bool) -> None:
        """Add the current counts."""
        kept = self._counts
        kept.append((now, counts))
        if not steering:
            self._not_steered = now
        while len(kept) > 2 and now - kept[1][0] >= RATE_SPAN:
            kept.popleft()
        then, before = kept[0]
        span = now - then
        if span > 0:
            self.newest = Rates(
                *((count - earlier) / span for count, earlier in zip(counts, before, strict=True))
            )

    @property
    def whole(self) -> Rates | None:
        """Newest rates, None until they cover `RATE_SPAN`."""
        return self.newest if self._counts[-1][0] - self._counts[0][0] >= RATE_SPAN else None

    @property
    def while_steering(self) -> Rates | None:
        """Newest rates, None unless the vehicle was steered during the whole `RATE_SPAN`."""
        return self.whole if self._counts[0][0] > self._not_steered else None
