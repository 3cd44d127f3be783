"""What time it is over there: remote stamps to our time, whether a remote clock was set anew, and how fast it runs.

Of stamps alone all that is known is that no message arrives before it was sent; what the link adds tells `Timesync`.
"""

from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from math import inf
from statistics import median

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Message

BOOT_WRAP = 2**32 / 1000
"""Seconds after which time_boot_ms begins anew: 49.7 days."""

WINDOW = 100
"""Samples after which the least lag is taken anew, so that a drifting remote clock is followed."""
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
"""(since, now) -> the most, s, by which the link may have become slower at `since`; infinite while not measured."""


def nobody_tells(since: float, now: float) -> float:
    """Of a link that nothing measures: see StampFilter."""
    return 0.0


def our_boot_ms(now: float) -> int:
    """Our own time_boot_ms: milliseconds since we started, in 32 bits."""
    return int(now * 1000) & 0xFFFFFFFF


JUMP = 1.0
"""Step of a remote clock, s, that shows that the clock was set anew. A stamp that is older than the newest by less was
overtaken on the way."""


class Order(Enum):
    """Relation of a stamp to the newest that was taken. JUMPED: far off, from a glitch or from a clock that was set.
    RESTARTED: far off, and the one before agrees: the clock was set anew."""

    NEWER = "newer"
    REPEATED = "repeated"
    OLDER = "older"
    JUMPED = "jumped"
    RESTARTED = "restarted"


class StampFilter:
    """Order and local times of a remote clock's stamps.

    Local time = remote stamp + offset, where the offset is the least seen of (arrival - stamp). The idea is that of
    ArduPilot's JitterCorrection: delay on the way only ever adds. A constant delay cannot be told from a clock
    difference and stays in.

    A remote clock that stands still (a paused simulator, a controller that writes its log) raises all later lags at
    once by the length of the pause. In a queue that drains they fall from sample to sample; congestion raises them bit
    by bit. A link that has turned slower in one step looks just the same: the round trip (`slower`) tells, and the
    offset follows only what it does not explain. Where nothing measures the link, the step is taken for the clock's:
    pauses are common, a route that is suddenly slower by a constant time is rare.
    """

    def __init__(self, slower: Slower = nobody_tells, *, wrap: float | None = None, jump: float = JUMP) -> None:
        """slower: measures the link. wrap: period after which stamps begin anew, s; None if they do not. jump: step
        back, s, that shows that the clock was set anew."""
        self._slower, self._wrap, self._jump = slower, wrap, jump
        self.reset()

    def reset(self) -> None:
        """Forget all: the clock was set anew, or it is another one."""
        self.newest: float | None = None
        """Newest stamp that was taken, on a line that does not wrap, s. newest_at: when it arrived."""
        self.newest_at = -inf
        self._jumped: tuple[float, float] | None = None
        self._offset = self._candidate = self._lag = inf
        self._count = 0
        self._raised: deque[tuple[float, float]] = deque()
        """The newest samples in a row whose lags are above the offset: (arrival, lag), s, over STEADY."""
        self._by_link = False
        """Whether the link accounts for them."""
        self.followed = 0.0
        """The step that was followed with the newest sample, s."""

    @property
    def doubted(self) -> bool:
        """Whether the newest stamps look like a step of the remote clock that is not followed yet."""
        return self._jumped is not None or (len(self._raised) > 1 and not self._by_link and self._steady())

    # --- the order of stamps ---

    def unwrapped(self, stamp: float) -> float:
        """Return a stamp on the line of the newest, which does not wrap, s."""
        if not self._wrap or self.newest is None:
            return stamp
        return stamp + self._wrap * round((self.newest - stamp) / self._wrap)

    def order(
        self, stamp: float, now: float, *, most_ahead: float = inf, steady: float = inf, patience: float = 0.0
    ) -> Order:
        """Compare an unwrapped stamp with the newest; forget the old clock when it RESTARTED. most_ahead: how far the
        stamp may be ahead of the clock, s. steady: how much two stamps of a new clock may differ from the local time
        between them, s. patience: silence by the old clock, s, before a new one is followed."""
        if self.newest is None:
            return Order.NEWER
        step = stamp - self.newest
        if step > -self._jump and self.ahead(stamp, now) <= most_ahead:
            self._jumped = None
            return Order.NEWER if step > 0 else Order.REPEATED if step == 0 else Order.OLDER
        # A single stamp far off may be a glitch, or a frame that came late by another route. A clock that was set goes
        # on from there with the next stamp.
        before, self._jumped = self._jumped, (stamp, now)
        goes_on = before is not None and stamp > before[0] and abs(stamp - before[0] - (now - before[1])) <= steady
        if not goes_on or now - self.newest_at < patience:
            return Order.JUMPED
        self.reset()
        return Order.RESTARTED

    def take(self, stamp: float, now: float) -> None:
        """Make a stamp that came now the newest."""
        self.newest, self.newest_at, self._jumped = stamp, now, None

    # --- remote time to ours ---

    def ahead(self, stamp: float, arrival: float) -> float:
        """By how much a stamp is newer than any can be by the offset, s; negative: how late it is."""
        return 0.0 if self._offset == inf else self._offset - (arrival - stamp)

    def local(self, stamp: float, arrival: float) -> float:
        """The local time of a sample that was stamped `stamp` there and arrived at `arrival` here, s."""
        lag = arrival - stamp
        self._offset, self._candidate = min(self._offset, lag), min(self._candidate, lag)
        self._count += 1
        self.followed = 0.0
        self._watch(lag, arrival)
        if len(self._raised) >= STEADY_SAMPLES and arrival - self._raised[0][0] >= STEADY and self._steady():
            self._follow(arrival)
        if self._count >= WINDOW:
            self._offset, self._candidate, self._count = self._candidate, inf, 0
        return min(stamp + self._offset, arrival)

    def _watch(self, lag: float, arrival: float) -> None:
        """Keep what is known of lags that have risen at once and stay high."""
        late, rise, self._lag = lag - self._offset, lag - self._lag, lag
        if late < STEP:
            self._raised.clear()
        elif rise >= max(STEP, RISE * late) or (self._raised and lag < self._raised[0][1] - FALL):
            self._begin(arrival)
        elif self._raised:
            self._raised.append((arrival, lag))
            # what was before STEADY no longer counts: a computer that stalls may shake lags for seconds
            while len(self._raised) > STEADY_SAMPLES and arrival - self._raised[1][0] >= STEADY:
                self._raised.popleft()

    def _begin(self, arrival: float) -> None:
        """The newest sample is the first that is raised."""
        self._raised, self._by_link = deque([(arrival, self._lag)]), False

    def _steady(self) -> bool:
        lags = [lag for _, lag in self._raised]
        return max(lags) - min(lags) <= SPREAD * (min(lags) - self._offset)

    def _follow(self, arrival: float) -> None:
        """Follow a step that has lasted, as far as the link does not account for it."""
        step = min(lag for _, lag in self._raised) - self._offset
        by_link = self._slower(self._raised[0][0], arrival)
        if by_link < inf:  # else what was measured last still counts
            self._by_link = SPREAD * step < by_link
        if by_link <= SPREAD * step:
            self.followed = step - by_link
            self._offset += self.followed
            self._candidate, self._count = self._offset, 0
            # what is left of it, where the link was slow meanwhile, shows in the lags to come, not in those of the rise
            self._begin(arrival)


# --- how fast it runs ---

SPEED_WINDOW = 3.0
"""Time, s, over which a speed is taken."""
OFF, ALIKE = 0.2, 0.1
"""Fraction by which a speed must differ from ours, and by which windows that agree may differ. A radio whose buffer
fills slows all down by less, or for a shorter time."""
WINDOWS = 3
"""Windows in a row that must agree; chosen."""
Moment = tuple[float, float]
"""(our time, the other clock's time), s."""
Span = tuple[Moment, Moment]


class ClockSpeed:
    """Compares times since boot with the times at which they came: a simulator at another speed looks like a vehicle at
    another. A speed counts on which three windows agree."""

    def __init__(self) -> None:
        self._began: Moment | None = None
        self._speeds: deque[float] = deque(maxlen=WINDOWS)
        self.found: float | None = None
        """Seconds of the autopilot's per second of ours, None while they go along."""
        self.noticed: float | None = None
        """The first that was found."""

    def heard(self, boot: float, now: float) -> None:
        """A time since boot, s, that came now."""
        if self._began is None or boot < self._began[1]:
            self._began = (now, boot)
            self._speeds.clear()
        if now - self._began[0] < SPEED_WINDOW:
            return
        speed = span_speed((self._began, (now, boot)))
        self._speeds.append(speed)
        agree = len(self._speeds) == WINDOWS and max(self._speeds) - min(self._speeds) < ALIKE * max(speed, 1.0)
        self.found = speed if agree and all(abs(one - 1) > OFF for one in self._speeds) else None
        self.noticed = self.found if self.noticed is None else self.noticed
        self._began = (now, boot)


def quick_span(moments: Sequence[Moment]) -> Span | None:
    """Of the first third and of the last the moment that came with the least delay, which is none of the clock's; None
    of none."""
    third = (len(moments) + 2) // 3
    if not third:
        return None
    first, last = (min(part, key=lambda one: one[0] - one[1]) for part in (moments[:third], moments[-third:]))
    return first, last


def span_speed(span: Span) -> float:
    """Seconds of the other clock per second of ours."""
    (began, at_first), (ended, at_last) = span
    return (at_last - at_first) / (ended - began) if ended > began else 1.0


# --- how long a question to the vehicle and its answer take ---

KEPT = 5
"""Newest answers that count, and answers after which is asked less often."""
EVERY, LATER_EVERY = 0.5, 1.0
"""Time between two questions, s."""
UNANSWERED = 3.0
"""Time without an answer, s, after which the vehicle may not receive us: three questions were lost."""
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
    """Asks the vehicle the time by TIMESYNC: the only delay that can be measured, for a constant one looks like a clock
    that is set otherwise. What is known outlives a loss of the link: only the same vehicle may come back.

    Source: https://mavlink.io/en/services/timesync.html
    """

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

    def silent(self, now: float, within: float) -> bool:
        """True if the vehicle has answered before, but not within this time, s: our frames may be lost."""
        return bool(self._answers) and now - self._answers[-1][0] > within

    @property
    def one_way(self) -> float:
        """The least that a frame of the vehicle has been under way of late, s: half of the quickest answer. 0 where no
        answer tells."""
        return min(self.trips, default=0.0) / 2

    def slower(self, since: float, now: float) -> float:
        """As `told`; an answer that does not tell yet is asked for at once."""
        told = self.told(since, now)
        if told == float("inf") and max(self._asked.values(), default=float("-inf")) < since:
            self._next = now
        return told

    def told(self, since: float, now: float) -> float:
        """The most, s, by which frames that have come since then may be later than those before: what the quickest
        answer takes longer. Infinite until an answer tells; 0 where none ever does."""
        after = [trip for at, trip in self._answers if at >= since]
        if after:
            before = min((trip for at, trip in self._answers if at < since), default=0.0)
            return max(min(after) - before, 0.0)
        if not self._answers or now - max(since, self._answers[-1][0]) > PATIENCE:
            return 0.0
        return float("inf")

    def answered(self, now: float) -> bool:
        """True if the vehicle has just answered a question, so that it receives us, or never answers any."""
        return not self._answers or now - self._answers[-1][0] <= UNANSWERED

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
