"""The last words of a mission: the safe setpoint, and the exit action until the vehicle's own mode shows it."""

from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import once
from circnav_mav.mav.session import Session
from circnav_mav.pilot.handover import ModeRequest

SAFE_SETPOINTS = 3
"""Times that the safe setpoint is sent before silence: a datagram can be lost."""
PATIENCE = 12.0
"""Time, s, that the exit action may take before we fall silent without it."""
STOP_SENDING = "stop"


class Leaving:
    """Keeps what is still to be said. The exit action is the mission's, or the autopilot's default."""

    def __init__(self, action: str | None) -> None:
        """action: name of a mode of the autopilot, STOP_SENDING, None for the autopilot's default."""
        self._action = action
        self._request = ModeRequest()
        self._safe_left = SAFE_SETPOINTS
        self.failure: str | None = None
        """Why the exit action is of no effect."""

    def go_on(self, session: Session, since: float, now: float) -> bool:
        """Ask for the exit action, leaving since so long (s); tells whether the safe setpoint now sent is the last."""
        action = self._named(session)
        self._safe_left -= 1
        if action == STOP_SENDING:
            return self._safe_left <= 0
        failure = self._request.ask(session, session.adapter.exits[action], now)
        if failure is None and now - since > PATIENCE:
            failure = "without effect"
        if failure is not None:
            self.failure = f"exit action {action} {failure}"
        return failure is not None

    def wait_to_speak(self, since: float, now: float) -> bool:
        """After a stall, until a heartbeat has told the mode, or until the vehicle is known to be ours, nothing may be
        said; tells whether that has taken too long."""
        if now - since <= PATIENCE:
            return False
        self.failure = "no exit action asked for: nobody knows whether the vehicle is still ours"
        return True

    def at_once(self, session: Session) -> list[Message]:
        """The exit action asked for once, by somebody who will not hear the answer."""
        action = self._named(session)
        if action == STOP_SENDING:
            return []
        return [once(session.adapter.request_mode(session.adapter.exits[action]), session.vehicle_ids)]

    def _named(self, session: Session) -> str:
        return self._action or session.adapter.default_exit
