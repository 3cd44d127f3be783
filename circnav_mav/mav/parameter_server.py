"""The MAVLink parameter protocol for a few values of ours: listed, read and set from a ground station's editor.

Every value is a MAV_PARAM_TYPE_REAL32: ArduPilot and PX4 encode integers differently in PARAM_VALUE, floats alike.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from math import isfinite
from typing import NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Ids, Message

REAL32 = dialect.MAV_PARAM_TYPE_REAL32
REQUESTS = frozenset(
    getattr(dialect, f"MAVLINK_MSG_ID_PARAM_{name}") for name in ("REQUEST_LIST", "REQUEST_READ", "SET")
)
"""Ids of the messages that ask for a parameter."""
EVERY_COMPONENT = 0
"""Target component of a request to all components (MAVLink)."""
MOST_AT_ONCE = 2
"""Values sent in one step: a whole list at once would delay setpoints on a slow link."""


class Parameter(NamedTuple):
    """One value. name: at most 16 characters. read: returns the value in the parameter's unit. write: takes the new
    value and the time (s), and returns why it is refused, empty if it is in use."""

    name: str
    read: Callable[[], float]
    write: Callable[[float, float], str]


class ParameterServer:
    """Answers requests for parameters. What is to be sent is collected, and given out a little at a time."""

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self._parameters = tuple(parameters)
        self._index = {parameter.name: index for index, parameter in enumerate(self._parameters)}
        self._waiting: dict[int, None] = {}
        """Indexes of the values to send, in the order of their requests; each once, however often it is requested."""
        self.counts = Counter[str]()

    def receive(self, message: Message, us: Ids, refusal: str, now: float) -> str:
        """Take in a request. us: system and component that are addressed. refusal: why no value may be set, empty if
        it may. Return why this one was not set, empty otherwise."""
        component = message.target_component
        is_set = message.get_msgId() == dialect.MAVLINK_MSG_ID_PARAM_SET
        if message.target_system != us[0] or component not in (us[1], us[1] if is_set else EVERY_COMPONENT):
            return ""
        if message.get_msgId() == dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            self._waiting |= dict.fromkeys(range(len(self._parameters)))
            return ""
        name = message.param_id.partition("\0")[0]
        by_index = -1 if is_set else message.param_index
        index = self._index.get(name) if by_index < 0 else by_index
        if index is None or not 0 <= index < len(self._parameters):
            return ""
        self._waiting[index] = None  # the value in use is the answer to a PARAM_SET, whether it was taken or not
        return self._set(self._parameters[index], message, refusal, now) if is_set else ""

    def _set(self, parameter: Parameter, message: Message, refusal: str, now: float) -> str:
        value = message.param_value
        if not refusal and not isfinite(value):
            refusal = "not a finite number"
        if not refusal and message.param_type != REAL32:
            refusal = "send it as REAL32"
        refusal = refusal or parameter.write(value, now)
        self.counts["refused" if refusal else "set"] += 1
        return refusal and f"{parameter.name} not set: {refusal}"

    def replies(self) -> list[Message]:
        """Return the messages to send in this step."""
        now, later = list(self._waiting)[:MOST_AT_ONCE], list(self._waiting)[MOST_AT_ONCE:]
        self._waiting = dict.fromkeys(later)
        return [
            dialect.MAVLink_param_value_message(
                self._parameters[index].name.encode(), self._parameters[index].read(), REAL32, len(self._parameters),
                index,
            )
            for index in now
        ]  # fmt: skip
