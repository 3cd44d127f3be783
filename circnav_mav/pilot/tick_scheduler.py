"""The time of the next step without a fresh range."""

from collections import deque
from statistics import median

WAIT = 0.25
"""Share of a tick for which a range that is expected about then is waited for. A radio of 9.98 Hz would else come just
after the second tick since its last range, always, and its every range be answered twice."""
AT_ONCE = 1e-5
"""A range expected within this time, s, of the tick would be here by now, or is lost."""
REMEMBERED = 9
"""Newest gaps between ranges of which the median is taken."""


class TickScheduler:
    """Keeps when the next step without a fresh range is due: a tick after the last one, but not just before a range."""

    def __init__(self, tick: float) -> None:
        """tick: s."""
        self._tick = tick
        self._gaps: deque[float] = deque(maxlen=REMEMBERED)
        self._heard_at: float | None = None
        self.due = float("-inf")

    def heard(self, now: float) -> None:
        """A range came in."""
        if self._heard_at is not None:
            self._gaps.append(now - self._heard_at)
        self._heard_at = now

    def stepped(self, now: float) -> None:
        """The pilot took a step."""
        due = now + self._tick
        wait = WAIT * self._tick
        # by the usual time between two
        expected = due if self._heard_at is None or not self._gaps else self._heard_at + median(self._gaps)
        self.due = expected + wait if AT_ONCE < abs(due - expected) <= wait else due

    def at_once(self) -> None:
        """Something happened that cannot wait for a tick."""
        self.due = float("-inf")
