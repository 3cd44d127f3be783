"""Evidence that another program also steers the vehicle: setpoints that the vehicle reports and we
did not send, and answers to commands that we did not send."""

from collections import deque
from math import degrees

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import turn_in
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.codec import Message
from circnav_mav.mav.session import Session
from circnav_mav.pilot.mission_state import MissionState
from circnav_mav.timers import Since

GAP = 0.5
"""Time without a setpoint, s, after which the next setpoint starts a new stream."""
SLACK = 0.03
"""Constant part of the tolerated difference between reported and sent turn, rad/s or rad.
Autopilots report turns with a resolution of 0.001."""
SHARE = 0.1
"""Further part of the tolerated difference, as a share of the sent turn."""
MANY = 4
"""Number of differing reports within WITHIN that are evidence of another program."""
WITHIN = 5.0
"""Time in which differing reports are counted, s."""


class EchoMonitor:
    """Detects reported turns outside the range of the turns sent recently. Turns are yaw rates
    (rad/s) or banks (rad), right positive."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, float]] = deque()
        self._since_start = Since()
        self._others: deque[tuple[float, float | None, float]] = deque(maxlen=MANY)
        """Newest differing reports: time, reported turn, nearest turn sent."""

    def sent(self, turn: float, now: float) -> None:
        """Record a setpoint that is sent now."""
        if not self._sent or now - self._sent[-1][0] > GAP:
            self._since_start.restart(now)
            self._sent.clear()
        self._sent.append((now, turn))

    def reported(self, turn: float | None, now: float, round_trip: float, *, limited: bool) -> None:
        """Record the turn in the vehicle's report of its setpoint, None if that setpoint has no
        turn. limited: True if the autopilot may reduce the sent turn (banks). Then any reported
        turn between 0 and the sent turn is accepted as ours."""
        # 3.0: time, s, in addition to the round trip, for which the vehicle may still report a sent
        # setpoint. In an outage of the uplink that is too short to be detected, the vehicle flies
        # the last setpoint that it received.
        oldest = now - 3.0 - round_trip
        while len(self._sent) > 1 and self._sent[1][0] <= oldest:
            self._sent.popleft()
        # 2.0: time since the start of a stream of setpoints, s, after which the vehicle is expected
        # to report them.
        if (
            not self._sent
            or now - self._sent[-1][0] > GAP
            or self._since_start.age(now) < 2.0 + round_trip
        ):
            return
        turns = [one for _, one in self._sent] + [0.0] * limited
        least, most = min(turns), max(turns)
        slack = SLACK + SHARE * max(abs(least), abs(most))
        if turn is None or not least - slack <= turn <= most + slack:
            self._others.append((now, turn, min(max(turn or 0.0, least), most)))

    def other(self, now: float) -> tuple[float | None, float] | None:
        """Return the newest reported turn that was not sent (None for another kind of setpoint),
        and the nearest sent turn. Return None if too few reports differ."""
        if len(self._others) < MANY or now - self._others[0][0] > WITHIN:
            return None
        return self._others[-1][1:]


class SecondController:
    """Compares the setpoints that the vehicle reports, and the commands that it acknowledges, with
    the setpoints and commands that circnav has sent."""

    reads = frozenset(
        dialect.mavlink_map[one.echo].msgname for one in AUTOPILOTS.values() if one.echo is not None
    )
    """Types of the messages that `receive` processes."""

    def __init__(self, session: Session, mission: MissionState) -> None:
        self._session = session
        self._mission = mission
        self._echo = EchoMonitor()

    def reset(self) -> None:
        """Forget the setpoints. Call after a change of the setpoint method."""
        self._echo = EchoMonitor()

    def sent(self, message: Message, now: float) -> None:
        """Record a setpoint that is sent now."""
        if (turn := turn_in(message)) is not None:
            self._echo.sent(turn, now)

    def receive(self, message: Message, now: float) -> None:
        """Process a message of the vehicle. Reported setpoints are ignored while the vehicle does
        not answer TIMESYNC: without our setpoints, a vehicle may fly setpoints of its own."""
        adapter = self._session.adapter
        timesync = self._session.timesync
        # 3.0: time without an answer to TIMESYNC, s, after which reports are ignored.
        if message.get_msgId() == adapter.echo and not timesync.silent(now, 3.0):
            self._echo.reported(
                turn_in(message), now, timesync.worst or 0.0, limited=adapter.fixed_wing
            )

    def evidence(self, now: float) -> str:
        """Return the evidence that another program steers the vehicle, human-readable, or an empty
        string."""
        if self._session.commands.answered_unasked(now):
            return "the vehicle answers commands that were sent with our ids by another program"
        if not self._mission.steering or (turns := self._echo.other(now)) is None:
            return ""
        unit = "deg of bank" if self._session.adapter.fixed_wing else "deg/s"
        reported, sent = turns
        flown = (
            "another kind of setpoint" if reported is None else f"{degrees(reported):+.0f} {unit}"
        )
        return f"the vehicle flies {flown}, commanded {degrees(sent):+.0f} {unit}"
