"""Bytes to MAVLink messages and back. One parser and one sequence counter per link; junk is counted, never raised."""

import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

Message = Any
"""A pymavlink message: its fields are attributes that only the dialect knows."""

V1_LARGEST_ID = 255
V2_MARKER = 0xFD


class Parser:
    """Bytes in, messages out."""

    def __init__(self, version: int) -> None:
        self._version = version
        self._mav = _engine(0, 0)
        self.bad = 0

    def messages(self, data: bytes, *, stream: bool) -> list[Message]:
        """A datagram starts afresh: one stray byte must not eat the next frames. A stream goes on where it was cut."""
        mav = self._mav
        if not stream:
            mav.buf = bytearray()
            mav.buf_index = 0
            mav.expected_length = 8
        found = mav.parse_buffer(data) or []
        good = [m for m in found if self._readable(m)]
        self.bad += len(found) - len(good)
        return good

    def _readable(self, message: Message) -> bool:
        """Unknown ids and broken frames are noise, and a MAVLink 1 autopilot does not see MAVLink 2 frames."""
        if message.get_msgId() < 0:
            return False
        return self._version == 2 or bool(message.get_msgbuf()[0] != V2_MARKER)


class Sender:
    """Frames from one component on one link, numbered. `prepare` is shown the engine before each of them."""

    def __init__(
        self, system: int, component: int, version: int, prepare: Callable[[mavlink.MAVLink], None] | None = None
    ) -> None:
        self._mav = _engine(system, component)
        self._prepare = prepare
        self._version_1 = version == 1

    def frame(self, message: Message) -> bytes | None:
        """The frame, or None when this MAVLink version cannot carry it."""
        if self._version_1 and message.get_msgId() > V1_LARGEST_ID:
            return None
        if self._prepare is not None:
            self._prepare(self._mav)
        try:
            data: bytes = message.pack(self._mav, force_mavlink1=self._version_1)
        except (struct.error, OverflowError):  # a vehicle flown to where its numbers no longer fit the field
            return None
        self._mav.seq = (self._mav.seq + 1) % 256
        return data


def _engine(system: int, component: int) -> mavlink.MAVLink:
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.robust_parsing = True
    return mav
