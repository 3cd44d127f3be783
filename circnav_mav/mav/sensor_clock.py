"""From a sensor's clock to ours, when all that is known is that no message arrives before it was sent."""

WINDOW = 100
"""Samples after which the least lag is taken anew, so that a drifting sensor clock is followed."""


class SensorClock:
    """Local time = sensor stamp + offset, where the offset is the least seen of (arrival - stamp).

    The idea is that of ArduPilot's JitterCorrection: delay on the way only ever adds. A constant delay cannot be told
    from a clock difference and stays in.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the offset: the sensor's clock has jumped."""
        self._offset: float | None = None
        self._candidate = float("inf")
        self._count = 0

    def local(self, stamp: float, arrival: float) -> float:
        """The local time of a sample that was stamped `stamp` there and arrived at `arrival` here, s."""
        lag = arrival - stamp
        self._candidate = min(self._candidate, lag)
        self._count += 1
        if self._offset is None or lag < self._offset:
            self._offset = lag
        if self._count >= WINDOW:
            self._offset, self._candidate, self._count = self._candidate, float("inf"), 0
        return min(stamp + self._offset, arrival)
