"""Asking for a mode: the guided one before the flight, the exit action after it."""

from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import once
from circnav_mav.mav.session import Session

PROOF = 3.0
"""Time, s, that an accepted request has to show in the vehicle's heartbeat (PX4 sends one a second)."""
TRIES = 3
"""Times that an exit action is asked for before the safe setpoints end it; chosen."""
SAFE_SETPOINTS = 3
"""Times that the safe setpoint is sent before silence: a datagram can be lost."""
PATIENCE = 12.0
"""Time, s, that the exit action may take before we fall silent without it."""
STOP_SENDING = "stop"


class ModeRequest:
    """One mode that is wanted: asked for, asked for again, and given up with a reason. Only the vehicle's own heartbeat
    shows that it was entered."""

    def __init__(self) -> None:
        self._tries = 0
        self._due = float("-inf")
        self._dropped = 0

    def pending(self, now: float) -> bool:
        """Whether the vehicle may still enter the mode that it was asked for."""
        return now < self._due

    def ask(self, session: Session, mode: int, now: float) -> str | None:
        """Keep asking; answers with the reason when there is no more use in it."""
        said = f', the vehicle says "{session.texts[-1]}"' if session.texts else ""
        refusals = [result for result in session.take_mode_results() if not result.accepted]
        if refusals:
            self._due = float("-inf")
            return f"refused: {refusals[0].said}{said}"
        if session.mode_requests_dropped > self._dropped and self._due > now:
            self._tries, self._due = self._tries - 1, now  # dropped before its answer: that was no try
        self._dropped = session.mode_requests_dropped
        if now < self._due or session.vehicle.mode == mode:
            return None
        if self._tries == TRIES:
            return f"acknowledged, but the vehicle stays in {session.vehicle.mode_name}{said}"
        self._tries, self._due = self._tries + 1, now + PROOF
        session.commands.send(session.adapter.request_mode(mode))
        return None


class ExitAction:
    """The exit action of a mission, the autopilot's default where it names none: asked for with safe setpoints until
    the vehicle's own mode shows it."""

    def __init__(self, action: str | None) -> None:
        """action: name of a mode of the autopilot, STOP_SENDING, None for the autopilot's default."""
        self.action = action
        self._request = ModeRequest()
        self._safe_left = SAFE_SETPOINTS
        self.failure: str | None = None
        """Why the exit action is of no effect."""

    def go_on(self, session: Session, since: float, now: float) -> bool:
        """Ask for the exit action, leaving since then (s); tells whether the safe setpoint now sent is the last."""
        action = self._named(session)
        self._safe_left -= 1
        if action == STOP_SENDING:
            return self._safe_left <= 0
        failure = self._request.ask(session, session.adapter.exits[action], now)
        if failure is None and now - since > PATIENCE:
            failure = "had no effect"
        if failure is not None:
            self.failure = f"exit action {action} {failure}"
        return failure is not None

    def wait_to_speak(self, since: float, now: float) -> bool:
        """While nothing may be said (after a stall, or of a vehicle that may be another one); tells whether that has
        taken too long."""
        if now - since <= PATIENCE:
            return False
        self.failure = "exit action not requested: not known who has the vehicle"
        return True

    def at_once(self, session: Session) -> list[Message]:
        """The exit action asked for once, by somebody who will not hear the answer."""
        action = self._named(session)
        if action == STOP_SENDING:
            return []
        return [once(session.adapter.request_mode(session.adapter.exits[action]), session.vehicle_ids)]

    def _named(self, session: Session) -> str:
        return self.action or session.adapter.default_exit
