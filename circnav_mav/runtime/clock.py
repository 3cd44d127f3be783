"""The only clock of the product."""

import time


class Clock:
    """Seconds since it was made, in whole microseconds, monotonic; `speed` times real time for the bundled vehicle.

    Whole microseconds are what a tlog can hold, so that a replay sees the very times that the flight saw.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._start = time.monotonic()
        self.epoch_us = time.time_ns() // 1000
        """Wall-clock time of second 0, for log stamps only."""

    def now(self) -> float:
        """Seconds since the start of the run."""
        return round((time.monotonic() - self._start) * self._speed * 1e6) / 1e6

    def until(self, moment: float) -> float:
        """Real seconds to wait for a moment of this clock; 0 when it has passed."""
        return max((moment - self.now()) / self._speed, 0.0)


def local_time_name() -> str:
    """The present local time as a folder name."""
    return time.strftime("%Y%m%d-%H%M%S")
