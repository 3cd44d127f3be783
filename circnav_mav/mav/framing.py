"""Search and check of MAVLink frames in bytes, according to
https://mavlink.io/en/guide/serialization.html.

pymavlink's stream parser skips the whole claimed length of a bad frame, and loses the valid frames
inside. This module skips one byte after a bad start, so that a stray byte loses no frame.
"""

import re
from collections.abc import Callable, Iterable
from itertools import groupby
from struct import Struct
from typing import NamedTuple

from pymavlink.dialects.v20 import all as dialect

V1 = 0xFE
"""First byte of a MAVLink 1 frame."""
V2 = 0xFD
"""First byte of a MAVLink 2 frame."""
MAGICS = (V1, V2)
SIGNED = 0x01
"""Incompatibility flag of a signed frame."""
CRC = 2
"""Length of the checksum behind the payload of a frame, bytes."""
SIGNATURE = 13
"""Length of the signature behind the checksum of a signed frame, bytes."""
_HEADER_1 = Struct("<xBxBBB")
_HEADER_2 = Struct("<xBBxxBBHB")
HEADERS = {V1: _HEADER_1, V2: _HEADER_2}
_EXTRA = {ident: bytes((message.crc_extra,)) for ident, message in dialect.mavlink_map.items()}


def _one_of(numbers: Iterable[int]) -> bytes:
    return b"[" + b"".join(b"\\x%02x" % number for number in numbers) + b"]"


def _known_start() -> re.Pattern[bytes]:
    """Return a pattern for the start of a header with a known id. The lookahead in the pattern
    permits overlapping matches."""
    pages = groupby(sorted(_EXTRA), key=lambda ident: ident >> 8)
    idents = (
        _one_of(ident & 0xFF for ident in page) + re.escape(high.to_bytes(2, "little"))
        for high, page in pages
    )
    version_2 = b"\\xfd(?=.[\\x00\\x01].{4}(?:" + b"|".join(idents) + b"))"
    version_1 = b"\\xfe(?=.{4}" + _one_of(ident for ident in _EXTRA if ident <= 0xFF) + b")"
    return re.compile(version_2 + b"|" + version_1, re.DOTALL)


_crc: Callable[[bytes], int] = dialect.mcrf4xx or (lambda data: int(dialect.x25crc(data).crc))
"""MAVLink's CRC function: the compiled function of the package fastcrc, or pymavlink's function if
fastcrc is missing."""
_START = re.compile(_one_of(MAGICS))
_KNOWN_START = _known_start()


class Frame(NamedTuple):
    """A frame as described by its header.

    end: index after its last byte, beyond the buffer if the frame is incomplete.
    ident, system, component: ids of the message and its sender, 0 if the header is incomplete.
    understood: False if the frame has an incompatibility flag other than SIGNED. Such a frame must
        be discarded, with everything in its payload.
    """

    start: int
    end: int
    ident: int = 0
    system: int = 0
    component: int = 0
    signed: bool = False
    understood: bool = True

    @property
    def known(self) -> bool:
        """True if the message is in the dialect."""
        return self.ident in _EXTRA


def frame_at(buffer: bytes, at: int) -> Frame | None:
    """Return the frame that the header at this index describes, or None if no frame can start
    there."""
    magic = buffer[at]
    left = len(buffer) - at
    if magic not in MAGICS:
        return None
    if left < HEADERS[magic].size:
        return Frame(at, len(buffer) + 1)
    if magic == V1:
        length, system, component, ident = _HEADER_1.unpack_from(buffer, at)
        return Frame(at, at + _HEADER_1.size + length + CRC, ident, system, component)
    length, flags, system, component, low, high = _HEADER_2.unpack_from(buffer, at)
    # The flags 0x02 and 0x04 of pymavlink (2026) append 32-bit ids to the header. For other flags
    # the layout is unknown, so the ordinary layout is assumed.
    extension = (3 if flags & 0x02 else 0) + (4 if flags & 0x04 else 0)
    signed = bool(flags & SIGNED)
    end = at + _HEADER_2.size + extension + length + CRC + (SIGNATURE if signed else 0)
    return Frame(at, end, low | high << 16, system, component, signed, not flags & ~SIGNED)


def next_start(buffer: bytes, at: int) -> int:
    """Return the index of the next byte that can begin a frame, or the length of the buffer."""
    found = _START.search(buffer, at)
    return len(buffer) if found is None else found.start()


def must_wait(buffer: bytes, frame: Frame) -> bool:
    """True if more bytes of a stream are needed: the rest of the frame or, for an unknown id, the
    byte after it. That byte must start the next frame (see `is_good`)."""
    return frame.end > len(buffer) or (frame.end == len(buffer) and not frame.known)


def is_good(buffer: bytes, frame: Frame) -> bool:
    """True if the frame is valid: its CRC is correct.

    The CRC of an id outside the dialect cannot be checked. Such a frame is valid if it contains no
    valid frame, and another frame or the end of the buffer follows.
    """
    if frame.end > len(buffer):
        return False
    if frame.known:
        tail = frame.end - CRC - (SIGNATURE if frame.signed else 0)
        return (
            _crc(buffer[frame.start + 1 : tail] + _EXTRA[frame.ident])
            == buffer[tail] | buffer[tail + 1] << 8
        )
    if not frame.understood or (frame.end < len(buffer) and buffer[frame.end] not in MAGICS):
        return False
    # In a flood of unknown ids, this search takes most of the time. The pattern quickly skips bytes
    # that cannot start a known header.
    starts = _KNOWN_START.finditer(buffer, frame.start + 1, frame.end + _HEADER_2.size - 1)
    inside = (frame_at(buffer, found.start()) for found in starts if found.start() < frame.end)
    return not any(one is not None and is_good(buffer, one) for one in inside)


def split_frames(data: bytes) -> list[bytes]:
    """Return the frames in our own output, which contains only complete frames."""
    frames = []
    at = 0
    while at < len(data) and (frame := frame_at(data, at)) is not None:
        frames.append(data[at : frame.end])
        at = frame.end
    return frames
