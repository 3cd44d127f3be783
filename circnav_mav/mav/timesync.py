"""How long a question to the vehicle and its answer take, by TIMESYNC: the only delay that can be measured.

A constant delay looks like a clock that is set otherwise: stamps do not show it.
Source: https://mavlink.io/en/services/timesync.html
"""

from collections import deque
from statistics import median

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Message

KEPT = 5
"""Newest answers that count, and answers after which is asked less often."""
EVERY, LATER_EVERY = 0.5, 1.0
"""Time between two questions, s."""
MOST_REPEATS = 10
"""Questions in a row that are asked again in haste; who answers none of them does not hear us."""
AGAIN = 0.2
"""Time after which a question is asked again, s, that should have been answered by now: it was lost, or the link has
become slow, and to learn either is urgent."""
REMEMBERED = 256
"""Newest answers by which a link is compared with what it was: some four minutes."""
OUTSTANDING = 64
"""Questions that may wait for an answer, more than are asked within PATIENCE; it mirrors our stamp, so nobody else's
answer is taken for ours."""
PATIENCE = 10.0
"""Time, s, after which a vehicle that has answered nothing counts as one that never does, and a question as lost."""


class Timesync:
    """Asks the vehicle the time. What is known outlives a loss of the link: only the same vehicle may come back."""

    def __init__(self) -> None:
        self._asked: dict[int, float] = {}
        """When each question that waits for its answer was asked, s, by its stamp; `_newest`: of the last one."""
        self._newest = 0
        self._next = float("-inf")
        self._repeats = 0
        self._began: float | None = None
        self._answers: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)
        self.trips: deque[float] = deque(maxlen=KEPT)
        """The newest, s."""

    @property
    def typical(self) -> float | None:
        """Median of the newest, s; None before any answer."""
        return median(self.trips) if self.trips else None

    @property
    def worst(self) -> float | None:
        """Of the newest, s; None before any answer."""
        return max(self.trips, default=None)

    @property
    def one_way(self) -> float:
        """The least that a frame of the vehicle has been under way of late, s: half of the quickest answer. 0 where no
        answer tells."""
        return min(self.trips, default=0.0) / 2

    def slower(self, since: float, now: float) -> float:
        """The most, s, by which frames that have come since then may be later than those before: what the quickest
        answer takes longer. Infinite until an answer tells, which is asked for at once; 0 where none ever does."""
        after = [trip for at, trip in self._answers if at >= since]
        if after:
            before = min((trip for at, trip in self._answers if at < since), default=0.0)
            return max(min(after) - before, 0.0)
        if not self._answers or now - max(since, self._answers[-1][0]) > PATIENCE:
            return 0.0
        if max(self._asked.values(), default=since) < since:
            self._next = now
        return float("inf")

    def settled(self, now: float) -> bool:
        """Whether the round trip is known, or never will be."""
        return bool(self.trips) or (self._began is not None and now - self._began > PATIENCE)

    def poll(self, now: float) -> list[Message]:
        """A question, when due."""
        overdue = self._overdue(now)
        if now < self._next and not overdue:
            return []
        self._repeats += overdue
        self._began = now if self._began is None else self._began
        self._next = now + (LATER_EVERY if len(self.trips) == KEPT else EVERY)
        self._newest = max(int(now * 1e9), 0) + 1
        self._asked[self._newest] = now
        if len(self._asked) > OUTSTANDING:
            del self._asked[next(iter(self._asked))]
        return [dialect.MAVLink_timesync_message(0, self._newest)]

    def heard(self, stamp: int, now: float) -> None:
        """An answer that mirrors a stamp; one to somebody else's question is nothing."""
        at = self._asked.pop(stamp, None)
        if at is None:
            return
        self._repeats = 0
        if now - at <= PATIENCE:
            self.trips.append(now - at)
            self._answers.append((now, now - at))

    def _overdue(self, now: float) -> bool:
        """Whether the newest question should have been answered by now."""
        asked = self._asked.get(self._newest)
        if asked is None or not self.trips or self._repeats >= MOST_REPEATS:
            return False
        return now - asked > max(*self.trips, AGAIN)
