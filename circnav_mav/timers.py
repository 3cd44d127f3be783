"""Timers without a clock: time is an argument."""

from math import inf


class Since:
    """Time since the newest event of a kind, s, infinite before the first event."""

    def __init__(self) -> None:
        self._at = -inf

    def restart(self, now: float) -> None:
        """Record an event."""
        self._at = now

    def clear(self) -> None:
        """Forget the events."""
        self._at = -inf

    def age(self, now: float) -> float:
        """Return the time since the event."""
        return now - self._at


class Every:
    """Due at the first call, and then a period after it was last due. period: s."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._next = -inf

    def due(self, now: float) -> bool:
        """Return True if due, which starts the next period."""
        if now < self._next:
            return False
        self._next = now + self._period
        return True
