"""The only clocks of the product."""

import time
from collections import deque
from collections.abc import Callable

OUT_OF_STEP = 1.0
"""Disagreement between two boot times and the time between them, s, that shows a jump: a reboot, a pause, a wrap."""
SPAN, SHORTEST_SPAN = 2.0, 0.25
"""Real time, s, over which the autopilot's speed is measured, and the least that will do."""
SLOWEST, FASTEST = 0.01, 1000.0
"""Bounds of an autopilot's measured speed, in units of real time: beyond them a stamp is wrong; chosen."""
_THROUGH_SLEEP: int | None = getattr(time, "CLOCK_BOOTTIME", None)


def steady() -> float:
    """Real seconds from an arbitrary start: monotonic, and they go on while the computer sleeps (where it tells), for
    the vehicle flies on. `time.monotonic` of a laptop whose lid was closed for a minute knows of no stall."""
    return time.monotonic() if _THROUGH_SLEEP is None else time.clock_gettime(_THROUGH_SLEEP)


class Clock:
    """Seconds since it was made, monotonic; in whole microseconds, as a tlog holds them: a replay sees the very times
    that the flight saw."""

    longest_wait = 0.05
    """Real time, s, that is waited in one go: meanwhile a link may be back, or the autopilot's time go faster."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        """Seconds of this clock per real second."""
        self._start = steady()
        self.epoch_us = time.time_ns() // 1000
        """Wall-clock time of second 0, for log stamps only."""

    def now(self) -> float:
        """Seconds since the start of the run."""
        return round((steady() - self._start) * self.speed * 1e6) / 1e6

    def until(self, moment: float) -> float:
        """Real seconds to wait for a moment of this clock; 0 when it has passed."""
        return max((moment - self.now()) / self.speed, 0.0)

    def advance(self, moment: float) -> None:
        """A clock of simulated time goes on to the next thing that happens. Real time goes on by itself."""

    def real(self) -> float:
        """Real seconds, monotonic: how long something of ours takes."""
        return steady()


class AutopilotClock(Clock):
    """Goes as fast as the autopilot's boot time, so that a simulator faster or slower than real time is flown.

    Between messages it goes on at the speed last measured (at first `speed`), and so the autopilot's silence is
    noticed. Only the flow of the boot time counts: a reboot, a pause or the wrap of its 32 bits moves nothing here.
    """

    def __init__(self, boot_time: Callable[[], float | None], speed: float = 1.0) -> None:
        """boot_time: the newest time since boot that was heard, s, None before."""
        super().__init__(speed)
        self._boot_time = boot_time
        self._local = self._now = 0.0
        self._heard: deque[tuple[float, float]] = deque()
        self._measured = False

    def now(self) -> float:
        """Seconds since the start of the run."""
        local = steady() - self._start
        self._now += self.speed * (local - self._local)
        self._local = local
        boot = self._boot_time()
        if boot is not None:
            self._hear(boot)
        return round(self._now * 1e6) / 1e6

    def _hear(self, boot: float) -> None:
        """Measure with a boot time that is newer than the last; after a jump begin anew, at the same speed."""
        if self._heard:
            then, before = self._heard[-1]
            step, expected = boot - before, self.speed * (self._local - then)
            if -OUT_OF_STEP < step <= 0:
                return  # nothing new, or two messages have changed places
            if step < 0 or (self._measured and abs(step - expected) > OUT_OF_STEP):
                self._heard.clear()
                self._measured = False
        self._heard.append((self._local, boot))
        self._measure()

    def _measure(self) -> None:
        """The speed over the last SPAN, or over the last two messages if they are rarer."""
        while len(self._heard) > 2 and self._local - self._heard[1][0] >= SPAN:
            self._heard.popleft()
        (began, at_first), (ended, at_last) = self._heard[0], self._heard[-1]
        if ended - began >= SHORTEST_SPAN:
            self.speed = min(max((at_last - at_first) / (ended - began), SLOWEST), FASTEST)
            self._measured = True


def unix_time() -> float:
    """Wall-clock time, s since 1970; it may be set back or forth at any moment."""
    return time.time()


def utc_minute() -> str:
    """The present minute, for people."""
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())


def local_time_name() -> str:
    """The present local time as a folder name."""
    return time.strftime("%Y%m%d-%H%M%S")
