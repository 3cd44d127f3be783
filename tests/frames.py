"""Contents of a MAVLink 2 frame, and the same frame with changed fields."""

from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Pilot
from tests.tools.fault_link.frames import write


def output(pilot: Pilot, now: float) -> bytes:
    """Return all frames that a pilot sends in a step."""
    out: list[bytes] = []

    def send(data: bytes) -> bool:
        out.append(data)
        return True

    pilot.step(now, send)
    return b"".join(out)


def sender(frame: bytes) -> tuple[int, int]:
    """System and component id."""
    return frame[5], frame[6]


def read(frame: bytes) -> Any:
    """Return the message in a good frame."""
    return mavlink.MAVLink(None).decode(bytearray(frame))


def rewritten(frame: bytes, **fields: float) -> bytes:
    """Return the same frame with other values in some fields."""
    message = read(frame)
    values = {name: fields.get(name, getattr(message, name)) for name in message.fieldnames}
    texts = {
        name: value.encode("ascii", "replace")
        for name, value in values.items()
        if isinstance(value, str)
    }
    return write(type(message)(**values | texts), *sender(frame), frame[4])
