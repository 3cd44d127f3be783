"""Timers, filters and reports without a clock: time is an argument."""

from math import exp, inf
from typing import Generic, TypeVar

T = TypeVar("T")


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


class Hysteresis:
    """A state that changes only after its input has had the other value without interruption.

    on: the state.
    since: time at which the input took the other value, s, or None while input and state agree.
    """

    def __init__(self, raise_after: float, clear_after: float = 0.0) -> None:
        """raise_after, clear_after: time without interruption until the state is raised and until
        it is cleared, s."""
        self._raise_after = raise_after
        self._clear_after = clear_after
        self.on = False
        self.since: float | None = None

    def update(self, active: bool, now: float) -> bool:
        """Process the input at a time. Return the state."""
        if active == self.on:
            self.since = None
            return self.on
        if self.since is None:
            self.since = now
        if now - self.since >= (self._clear_after if self.on else self._raise_after):
            self.on = active
            self.since = None
        return self.on

    def clear(self) -> None:
        """Clear the state at once."""
        self.on = False
        self.since = None


class LowPass:
    """First-order low-pass filter of irregular samples. value: None before the first sample."""

    def __init__(self, time_constant: float) -> None:
        """time_constant: s."""
        self._time_constant = time_constant
        self.value: float | None = None

    def update(self, sample: float, step: float) -> float:
        """Process a sample that was measured `step` s after the sample before. Return the value."""
        before = sample if self.value is None else self.value
        self.value = sample + (before - sample) * exp(-step / self._time_constant)
        return self.value

    def clear(self) -> None:
        """Forget the samples."""
        self.value = None


class Report(Generic[T]):
    """Newest value of a repeated report, its arrival, and the time for which it must have changed.

    An autopilot may repeat a value that it no longer updates. So a report is missing if it is old,
    or if its value has stayed the same while other evidence shows that it must have changed.

    value: newest value, None before the first report.
    time: arrival of the newest report, s.
    changed: arrival of the first report with this value, s.
    unchanged: total time, since then, in which other evidence showed a change, s.
    """

    def __init__(self) -> None:
        self.value: T | None = None
        self.time = -inf
        self.changed = -inf
        self.unchanged = 0.0

    def update(self, value: T, now: float, *, must_change: bool = True) -> None:
        """Process a report. must_change: True if other evidence shows that the value changes."""
        if value != self.value or self.time == -inf:
            self.changed = now
            self.unchanged = 0.0
        elif must_change:
            self.unchanged += now - self.time
        self.value = value
        self.time = now

    def age(self, now: float) -> float:
        """Return the time since the newest report, s."""
        return now - self.time

    def live(self, now: float, max_age: float, max_unchanged: float = inf) -> T | None:
        """Return the value, or None if it is missing.

        max_age: age of a report above which it is missing, s.
        max_unchanged: value of `unchanged` above which the report is missing, s.
        """
        if self.age(now) > max_age or self.unchanged > max_unchanged:
            return None
        return self.value
