"""How fast the autopilot's time runs, seen from ours: a simulator at another speed looks like a vehicle at another."""

WINDOW = 3.0
"""Time, s, over which a speed is taken."""
OFF = 0.1
"""Fraction by which a speed must differ; a link that becomes a second slower shows in one window only."""


class BootClock:
    """Compares times since boot with the times at which they came. A speed is believed that two windows agree on."""

    def __init__(self) -> None:
        self._began: tuple[float, float] | None = None
        self._before = 1.0
        self.found: float | None = None
        """Seconds of the autopilot's per second of ours, None while they go along."""
        self.noticed: float | None = None
        """The first that was found."""

    def heard(self, boot: float, now: float) -> None:
        """A time since boot, s, that came now."""
        if self._began is None or boot < self._began[1]:
            self._began, self._before = (now, boot), 1.0
        began, at_first = self._began
        if now - began < WINDOW:
            return
        speed = (boot - at_first) / (now - began)
        agree = min(abs(speed - 1), abs(self._before - 1)) > OFF and (speed > 1) == (self._before > 1)
        self.found = speed if agree else None
        self.noticed = self.found if self.noticed is None else self.noticed
        self._began, self._before = (now, boot), speed
