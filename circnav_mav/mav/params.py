"""Reader of the vehicle's parameters by name: PARAM_REQUEST_READ with retries, never a write.

ArduPilot 4.6 and PX4 do not answer requests of an unknown name, so an unanswered name is treated as
unknown. The request queues of autopilots are short (ArduPilot: 20 requests, 5 answers), so few
requests are pending at a time.
"""

import struct
from collections.abc import Iterable

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Ids, Message
from circnav_mav.mav.framing import HEADERS
from circnav_mav.mav.statustext import plain_text

_FORMATS = {
    dialect.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    dialect.MAV_PARAM_TYPE_INT8: "<bxxx",
    dialect.MAV_PARAM_TYPE_UINT16: "<Hxx",
    dialect.MAV_PARAM_TYPE_INT16: "<hxx",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}


def parameter_value(message: Message, *, bytewise: bool) -> float:
    """Return the number in a PARAM_VALUE. bytewise: False for ArduPilot, which casts integers to
    float (C cast). True for PX4, which sends the bytes of an integer in place of the float.

    The bytes are read from the frame itself, after its header. Read as a float, an integer's bytes
    may be a signaling NaN, which Python changes. (pymavlink's `get_payload` uses a wrong offset in
    MAVLink 2.)
    """
    layout = _FORMATS.get(message.param_type)
    if not bytewise or layout is None:
        return float(message.param_value)
    frame = bytes(message.get_msgbuf())
    return float(struct.unpack_from(layout, frame, HEADERS[frame[0]].size)[0])


class ParameterReader:
    """Reader that requests each name until it is answered or its tries are used up."""

    def __init__(self, names: Iterable[str], *, bytewise: bool) -> None:
        """bytewise: encoding of integers, see `parameter_value`."""
        self._bytewise = bytewise
        self._waiting = list(dict.fromkeys(names))
        self._names = frozenset(self._waiting)
        self._asked: dict[str, tuple[int, float]] = {}
        """Number of tries so far and time of the next try, s, by pending name."""
        self.values: dict[str, float] = {}

    @property
    def done(self) -> bool:
        """True if no requests are left."""
        return not self._waiting and not self._asked

    def receive(self, message: Message) -> None:
        """Process a PARAM_VALUE of our vehicle. Answers to other programs are used if the name is
        on our list. The first answer is used, even after the last try."""
        name = plain_text(message.param_id)
        if name in self._names and name not in self.values:
            self.values[name] = parameter_value(message, bytewise=self._bytewise)
            self._asked.pop(name, None)
            self._waiting = [other for other in self._waiting if other != name]

    def poll(self, target: Ids, now: float) -> list[Message]:
        """Return the requests due now: first repeated requests, then new requests up to the limit
        of pending requests."""
        due = [name for name, (_, when) in self._asked.items() if now >= when]
        # 3: largest number of requests per parameter.
        for name in [name for name in due if self._asked[name][0] >= 3]:
            del self._asked[name]
        # 5: limit of pending requests, which keeps the queue in a slow radio short.
        room = 5 - len(self._asked)
        new = self._waiting[:room]
        self._waiting = self._waiting[room:]
        names = [name for name in due if name in self._asked] + new
        for name in names:
            tries, _ = self._asked.get(name, (0, now))
            # 0.7: time, s, until an unanswered request is repeated.
            self._asked[name] = tries + 1, now + 0.7
        # -1: param_index of a request by name (MAVLink).
        return [
            dialect.MAVLink_param_request_read_message(*target, name.encode("ascii"), -1)
            for name in names
        ]
