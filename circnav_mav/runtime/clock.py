"""Clocks. No other module of the core reads the time in a flight."""

import time
from collections import deque
from collections.abc import Callable

OUT_OF_STEP = 1.0
"""Difference, s, between the measured and the expected advance of the autopilot's boot time, above
which this time has jumped. A reboot, a pause or a wrap causes a jump."""
SPAN = 2.0
"""Newest real time over which the autopilot's clock speed is measured, s."""
SHORTEST_SPAN = 0.25
"""Shortest real time from which the autopilot's clock speed is computed, s. The first messages are
not used for as long."""
# Bounds of the autopilot's clock speed, autopilot seconds per real second. A measured speed beyond
# them is caused by a wrong timestamp and is limited.
SLOWEST = 0.01
FASTEST = 1000.0
_THROUGH_SLEEP: int | None = getattr(time, "CLOCK_BOOTTIME", None)


def steady() -> float:
    """Return monotonic real seconds from an arbitrary start, including the time that the computer
    sleeps if the system counts it."""
    # The vehicle flies on while a laptop sleeps with its lid closed. `time.monotonic` would hide
    # that stall.
    return time.monotonic() if _THROUGH_SLEEP is None else time.clock_gettime(_THROUGH_SLEEP)


class Clock:
    """Monotonic seconds since construction, in whole microseconds as in a tlog, so that a replay
    uses the same times."""

    simulated = False
    """True if time passes only with the steps of the loop, so that nothing waits for a slow
    step."""
    longest_wait = 0.05
    """Longest single wait of the loop, real s. During a wait a link may reconnect, or the
    autopilot's clock may become faster."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        """Seconds of this clock per real second."""
        self._start = steady()
        self.epoch_us = time.time_ns() // 1000
        """Unix time of second 0, us. For timestamps of logs only."""

    def now(self) -> float:
        """Return the seconds since the start of the run."""
        return round((steady() - self._start) * self.speed * 1e6) / 1e6

    def until(self, moment: float) -> float:
        """Return the real seconds until a time of this clock, 0 if it has passed."""
        return max((moment - self.now()) / self.speed, 0.0)

    def advance(self, moment: float) -> None:
        """Do nothing: real time advances by itself. A simulated clock (`Lockstep`) advances to its
        next event, or to `moment` if that is earlier."""

    def real(self) -> float:
        """Return monotonic real seconds, for measuring execution time."""
        return steady()


class AutopilotClock(Clock):
    """Clock at the speed of the autopilot's boot time, for simulators faster or slower than real
    time.

    Between messages it continues at the last measured speed (initially `speed`), so that a silent
    autopilot is detected. A reboot, a pause or the 32-bit wrap of the boot time does not move this
    clock.
    """

    def __init__(self, boot_time: Callable[[], float | None], speed: float = 1.0) -> None:
        """boot_time: returns the newest received time since boot, s, or None before the first."""
        super().__init__(speed)
        self._boot_time = boot_time
        self._local = self._now = self._began = 0.0
        self._received: deque[tuple[float, float]] = deque()
        self._measured = False

    def now(self) -> float:
        """Return the seconds since the start of the run."""
        local = steady() - self._start
        self._now += self.speed * (local - self._local)
        self._local = local
        boot = self._boot_time()
        if boot is not None:
            self._on_boot_time(boot)
        return round(self._now * 1e6) / 1e6

    def _on_boot_time(self, boot: float) -> None:
        """Update the speed from a newer boot time. After a jump, restart the measurement at the
        same speed."""
        if self._received:
            then, before = self._received[-1]
            step = boot - before
            expected = self.speed * (self._local - then)
            if -OUT_OF_STEP < step <= 0:
                return  # nothing new, or two messages arrived out of order
            if step < 0 or (self._measured and abs(step - expected) > OUT_OF_STEP):
                self._received.clear()
                self._measured = False
        if not self._received:
            self._began = self._local
        elif self._local - self._began < SHORTEST_SPAN:
            # The first messages have waited while circnav started, and arrive together. They would
            # make the autopilot's clock appear fast.
            self._received.clear()
        self._received.append((self._local, boot))
        self._measure()

    def _measure(self) -> None:
        """Set the speed from the last SPAN, or from the last two messages if they are further
        apart."""
        while len(self._received) > 2 and self._local - self._received[1][0] >= SPAN:
            self._received.popleft()
        (began, at_first), (ended, at_last) = self._received[0], self._received[-1]
        if ended - began >= SHORTEST_SPAN:
            self.speed = min(max((at_last - at_first) / (ended - began), SLOWEST), FASTEST)
            self._measured = True


def unix_time() -> float:
    """Return wall-clock time, s since 1970. It may be set to another time at any moment."""
    return time.time()


def utc_minute() -> str:
    """Return the current minute in UTC, human-readable."""
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())


def local_time_name(unix: float | None = None) -> str:
    """Return a folder name with the local time of a Unix time, s, or with the current local
    time."""
    return time.strftime("%Y%m%d-%H%M%S", time.localtime(unix))
