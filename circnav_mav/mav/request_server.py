"""Answers that MAVLink expects of every component: to commands, PING, a ground station's TIMESYNC,
and requests of a mission plan."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Ids, Message, ids

ANSWERED = frozenset(
    getattr(dialect, f"MAVLINK_MSG_ID_{name}")
    for name in ("COMMAND_LONG", "COMMAND_INT", "PING", "TIMESYNC", "MISSION_REQUEST_LIST")
)
"""Ids of the messages that are answered."""
MOST_AT_ONCE = 4
"""Largest number of answers sent in one step. Further requests are not answered."""
MOST_STATIONS = 8
"""Largest number of ground stations that are remembered."""


class RequestServer:
    """Queue of answers to ground stations and other components."""

    def __init__(self) -> None:
        self._stations: set[Ids] = set()
        self._answers: list[Message] = []

    def receive(self, message: Message, us: Ids, now: float) -> None:
        """Process a message on the vehicle's link, if it asks for an answer. us: our own ids."""
        sender = ids(message)
        if sender == us:
            return
        is_station = message.get_type() == "HEARTBEAT" and message.type == dialect.MAV_TYPE_GCS
        if is_station and len(self._stations) < MOST_STATIONS:
            self._stations.add(sender)
        if message.get_msgId() not in ANSWERED or len(self._answers) >= MOST_AT_ONCE:
            return
        answer = self._answer(message, sender, us, now)
        if answer is not None:
            self._answers.append(answer)

    def _answer(self, message: Message, sender: Ids, us: Ids, now: float) -> Message | None:
        """Return the answer to a message, None if it is not for us."""
        if message.get_type() == "TIMESYNC":
            # Answer ground stations only: the autopilot of another vehicle would follow our clock.
            # The session answers the requests of our own vehicle.
            is_request = message.tc1 == 0 and sender in self._stations
            clock = int(now * 1e9) or 1
            return dialect.MAVLink_timesync_message(clock, message.ts1) if is_request else None
        target = (message.target_system, message.target_component)
        if message.get_type() == "PING":
            # A PING with a target is an answer.
            echo = dialect.MAVLink_ping_message(message.time_usec, message.seq, *sender)
            return echo if target == (0, 0) else None
        if target != us:
            return None
        if message.get_type() == "MISSION_REQUEST_LIST":
            return dialect.MAVLink_mission_count_message(*sender, 0, message.mission_type)
        unsupported = dialect.MAV_RESULT_UNSUPPORTED
        return dialect.MAVLink_command_ack_message(message.command, unsupported, 0, 0, *sender)

    def replies(self) -> list[Message]:
        """Return the messages to send in this step."""
        answers = self._answers
        self._answers = []
        return answers
