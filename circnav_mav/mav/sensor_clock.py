"""From a remote clock to ours, when all that is known is that no message arrives before it was sent."""

from collections.abc import Callable
from dataclasses import dataclass

WINDOW = 100
"""Samples after which the least lag is taken anew, so that a drifting sensor clock is followed."""
STEP = 0.15
"""Least step of a remote clock that is looked for, s: the jitter of most links is less, a pause that hurts is more."""
RISE = 0.4
"""Share of a step that must show from one sample to the next. A link that is ever more congested rises bit by bit."""
STEADY, STEADY_SAMPLES = 0.5, 3
"""How long, s, and in how many samples, lags must stay at their new level."""
FALL = 0.03
"""Fall of the lag, s, by which a queue shows that drains: one with 6 % of its capacity to spare falls so far in STEADY.
Clocks differ by a thousandth of that."""
SPREAD = 0.5
"""Share of the step by which the lags of its samples may differ, and which a slower link may account for."""

Slower = Callable[[float, float], float]
"""(since, now) -> the most, s, by which the link may have become slower at `since`; infinite while nobody has told."""


def nobody_tells(since: float, now: float) -> float:
    """Of a link that nothing measures: see SensorClock."""
    return 0.0


@dataclass(slots=True)
class _Raised:
    """Samples in a row whose lags are above the offset: since when, the first lag, the least and the most, s."""

    since: float
    first: float
    least: float
    most: float
    samples: int = 1
    by_link: bool = False


class SensorClock:
    """Local time = sensor stamp + offset, where the offset is the least seen of (arrival - stamp).

    The idea is that of ArduPilot's JitterCorrection: delay on the way only ever adds. A constant delay cannot be told
    from a clock difference and stays in.

    A remote clock that stands still (a paused simulator, a controller that writes its log) raises all later lags at
    once by the length of the pause. A queue that drains raises them too, but they fall from sample to sample;
    congestion raises them bit by bit. A link that has turned slower in one step looks just the same: the round trip
    (`slower`) tells, and the offset follows only what the round trip does not explain. Where nothing measures the link,
    the step is taken for the clock's: pauses are common, a route that is suddenly slower by a constant time is rare,
    and one that is slow from the start has never shown there.
    """

    def __init__(self, slower: Slower = nobody_tells) -> None:
        self._slower = slower
        self.reset()

    def reset(self) -> None:
        """Forget the offset: the sensor's clock has jumped."""
        self._offset: float | None = None
        self._candidate = float("inf")
        self._count = 0
        self._lag = float("inf")
        self._raised: _Raised | None = None
        self.followed = 0.0
        """The step that was followed with the newest sample, s."""

    @property
    def doubted(self) -> bool:
        """Whether the newest lags look like a step of the remote clock that is not followed yet."""
        raised = self._raised
        return raised is not None and raised.samples > 1 and not raised.by_link and self._steady(raised)

    def ahead(self, stamp: float, arrival: float) -> float:
        """By how much a stamp is newer than any can be by the offset, s; negative: how late it is."""
        return 0.0 if self._offset is None else self._offset - (arrival - stamp)

    def local(self, stamp: float, arrival: float) -> float:
        """The local time of a sample that was stamped `stamp` there and arrived at `arrival` here, s."""
        lag = arrival - stamp
        self._candidate = min(self._candidate, lag)
        self._count += 1
        if self._offset is None or lag < self._offset:
            self._offset = lag
        self.followed = 0.0
        self._watch(lag, arrival, lag - self._offset)
        if self._raised is not None:
            self._follow(self._raised, arrival)
        if self._count >= WINDOW:
            self._offset, self._candidate, self._count = self._candidate, float("inf"), 0
        return min(stamp + self._offset, arrival)

    def _watch(self, lag: float, arrival: float, late: float) -> None:
        """Keep what is known of lags that have risen at once and stay high. late: above the offset, s."""
        raised, rise, self._lag = self._raised, lag - self._lag, lag
        if late < STEP:
            self._raised = None
        elif rise >= max(STEP, RISE * late) or (raised is not None and lag < raised.first - FALL):
            self._raised = _Raised(arrival, lag, lag, lag)
        elif raised is not None:
            raised.least, raised.most = min(raised.least, lag), max(raised.most, lag)
            raised.samples += 1

    def _follow(self, raised: _Raised, arrival: float) -> None:
        """Follow a step that has lasted, as far as the link does not account for it."""
        assert self._offset is not None
        if arrival - raised.since < STEADY or raised.samples < STEADY_SAMPLES or not self._steady(raised):
            return
        step, by_link = raised.least - self._offset, self._slower(raised.since, arrival)
        raised.by_link = SPREAD * step < by_link < float("inf")
        if by_link <= SPREAD * step:
            self.followed = step - by_link
            self._offset += self.followed
            self._candidate, self._count = self._offset, 0

    def _steady(self, raised: _Raised) -> bool:
        assert self._offset is not None
        return raised.most - raised.least <= SPREAD * (raised.least - self._offset)
