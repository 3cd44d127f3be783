"""Nooploop LinkTrack: node frames 2 and 3 and the AoA node frame 0 of its NLink protocol,
little-endian.

Source: the manufacturer's github.com/nooploop-dev/nlink_unpack. Choose one of these frames in
NAssistant.
"""

import struct
from typing import NamedTuple

from circnav_mav.mav.ranging.driver import Driver, RadioReading


class _Layout(NamedTuple):
    """Layout of a frame.

    fixed: number of bytes before the nodes; the last of them is the number of nodes.
    node: number of bytes per node.
    stamped: True if each node has the network time of its measurement, ms, at byte 7 of the node.
        Otherwise the frame has the radio's time, ms, at byte 6.
    """

    fixed: int
    node: int
    stamped: bool


LAYOUTS = {0x04: _Layout(119, 13, True), 0x05: _Layout(21, 7, False), 0x07: _Layout(21, 11, False)}
"""Layout by the second byte of the frame: node frame 2, node frame 3, AoA node frame 0."""


class LinkTrack(Driver):
    """Driver of LinkTrack: ranges to all nodes in sight, by node id."""

    baud = 921600

    def __init__(self) -> None:
        self.unread = 0
        self._rest = b""

    def receive(self, data: bytes, now: float) -> list[RadioReading]:
        buffer = self._rest + data
        at = 0
        readings = []
        while at < len(buffer) and (size := _frame_size(buffer, at)) is not None:
            frame = buffer[at : at + size]
            if size and sum(frame[:-1]) % 256 == frame[-1]:
                readings += _read(frame)
                at += size
            else:
                self.unread += 1
                at += 1
        self._rest = buffer[at:]
        return readings


def _frame_size(buffer: bytes, at: int) -> int | None:
    """Return the size of the frame at an offset, bytes. 0: no frame begins there. None: more bytes
    are needed."""
    left = len(buffer) - at
    # 0x55: first byte of every frame (Nooploop's protocol).
    if buffer[at] != 0x55 or (left > 1 and buffer[at + 1] not in LAYOUTS):
        return 0
    # 4: number of bytes with header, kind and length of a frame.
    if left < 4 or left < (layout := LAYOUTS[buffer[at + 1]]).fixed:
        return None
    size = layout.fixed + layout.node * buffer[at + layout.fixed - 1] + 1
    if size != int.from_bytes(buffer[at + 2 : at + 4], "little"):
        return 0
    return size if left >= size else None


def _read(frame: bytes) -> list[RadioReading]:
    """Return the readings of a frame. A node consists of role, id, range in mm (24 bits, signed),
    two signal strengths, and more."""
    layout = LAYOUTS[frame[1]]
    readings = []
    for at in range(layout.fixed, len(frame) - 1, layout.node):
        (stamp,) = struct.unpack_from("<I", frame, at + 7 if layout.stamped else 6)
        millimetres = int.from_bytes(frame[at + 2 : at + 5], "little", signed=True)
        readings.append(RadioReading(millimetres / 1000, beacon=frame[at + 1], stamp=stamp / 1000))
    return readings
