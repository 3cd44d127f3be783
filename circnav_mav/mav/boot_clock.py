"""How fast the autopilot's time runs, seen from ours: a simulator at another speed looks like a vehicle at another."""

from collections import deque

WINDOW = 3.0
"""Time, s, over which a speed is taken."""
OFF, ALIKE = 0.2, 0.1
"""Fraction by which a speed must differ from ours, and by which windows that agree may differ. A radio whose buffer
fills slows all down by less, or for a shorter time."""
WINDOWS = 3


class BootClock:
    """Compares times since boot with the times at which they came. A speed is believed that three windows agree on."""

    def __init__(self) -> None:
        self._began: tuple[float, float] | None = None
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
        began, at_first = self._began
        if now - began < WINDOW:
            return
        speed = (boot - at_first) / (now - began)
        self._speeds.append(speed)
        agree = len(self._speeds) == WINDOWS and max(self._speeds) - min(self._speeds) < ALIKE * max(speed, 1.0)
        self.found = speed if agree and all(abs(one - 1) > OFF for one in self._speeds) else None
        self.noticed = self.found if self.noticed is None else self.noticed
        self._began = (now, boot)
