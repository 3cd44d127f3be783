"""Mode requests: the guided mode before the flight, the exit action after it."""

from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import once
from circnav_mav.mav.session import Session

PATIENCE = 12.0
"""Longest time, s, until the exit action takes effect. After this time the stream of setpoints
ends, even if the exit action had no effect."""
STOP_SENDING = "stop"


class ModeRequest:
    """Request of one mode, repeated until the vehicle's heartbeat confirms the mode, or until the
    request fails."""

    def __init__(self) -> None:
        self._tries = 0
        self._due = float("-inf")
        self._dropped = 0

    def pending(self, now: float) -> bool:
        """True if the vehicle may still enter the requested mode."""
        return now < self._due

    def ask(self, session: Session, mode: int, now: float) -> str | None:
        """Send a request if one is due. Return the reason if the mode request has finally failed,
        else None. The first report of the mode ends the request."""
        if session.vehicle.mode == mode:
            # Its acknowledgment may be lost. Another request would replace a mode that the operator
            # enters next.
            session.drop_mode_requests()
            self._dropped = session.mode_requests_dropped
            self._due = float("-inf")
            self._tries = 0
            return None
        report = (
            f', the vehicle reports "{session.vehicle.texts[-1]}"' if session.vehicle.texts else ""
        )
        refusals = [result for result in session.take_mode_results() if not result.accepted]
        if refusals:
            self._due = float("-inf")
            return f"refused: {refusals[0].answer}{report}"
        if session.mode_requests_dropped > self._dropped and self._due > now:
            # the request was dropped before an answer: do not count it
            self._tries = self._tries - 1
            self._due = now
        self._dropped = session.mode_requests_dropped
        if now < self._due:
            return None
        # 3: number of unsuccessful requests after which the mode request has failed.
        if self._tries == 3:
            return f"acknowledged, but the vehicle stays in {session.vehicle.mode_name}{report}"
        self._tries = self._tries + 1
        # 3.0: longest time, s, until the vehicle's heartbeat shows the mode of an accepted request
        # (PX4 sends one heartbeat per second).
        self._due = now + 3.0
        session.commands.send(session.adapter.request_mode(mode))
        return None


class ExitAction:
    """Exit action of a mission, requested along with safe setpoints until the vehicle's mode
    confirms it."""

    def __init__(self, action: str | None) -> None:
        """action: name of a mode of the autopilot, STOP_SENDING, or None for the autopilot's
        default."""
        self.action = action
        self._request = ModeRequest()
        self._steps = 0
        """Number of steps since the exit action has begun."""
        self.low = False
        """True near the ground, and after the vehicle has refused the exit action of the mission:
        the adapter's `low_exit` is requested."""
        self.failure: str | None = None
        """Reason why the exit action had no effect."""

    def go_on(self, session: Session, since: float, now: float) -> bool:
        """Request the exit action. since: beginning of the phase LEAVING, s. Return True if the
        safe setpoint of this step is the last one."""
        action = self.named(session)
        self._steps += 1
        # 3: number of safe setpoints that the exit action `stop` sends before the stream ends. More
        # than one, because a datagram can be lost.
        if action == STOP_SENDING:
            return self._steps >= 3
        failure = self._request.ask(session, session.adapter.exits[action], now)
        if failure is None and now - since > PATIENCE:
            failure = "had no effect"
        elif failure is not None and not self.low and action != session.adapter.low_exit:
            # A copter that has just lost its position refuses LOITER and RTL, and would stay in the
            # guided mode.
            self.low = True
            self._request = ModeRequest()
            return False
        if failure is not None:
            self.failure = f"exit action {action} {failure}"
        return failure is not None

    def result(self, session: Session) -> str:
        """Return the exit action and what the vehicle does after it. Empty if it has not begun."""
        mode = session.vehicle.mode_name
        action = self.named(session)
        if self._steps == 0 or self.failure is not None:
            return ""
        if action == STOP_SENDING:
            return f"{action}: the vehicle stops in {mode}, take it over"
        return f"{action}: the vehicle is in {mode}"

    def wait_to_send(self, since: float, now: float) -> bool:
        """Wait while nothing may be sent: after a stall, or while the vehicle's identity is
        unconfirmed. Return True after PATIENCE seconds."""
        if now - since <= PATIENCE:
            return False
        self.failure = "exit action not requested: no report of the vehicle's mode"
        return True

    def at_once(self, session: Session) -> list[Message]:
        """Return the request of the exit action, for a caller that does not read the answer."""
        action = self.named(session)
        if action == STOP_SENDING:
            return []
        return [
            once(session.adapter.request_mode(session.adapter.exits[action]), session.vehicle_ids)
        ]

    def named(self, session: Session) -> str:
        """Return the exit action of the mission, or the default if the vehicle cannot perform it: a
        copter that has lost its GPS cannot hold a place or fly home. Near the ground, return the
        action that does not climb."""
        adapter = session.adapter
        if self.low:
            return adapter.low_exit
        possible = self.action in adapter.exits or (
            self.action == STOP_SENDING and not adapter.why_no_stop
        )
        return self.action if self.action is not None and possible else adapter.default_exit
