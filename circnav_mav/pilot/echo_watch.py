"""Detects a second controller by comparing the setpoints that the vehicle reports with the sent setpoints."""

from collections import deque

KEPT = 3.0
"""Time, s, in addition to the round trip, for which the vehicle may still report a sent setpoint. In a shorter,
unnoticed outage of the uplink, the vehicle flies the last setpoint that it received."""
GAP = 0.5
"""Time without a setpoint, s, after which the next one starts a new stream."""
SETTLED = 2.0
"""Time since the start of a stream, s, after which the vehicle is expected to report its setpoints."""
SLACK, SHARE = 0.03, 0.1
"""Tolerated difference: rad/s or rad, and share of the sent turn. The resolution of autopilots is 0.001."""
MANY, WITHIN = 4, 5.0
"""Number of differing reports that count as evidence, and time, s, within which these reports must arrive."""


class EchoWatch:
    """Detects reported turns outside the range of the turns sent recently. Turns are yaw rates (rad/s) or banks (rad),
    right positive."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, float]] = deque()
        self._since = float("-inf")
        self._others: deque[tuple[float, float | None, float]] = deque(maxlen=MANY)
        """Newest differing reports: time, reported turn, nearest turn sent."""

    def sent(self, turn: float, now: float) -> None:
        """Record a setpoint that is sent now."""
        if not self._sent or now - self._sent[-1][0] > GAP:
            self._since = now
            self._sent.clear()
        self._sent.append((now, turn))

    def reported(self, turn: float | None, now: float, round_trip: float, *, limited: bool) -> None:
        """Record the turn in a report of the flown setpoint, None if the setpoint has no turn. limited: True if the
        autopilot may reduce a setpoint, as a bank, so that any turn between 0 and the sent turn may be ours."""
        oldest = now - KEPT - round_trip
        while len(self._sent) > 1 and self._sent[1][0] <= oldest:
            self._sent.popleft()
        if not self._sent or now - self._sent[-1][0] > GAP or now - self._since < SETTLED + round_trip:
            return
        turns = [one for _, one in self._sent] + [0.0] * limited
        least, most = min(turns), max(turns)
        slack = SLACK + SHARE * max(abs(least), abs(most))
        if turn is None or not least - slack <= turn <= most + slack:
            self._others.append((now, turn, min(max(turn or 0.0, least), most)))

    def other(self, now: float) -> tuple[float | None, float] | None:
        """Return the newest reported turn that was not sent (None for another kind of setpoint) and the nearest one
        sent. Return None if too few reports differ."""
        if len(self._others) < MANY or now - self._others[0][0] > WITHIN:
            return None
        return self._others[-1][1:]
