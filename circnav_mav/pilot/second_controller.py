"""Evidence that another program also steers the vehicle."""

from math import degrees

from circnav_mav.mav.autopilots.interface import turn_in
from circnav_mav.mav.codec import Message
from circnav_mav.mav.session import Session
from circnav_mav.pilot.echo_watch import EchoWatch
from circnav_mav.pilot.mission_state import MissionState

UPLINK_SILENT = 3.0
"""Time without an answer to TIMESYNC, s, after which the vehicle may lack our setpoints and fly its own setpoints."""


class SecondController:
    """Compares the setpoints that the vehicle reports, and the commands that it acknowledges, with the sent ones."""

    def __init__(self, session: Session, mission: MissionState) -> None:
        self._session, self._mission, self._echo = session, mission, EchoWatch()

    def sent(self, message: Message, now: float) -> None:
        """Record a setpoint that is sent now."""
        if (turn := turn_in(message)) is not None:
            self._echo.sent(turn, now)

    def receive(self, message: Message, now: float) -> None:
        """Process a message of the vehicle. Reported setpoints are ignored while the vehicle does not answer TIMESYNC:
        it may then lack our setpoints and fly setpoints of its own."""
        adapter, timesync = self._session.adapter, self._session.timesync
        if message.get_msgId() == adapter.echo and not timesync.silent(now, UPLINK_SILENT):
            self._echo.reported(turn_in(message), now, timesync.worst or 0.0, limited=adapter.banks)

    def evidence(self, now: float) -> str:
        """Return the evidence that another program steers the vehicle, human-readable, or an empty string."""
        if self._session.commands.answered_unasked(now):
            return "the vehicle answers commands that were sent with our ids by another program"
        if not self._mission.steering or (turns := self._echo.other(now)) is None:
            return ""
        unit = "deg of bank" if self._session.adapter.banks else "deg/s"
        reported, sent = turns
        flown = "another kind of setpoint" if reported is None else f"{degrees(reported):+.0f} {unit}"
        return f"the vehicle flies {flown}, commanded {degrees(sent):+.0f} {unit}"
