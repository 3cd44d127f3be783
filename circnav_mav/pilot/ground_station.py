"""Requests of ground stations and other components behind the vehicle's address: parameters,
commands, PING, TIMESYNC, mission plans."""

from pymavlink.dialects.v20.all import MAV_SEVERITY_WARNING, MAVLINK_MSG_ID_HEARTBEAT

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.mav.codec import Message
from circnav_mav.mav.parameter_server import REQUESTS, Parameter, ParameterServer
from circnav_mav.mav.request_server import ANSWERED, RequestServer
from circnav_mav.mav.session import Session
from circnav_mav.pilot.mission_state import MissionState

READS = ANSWERED | REQUESTS | {MAVLINK_MSG_ID_HEARTBEAT}
"""Ids of the messages that `GroundStation` reads."""
UNSIGNED = "the link is not signed; to allow changes: link.unsigned_parameters = true"


class GroundStation:
    """Answers requests, and reports refused changes."""

    def __init__(
        self,
        parameters: tuple[Parameter, ...],
        session: Session,
        mission: MissionState,
        *,
        may_set: bool,
    ) -> None:
        """parameters: values that a ground station may read and set. may_set: False if the link is
        not signed."""
        self._session = session
        self._mission = mission
        self._may_set = may_set
        self._requests = RequestServer()
        self._parameters = ParameterServer(parameters)
        self._spacing_refused = ""

    def receive(self, message: Message, now: float, *, of_vehicle: bool) -> None:
        """Process a message of READS."""
        us = self._session.us
        self._requests.receive(message, us, now)
        if of_vehicle or message.get_msgId() not in REQUESTS:
            return
        refusal = "" if self._may_set else UNSIGNED
        refusal = "the flight is over" if self._mission.outcome is not None else refusal
        if why := self._parameters.receive(message, us, refusal, now):
            self._warn(f"parameter {why.partition(' ')[0]}", why)

    def report_circle(self, request: CircleRequest, why: str) -> None:
        """Report the result of a circle request. why: reason of the refusal, or empty."""
        # A fleet requests spacing twice a second: report the same refusal only once.
        if why and not (request.spaces and why == self._spacing_refused):
            self._warn("circle refused", why)
        self._spacing_refused = why if request.spaces else self._spacing_refused

    def replies(self) -> list[Message]:
        """Return the messages to send in this step."""
        return self._parameters.replies() + self._requests.replies()

    def _warn(self, kind: str, text: str) -> None:
        self._session.announcer.say(kind, text, severity=MAV_SEVERITY_WARNING)
