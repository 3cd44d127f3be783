"""Remote clocks: conversion of remote stamps to local time, clock resets, and the speed of a remote
clock.

Timestamps alone give a lower bound of the delay. `Timesync` measures the rest.
"""

from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from math import inf
from statistics import median

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Message

BOOT_WRAP = 2**32 / 1000
"""Time after which time_boot_ms wraps to 0, s: 49.7 days."""

WINDOW = 100
"""Number of samples after which older samples no longer determine the least lag (arrival - stamp).
So the clock estimate follows a drifting clock."""
STEP = 0.15
"""Smallest step of a remote clock that is detected, s. Most links have less jitter, and harmful
clock pauses are longer."""
STEADY = 0.5
"""Time for which lags must stay at a new level before the clock estimate follows the step, s."""
STEADY_SAMPLES = 3
"""Number of samples at the new level before the clock estimate follows the step."""
SPREAD = 0.5
"""Largest difference between the lags after a step, as a share of the step. Also the largest share
of the step that a slower link may explain. If the link explains a larger share, the clock estimate
ignores the step."""

Slower = Callable[[float, float], float]
"""Function (since, now) that returns an upper bound of the increase of the link delay since a time,
s. The bound is infinite while the delay is not measured."""


def no_link_delay(since: float, now: float) -> float:
    """Return 0, the assumed delay increase of an unmeasured link. See StampFilter."""
    return 0.0


def our_boot_ms(now: float) -> int:
    """Return our own time_boot_ms: milliseconds since the start of circnav, in 32 bits."""
    return int(now * 1000) & 0xFFFFFFFF


JUMP = 1.0
"""Backward step of a remote clock, s, that is taken as a clock reset. A smaller backward step is a
reordered message."""


class Order(Enum):
    """Relation of a stamp to the newest accepted stamp.

    JUMPED: the stamp is far off, by a glitch or by a clock reset.
    RESTARTED: the stamp is far off and continues the previous far-off stamp. The clock was reset.
    """

    NEWER = "newer"
    REPEATED = "repeated"
    OLDER = "older"
    JUMPED = "jumped"
    RESTARTED = "restarted"


class StampFilter:
    """Order and local times of a remote clock's stamps.

    Local time = remote stamp + offset. The offset is the least (arrival - stamp) of the newest
    samples, as in ArduPilot's JitterCorrection, because link delay is never negative. A constant
    delay cannot be distinguished from a clock difference and remains in the offset.

    A pause of the remote clock (a paused simulator, a controller that writes its log) raises all
    later lags at once by its length. Lags of a draining queue fall from sample to sample.
    Congestion raises lags gradually. A link that becomes slower in one step looks like a pause.
    Only the round-trip time (`slower`) distinguishes the slower link from the pause. The offset
    follows the part of the step that the link does not explain. On an unmeasured link the step is
    attributed to the clock: pauses are common, routes that become slower by a constant time are
    rare.
    """

    def __init__(
        self, slower: Slower = no_link_delay, *, wrap: float | None = None, jump: float = JUMP
    ) -> None:
        """slower: delay increase of the link.
        wrap: period of the stamps, s, None if they do not wrap.
        jump: backward step, s, that is taken as a clock reset.
        """
        self._slower = slower
        self._wrap = wrap
        self._jump = jump
        self.reset()

    def reset(self) -> None:
        """Discard all state: the clock was reset or replaced."""
        self.newest: float | None = None
        """Newest accepted stamp, unwrapped, s. newest_at: arrival time of this stamp, s."""
        self.newest_at = -inf
        self._jumped: tuple[float, float] | None = None
        self._offset = self._candidate = self._lag = inf
        self._count = 0
        self._raised: deque[tuple[float, float]] = deque()
        """Newest consecutive samples with raised lags: (arrival, lag), s, over STEADY."""
        self._by_link = False
        """True if the link explains the raised lags."""
        self.followed = 0.0
        """Clock step that was applied with the newest sample, s."""

    @property
    def doubted(self) -> bool:
        """True if the newest stamps look like a step of the remote clock that is not applied
        yet."""
        return self._jumped is not None or (
            len(self._raised) > 1 and not self._by_link and self._steady()
        )

    # --- the order of stamps ---

    def unwrapped(self, stamp: float) -> float:
        """Return a stamp, s, unwrapped: the value nearest to the newest stamp."""
        if not self._wrap or self.newest is None:
            return stamp
        return stamp + self._wrap * round((self.newest - stamp) / self._wrap)

    def order(
        self,
        stamp: float,
        now: float,
        *,
        most_ahead: float = inf,
        steady: float = inf,
        patience: float = 0.0,
    ) -> Order:
        """Compare an unwrapped stamp with the newest, and reset the filter if the result is
        RESTARTED.

        most_ahead: largest lead of the stamp over the clock estimate, s. A stamp ahead by more is
            far off.
        steady: largest difference, s, between the interval of two stamps of a new clock and the
            interval of their arrivals.
        patience: time since the newest accepted stamp, s, before a new clock is followed.
        """
        if self.newest is None:
            return Order.NEWER
        step = stamp - self.newest
        if step > -self._jump and self.ahead(stamp, now) <= most_ahead:
            self._jumped = None
            return Order.NEWER if step > 0 else Order.REPEATED if step == 0 else Order.OLDER
        # A single far-off stamp may be a glitch, or a late frame from another route. After a clock
        # reset, the next stamp continues from the far-off stamp.
        before = self._jumped
        self._jumped = (stamp, now)
        goes_on = (
            before is not None
            and stamp > before[0]
            and abs(stamp - before[0] - (now - before[1])) <= steady
        )
        if not goes_on or now - self.newest_at < patience:
            return Order.JUMPED
        self.reset()
        return Order.RESTARTED

    def take(self, stamp: float, now: float) -> None:
        """Accept a stamp that arrived now as the newest."""
        self.newest = stamp
        self.newest_at = now
        self._jumped = None

    # --- remote time to ours ---

    def ahead(self, stamp: float, arrival: float) -> float:
        """Return the lead of a stamp over the clock estimate, s. A negative value is its delay."""
        return 0.0 if self._offset == inf else self._offset - (arrival - stamp)

    def local(self, stamp: float, arrival: float) -> float:
        """Return the local time of a sample with this remote stamp and local arrival time, s."""
        lag = arrival - stamp
        self._offset, self._candidate = min(self._offset, lag), min(self._candidate, lag)
        self._count += 1
        self.followed = 0.0
        self._watch(lag, arrival)
        if (
            len(self._raised) >= STEADY_SAMPLES
            and arrival - self._raised[0][0] >= STEADY
            and self._steady()
        ):
            self._apply_step(arrival)
        if self._count >= WINDOW:
            self._offset = self._candidate
            self._candidate = inf
            self._count = 0
        return min(stamp + self._offset, arrival)

    def _watch(self, lag: float, arrival: float) -> None:
        """Collect the samples since the lag has risen in one step, as long as the lag stays
        high."""
        late = lag - self._offset
        rise = lag - self._lag
        self._lag = lag
        if late < STEP:
            self._raised.clear()
        # A sudden rise starts a new step: at least 0.4 of the step must appear between two
        # successive samples, because growing congestion raises the lag gradually.
        # A fall of the lag by 0.03 s indicates a draining queue, not a paused clock: start over
        # with this sample. With 6 % of spare link capacity, the lag falls by as much within STEADY.
        # The drift between two clocks is a thousand times slower.
        elif rise >= max(STEP, 0.4 * late) or (self._raised and lag < self._raised[0][1] - 0.03):
            self._begin(arrival)
        elif self._raised:
            self._raised.append((arrival, lag))
            # drop samples older than STEADY: a stalling computer may disturb lags for seconds
            while len(self._raised) > STEADY_SAMPLES and arrival - self._raised[1][0] >= STEADY:
                self._raised.popleft()

    def _begin(self, arrival: float) -> None:
        """Restart the raised samples with the newest sample."""
        self._raised = deque([(arrival, self._lag)])
        self._by_link = False

    def _steady(self) -> bool:
        lags = [lag for _, lag in self._raised]
        return max(lags) - min(lags) <= SPREAD * (min(lags) - self._offset)

    def _apply_step(self, arrival: float) -> None:
        """Apply the part of a lasting step that the link does not explain."""
        step = min(lag for _, lag in self._raised) - self._offset
        by_link = self._slower(self._raised[0][0], arrival)
        if by_link < inf:  # infinite: not measured yet, so keep the last result
            self._by_link = SPREAD * step < by_link
        if by_link <= SPREAD * step:
            self.followed = step - by_link
            self._offset += self.followed
            self._candidate = self._offset
            self._count = 0
            # start over: if the link was slow during the step, only later lags show the rest of the
            # step
            self._begin(arrival)


class UtcClock:
    """UTC from a remote clock. The least delayed of the newest stamps gives the offset."""

    def __init__(self) -> None:
        # Number of newest stamps in use: half a minute of SYSTEM_TIME at 1 Hz.
        self._offsets: deque[float] = deque(maxlen=30)

    @property
    def offset(self) -> float | None:
        """UTC minus local time, s; None while the remote clock is not set."""
        return max(self._offsets, default=None)

    def received(self, unix: float, now: float) -> None:
        """Process a stamp, Unix time in s, that arrived now."""
        # Accept dates from 2020 to 2100. An autopilot without UTC sends 0 or the time since its
        # start.
        if not 1_577_836_800 < unix < 4_102_444_800:
            return
        # The remote clock was set, by its first GPS fix or by a ground station: earlier stamps are
        # wrong.
        if self._offsets and abs(unix - now - self._offsets[-1]) > JUMP:
            self._offsets.clear()
        self._offsets.append(unix - now)


# --- speed of a remote clock

OFF = 0.2
"""Least deviation of the vehicle's clock speed from ours that is reported, as a fraction. A radio
with a filling buffer causes less deviation, or deviation for a shorter time."""
ALIKE = 0.1
"""Consecutive windows agree if the clock speeds measured in them differ by less than this
fraction."""
WINDOWS = 3
"""Number of consecutive windows that must agree before a deviation of the clock speed is
reported."""
Moment = tuple[float, float]
"""(local time, remote time), s."""
Span = tuple[Moment, Moment]


class ClockSpeed:
    """Speed of the vehicle's clock, from times since boot and their arrival times.

    A simulator that does not run in real time looks like a vehicle that flies at another speed. A
    deviation is reported only if WINDOWS consecutive windows agree.
    """

    def __init__(self) -> None:
        self._began: Moment | None = None
        self._speeds: deque[float] = deque(maxlen=WINDOWS)
        self.found: float | None = None
        """Autopilot seconds per local second, None while the clocks agree."""
        self.noticed: float | None = None
        """First deviating speed that was found."""

    def received(self, boot: float, now: float) -> None:
        """Process a time since boot, s, that arrived now."""
        if self._began is None or boot < self._began[1]:
            self._began = (now, boot)
            self._speeds.clear()
        # 3.0: length of the window over which a clock speed is measured, s.
        if now - self._began[0] < 3.0:
            return
        speed = span_speed((self._began, (now, boot)))
        self._speeds.append(speed)
        agree = len(self._speeds) == WINDOWS and max(self._speeds) - min(
            self._speeds
        ) < ALIKE * max(speed, 1.0)
        self.found = speed if agree and all(abs(one - 1) > OFF for one in self._speeds) else None
        self.noticed = self.found if self.noticed is None else self.noticed
        self._began = (now, boot)


def quick_span(moments: Sequence[Moment]) -> Span | None:
    """Return the least delayed moments of the first and of the last third, or None without moments.

    The least delayed moments keep changes of the link delay out of the clock speed.
    """
    third = (len(moments) + 2) // 3
    if not third:
        return None
    first, last = (
        min(part, key=lambda one: one[0] - one[1]) for part in (moments[:third], moments[-third:])
    )
    return first, last


def span_speed(span: Span) -> float:
    """Return remote seconds per local second."""
    (began, at_first), (ended, at_last) = span
    return (at_last - at_first) / (ended - began) if ended > began else 1.0


# --- round-trip time to the vehicle

KEPT = 5
"""Number of newest round trips in use. After this number of answers, requests become less
frequent."""
EVERY = 0.5
"""Time between two requests, s, before KEPT round trips are measured."""
LATER_EVERY = 1.0
"""Time between two requests, s, after KEPT round trips are measured."""
UNANSWERED = 3.0
"""Time without an answer, s, after which our frames may be lost on the way to the vehicle: three
requests in a row are unanswered."""
AGAIN = 0.2
"""Least wait, s, before an unanswered request is repeated early. The request was lost or the link
has become slow: in both cases the delay must be measured soon."""
PATIENCE = 10.0
"""Time, s, after which an answer is no longer used. A vehicle without any answer within this time
is assumed not to answer TIMESYNC."""


class Timesync:
    """Round-trip time to the vehicle, measured with TIMESYNC requests.

    Only the round trip is measurable: a constant one-way delay looks like a clock difference. The
    results are kept when the link is lost, because only the same vehicle is accepted again.

    Source: https://mavlink.io/en/services/timesync.html
    """

    def __init__(self) -> None:
        self._asked: dict[int, float] = {}
        """Send time, s, of each unanswered request by its stamp. `_newest`: stamp of the last
        request."""
        self._newest = 0
        self._next = float("-inf")
        self._repeats = 0
        self._began: float | None = None
        # Newest answers, about four minutes of them. They give the past delay of the link for a
        # comparison with the present delay.
        self._answers: deque[tuple[float, float]] = deque(maxlen=256)
        self.trips: deque[float] = deque(maxlen=KEPT)
        """Newest round-trip times, s."""

    @property
    def typical(self) -> float | None:
        """Median of the newest round trips, s; None before any answer."""
        return median(self.trips) if self.trips else None

    @property
    def worst(self) -> float | None:
        """Longest of the newest round trips, s; None before any answer."""
        return max(self.trips, default=None)

    def silent(self, now: float, within: float) -> bool:
        """True if the vehicle has answered before, but not within the last `within` seconds. Our
        frames may then be lost."""
        return bool(self._answers) and now - self._answers[-1][0] > within

    @property
    def one_way(self) -> float:
        """Least one-way delay, s: half of the shortest of the newest round trips, 0 without an
        answer."""
        return min(self.trips, default=0.0) / 2

    def slower(self, since: float, now: float) -> float:
        """Return `delay_increase`. If it is infinite and no request was sent since the time
        `since`, make the next request due at once."""
        increase = self.delay_increase(since, now)
        if increase == float("inf") and max(self._asked.values(), default=float("-inf")) < since:
            self._next = now
        return increase

    def delay_increase(self, since: float, now: float) -> float:
        """Return the largest increase of the link delay since the time `since`, s, from the
        shortest round trips.

        Infinite until a round trip is measured after `since`; 0 if the vehicle does not answer.
        """
        after = [trip for at, trip in self._answers if at >= since]
        if after:
            before = min((trip for at, trip in self._answers if at < since), default=0.0)
            return max(min(after) - before, 0.0)
        if not self._answers or now - max(since, self._answers[-1][0]) > PATIENCE:
            return 0.0
        return float("inf")

    def forget_requests(self) -> None:
        """Ignore the answers to earlier requests. Call after a stall of this computer: the answers
        have waited for it, and their round trips are too long."""
        self._asked.clear()

    def settled(self, now: float) -> bool:
        """True if the round trip is measured, or PATIENCE has passed without an answer."""
        return bool(self.trips) or (self._began is not None and now - self._began > PATIENCE)

    def poll(self, now: float) -> list[Message]:
        """Return a request if it is due."""
        overdue = self._overdue(now)
        if now < self._next and not overdue:
            return []
        self._repeats += overdue
        self._began = now if self._began is None else self._began
        self._next = now + (LATER_EVERY if len(self.trips) == KEPT else EVERY)
        self._newest = max(int(now * 1e9), 0) + 1
        self._asked[self._newest] = now
        # 64: limit of stored unanswered requests, more than are sent within PATIENCE.
        if len(self._asked) > 64:
            del self._asked[next(iter(self._asked))]
        return [dialect.MAVLink_timesync_message(0, self._newest)]

    def received(self, stamp: int, now: float) -> None:
        """Process an answer that mirrors a stamp. Answers to other senders' requests are
        ignored."""
        at = self._asked.pop(stamp, None)
        if at is None:
            return
        self._repeats = 0
        if now - at <= PATIENCE:
            self.trips.append(now - at)
            self._answers.append((now, now - at))

    def _overdue(self, now: float) -> bool:
        """True if the newest request should have been answered by now."""
        asked = self._asked.get(self._newest)
        # 10: limit of early repeats in a row. If no request is answered, assume that the vehicle
        # does not receive our frames.
        if asked is None or not self.trips or self._repeats >= 10:
            return False
        return now - asked > max(*self.trips, AGAIN)
