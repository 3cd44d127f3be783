"""Server of the MAVLink parameter protocol: a ground station's editor lists, reads and sets a few
values of circnav.

Every value is a MAV_PARAM_TYPE_REAL32. ArduPilot and PX4 encode integers differently in
PARAM_VALUE, but not floats.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from math import isfinite
from typing import NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Ids, Message, ids

REAL32 = dialect.MAV_PARAM_TYPE_REAL32
REQUESTS = frozenset(
    getattr(dialect, f"MAVLINK_MSG_ID_PARAM_{name}")
    for name in ("REQUEST_LIST", "REQUEST_READ", "SET")
)
"""Ids of the messages that request or set parameters."""
MOST_AT_ONCE = 2
"""Largest number of values sent in one step. A whole list at once would delay setpoints on a slow
link."""


class Parameter(NamedTuple):
    """One parameter.

    name: at most 16 characters.
    read: returns the value in the parameter's unit.
    write: takes the new value and the time (s), and returns the reason for a rejection, empty if it
        was accepted.
    """

    name: str
    read: Callable[[], float]
    write: Callable[[float, float], str]


class ParameterServer:
    """Queue of answers to parameter requests, sent a few at a time."""

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self._parameters = tuple(parameters)
        self._index = {parameter.name: index for index, parameter in enumerate(self._parameters)}
        self._waiting: dict[int, None] = {}
        """Indexes of the values to send, in the order of their requests, without duplicates."""
        self._errors: list[Message] = []
        self.counts = Counter[str]()

    def receive(self, message: Message, us: Ids, refusal: str, now: float) -> str:
        """Process a request. Return the reason why a value was not set, otherwise empty.

        us: our own ids. refusal: reason why no value may be set now, empty if setting is permitted.
        """
        target = (message.target_system, message.target_component)
        is_set = message.get_msgId() == dialect.MAVLINK_MSG_ID_PARAM_SET
        # 0 addresses all systems or all components (MAVLink). Only a request to our own ids sets a
        # value.
        if target != us and (is_set or target[0] not in (us[0], 0) or target[1] not in (us[1], 0)):
            return ""
        if message.get_msgId() == dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            self._waiting |= dict.fromkeys(range(len(self._parameters)))
            return ""
        name = message.param_id.partition("\0")[0]
        by_index = -1 if is_set else message.param_index
        index = self._index.get(name) if by_index < 0 else by_index
        if index is None or not 0 <= index < len(self._parameters):
            if target == us:
                self._report(message, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST)
            return ""
        # A PARAM_SET is answered with the value in use, accepted or not
        self._waiting[index] = None
        return self._set(self._parameters[index], message, refusal, now) if is_set else ""

    def _set(self, parameter: Parameter, message: Message, refusal: str, now: float) -> str:
        value = message.param_value
        error = dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
        if refusal:
            error = dialect.MAV_PARAM_ERROR_PERMISSION_DENIED
        elif not isfinite(value):
            refusal = "not a finite number"
        elif message.param_type != REAL32:
            refusal = "send it as REAL32"
        refusal = refusal or parameter.write(value, now)
        self.counts["refused" if refusal else "set"] += 1
        if refusal:
            self._report(message, error)
        return refusal and f"{parameter.name} not set: {refusal}"

    def _report(self, message: Message, error: int) -> None:
        """Queue a PARAM_ERROR for the sender of a request."""
        is_set = message.get_msgId() == dialect.MAVLINK_MSG_ID_PARAM_SET
        index = -1 if is_set else message.param_index
        name = message.param_id.partition("\0")[0].encode("ascii", "replace")
        if len(self._errors) < MOST_AT_ONCE:
            self._errors.append(
                dialect.MAVLink_param_error_message(*ids(message), name, index, error)
            )

    def replies(self) -> list[Message]:
        """Return the messages to send in this step."""
        errors = self._errors
        self._errors = []
        now = list(self._waiting)[:MOST_AT_ONCE]
        later = list(self._waiting)[MOST_AT_ONCE:]
        self._waiting = dict.fromkeys(later)
        return errors + [
            dialect.MAVLink_param_value_message(
                self._parameters[index].name.encode(),
                self._parameters[index].read(),
                REAL32,
                len(self._parameters),
                index,
            )
            for index in now
        ]
