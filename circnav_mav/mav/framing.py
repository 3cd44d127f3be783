"""Where MAVLink frames lie in bytes, and whether they are good: the rules of https://mavlink.io/en/guide/serialization.html.

pymavlink's own stream parser throws away the claimed length of a bad frame, and with it the good frames inside; here a
bad start is stepped over by one byte, so that a stray byte costs nothing.
"""

from collections.abc import Iterator
from struct import Struct
from typing import NamedTuple

from pymavlink.dialects.v20 import all as dialect

V1, V2 = 0xFE, 0xFD
MAGICS = (V1, V2)
SIGNED = 0x01
CRC, SIGNATURE = 2, 13
"""Lengths of the tails of a frame, bytes."""
_HEADER_1 = Struct("<xBxBBB")
_HEADER_2 = Struct("<xBBxxBBHB")


class Frame(NamedTuple):
    """A frame as its header tells it. end: behind its last byte, past the buffer where not all of it is there.
    ident, system, component: of the message and its sender, 0 where not even the header is there."""

    start: int
    end: int
    ident: int = 0
    system: int = 0
    component: int = 0
    version: int = 2
    signed: bool = False

    @property
    def known(self) -> bool:
        """Whether the dialect knows the message."""
        return self.ident in dialect.mavlink_map


def frame_at(buffer: bytes, at: int) -> Frame | None:
    """The frame that starts here, as far as its header claims; None: no frame starts here."""
    magic, left = buffer[at], len(buffer) - at
    if magic == V2:
        if left > 2 and buffer[at + 2] & ~SIGNED:
            return None
        if left < _HEADER_2.size:
            return Frame(at, len(buffer) + 1)
        length, flags, system, component, low, high = _HEADER_2.unpack_from(buffer, at)
        end = at + _HEADER_2.size + length + CRC + (SIGNATURE if flags else 0)
        return Frame(at, end, low | high << 16, system, component, 2, bool(flags))
    if magic != V1:
        return None
    if left < _HEADER_1.size:
        return Frame(at, len(buffer) + 1, version=1)
    length, system, component, ident = _HEADER_1.unpack_from(buffer, at)
    return Frame(at, at + _HEADER_1.size + length + CRC, ident, system, component, 1)


def must_wait(buffer: bytes, frame: Frame) -> bool:
    """Whether a stream has not yet shown all that decides on this frame: the rest of it, or, for an unknown id, the
    byte behind it."""
    return frame.end > len(buffer) or (frame.end == len(buffer) and not frame.known)


def is_good(buffer: bytes, frame: Frame) -> bool:
    """Whether a good frame lies here: its CRC is right, or, for an id that the dialect does not know and whose CRC
    cannot be told, another frame or the end follows and no good frame lies inside."""
    if frame.end > len(buffer):
        return False
    if frame.known:
        return _crc_is_right(buffer, frame)
    if frame.end < len(buffer) and buffer[frame.end] not in MAGICS:
        return False
    return not any(inner.known and _crc_is_right(buffer, inner) for inner in _inside(buffer, frame))


def _inside(buffer: bytes, frame: Frame) -> Iterator[Frame]:
    """The frames that seem to start inside another and are all there."""
    for at in range(frame.start + 1, frame.end):
        inner = frame_at(buffer, at)
        if inner is not None and inner.end <= len(buffer):
            yield inner


def _crc_is_right(buffer: bytes, frame: Frame) -> bool:
    """Whether the CRC of a frame of a known id, all of which is there, is right."""
    tail = frame.end - CRC - (SIGNATURE if frame.signed else 0)
    extra = bytes((dialect.mavlink_map[frame.ident].crc_extra,))
    crc = dialect.x25crc(buffer[frame.start + 1 : tail] + extra).crc
    return bool(crc == buffer[tail] | buffer[tail + 1] << 8)


def split_frames(data: bytes) -> list[bytes]:
    """Our own output cut into its frames; it is whole by construction."""
    frames, at = [], 0
    while at < len(data) and (frame := frame_at(data, at)) is not None:
        frames.append(data[at : frame.end])
        at = frame.end
    return frames
