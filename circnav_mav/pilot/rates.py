"""Rates of frames, ranges and setpoints over the last seconds."""

from collections import deque
from typing import NamedTuple

RATE_SPAN = 3.0
"""Time, s, over which rates are averaged. Alarms based on rates wait for this time."""


class Rates(NamedTuple):
    """Frames received, ranges accepted, ranges rejected without an alarm of their own, and setpoints sent, per
    second."""

    frames: float
    taken: float
    refused: float
    setpoints: float

    @property
    def ranges(self) -> float:
        """Ranges accepted or rejected, per second."""
        return self.taken + self.refused


class RateMeter:
    """Converts counts to rates.

    newest: rates since the oldest kept count, None before the second count. whole: these rates, but None until they
    cover `RATE_SPAN`. while_steering: these rates, but None until the vehicle was steered for `RATE_SPAN`.
    """

    def __init__(self) -> None:
        self.newest: Rates | None = None
        self.whole: Rates | None = None
        self.while_steering: Rates | None = None
        self._counts: deque[tuple[float, Rates]] = deque()
        self._steered_since: float | None = None

    def take(self, now: float, counts: Rates, *, steering: bool) -> None:
        """Add the current counts."""
        kept = self._counts
        kept.append((now, counts))
        while len(kept) > 2 and now - kept[1][0] >= RATE_SPAN:
            kept.popleft()
        then, before = kept[0]
        span = now - then
        if span > 0:
            self.newest = Rates(*((count - earlier) / span for count, earlier in zip(counts, before, strict=True)))
        if not steering:
            self._steered_since = None
        elif self._steered_since is None:
            self._steered_since = now
        steered = self._steered_since is not None and now - self._steered_since > RATE_SPAN
        self.whole = self.newest if span >= RATE_SPAN else None
        self.while_steering = self.whole if steered else None
