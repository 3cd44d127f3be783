"""Time of the next step without a fresh range."""

from collections import deque
from statistics import median


class TickScheduler:
    """Schedules the next step without a fresh range: a tick after the last step, but not just
    before an expected range."""

    def __init__(self, tick: float) -> None:
        """tick: period of the steps, s."""
        self._tick = tick
        # 10: number of newest gaps between ranges. Their median predicts the next range.
        self._gaps: deque[float] = deque(maxlen=10)
        self._received_at: float | None = None
        self.due = float("-inf")

    def received(self, now: float) -> None:
        """Record the arrival of a range."""
        if self._received_at is not None:
            self._gaps.append(now - self._received_at)
        self._received_at = now

    def stepped(self, now: float) -> None:
        """Record a step of `Pilot`, and schedule the next step."""
        due = now + self._tick
        # 0.25: longest wait for an expected range, as a share of a tick. Without this wait, each
        # range of a 9.98 Hz radio would arrive just after a tick and cause a second setpoint at
        # once.
        wait = 0.25 * self._tick
        # time of the next range, by the median gap between ranges
        expected = (
            due
            if self._received_at is None or not self._gaps
            else self._received_at + median(self._gaps)
        )
        # 1e-5: if the expected time of the range and the tick differ by less, s, do not wait: the
        # range has arrived or is lost.
        self.due = expected + wait if 1e-5 < abs(due - expected) <= wait else due

    def at_once(self) -> None:
        """Make the next step due at once."""
        self.due = float("-inf")
