"""Reads a tlog: big-endian microseconds since 1970 and a raw frame, repeated.

The format has no marks of its own. Where something was damaged, the log goes on at the next place where a moment that
may be is followed by a good frame, and that by another record or the end.
"""

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from circnav_mav.foreign import open_file
from circnav_mav.mav.codec import Decoder, Message
from circnav_mav.mav.framing import SIGNED, V1, V2, frame_at, is_good

STAMP = 8
"""Bytes of the time before each frame of a .tlog."""
LONGEST = STAMP + 280
"""A stamp and the longest frame, a signed one, bytes."""
CHUNK = 1 << 20
"""Bytes that are read at a time; chosen."""
LATEST = 14
"""Second byte of a stamp at most, the first one is 0: a moment before 2105."""
RECORD = re.compile(rb"\x00[\x00-\x0e].{6}[\xfd\xfe]", re.DOTALL)
"""How a record begins: such a stamp, and a magic byte."""


@dataclass(frozen=True, slots=True)
class Damage:
    """What of a tlog cannot be read. byte: the first that cannot. size: of the file. places, lost: how many stretches,
    and bytes in all of them. until, newest: newest moment before the first of them, and of all, microseconds since
    1970, 0 if there is none. cut: whether nothing good comes behind the first."""

    byte: int
    size: int
    places: int
    lost: int
    until: int
    newest: int
    cut: bool

    def __str__(self) -> str:
        if self.cut:
            return f"cut off or damaged at byte {self.byte} of {self.size}"
        where = "" if self.places == 1 else f" and in {self.places - 1} more places"
        return f"damaged at byte {self.byte} of {self.size}{where}, {self.lost} bytes left out"


def read_tlog(path: Path) -> Iterator[tuple[int, bytes]]:
    """The (microseconds since 1970, frame) pairs of a tlog; what is damaged is left out. Raises OSError."""
    return ((stamp, frame) for _, stamp, frame in _records(path))


def read_unbroken(path: Path) -> Iterator[tuple[int, bytes]]:
    """The same up to the first damage. Raises OSError."""
    end = 0
    for byte, stamp, frame in _records(path):
        if byte != end:
            return
        end += STAMP + len(frame)
        yield stamp, frame


def find_damage(path: Path) -> Damage | None:
    """What of a tlog cannot be read; None if all can. Raises OSError."""
    end, newest, gaps, lost = 0, 0, 0, 0
    first, until = None, 0
    for byte, stamp, frame in _records(path):
        if byte != end:
            gaps, lost = gaps + 1, lost + byte - end
            first, until = (end, newest) if first is None else (first, until)
        end, newest = byte + STAMP + len(frame), max(newest, stamp)
    size = path.stat().st_size
    if end < size:
        gaps, lost = gaps + 1, lost + size - end
    if first is None:
        return Damage(end, size, gaps, lost, newest, newest, cut=True) if gaps else None
    return Damage(first, size, gaps, lost, until, newest, cut=False)


def read_messages(path: Path, wanted: Collection[int]) -> Iterator[tuple[int, Message]]:
    """The (microseconds since 1970, message) pairs of these message ids. Raises OSError."""
    decoder = Decoder(wanted=wanted)
    for stamp, frame in read_tlog(path):
        if message_id(frame) in wanted:
            yield from ((stamp, message) for message in decoder.decode(frame))


def message_id(frame: bytes) -> int:
    """Message id of a whole frame, MAVLink 1 or 2."""
    return int.from_bytes(frame[7:10], "little") if frame[0] == V2 else frame[5]


def _records(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Where each whole record begins in the file, its stamp and frame. Raises OSError."""
    with open_file(path) as file:
        data, base, at = b"", 0, 0  # base: where the data begins in the file
        ended = searching = any_read = False
        while True:
            if len(data) - at < 2 * LONGEST and not ended:
                fresh = file.read(CHUNK)
                data, base, at, ended = data[at:] + fresh, base + at, 0, not fresh
            if ended and at >= len(data):
                return
            if searching:
                found = RECORD.search(data, at)
                start = found.start() if found else max(at, len(data) - STAMP)  # where too little is there to tell
                if start > at:
                    at = start
                    continue
            end = _end(data, at)
            if end is None or not _is_record(data, at, end, searching):
                at, searching = at + 1, True
                continue
            if searching and not any_read and end == len(data):
                return  # a single one is chance: the last of frames without stamps may look like it
            yield base + at, int.from_bytes(data[at : at + STAMP], "big"), data[at + STAMP : end]
            at, searching, any_read = end, False, True


def _end(data: bytes, at: int) -> int | None:
    """Where the record ends that seems to begin here; None if none does, or not all of it is there."""
    start = at + STAMP
    if len(data) < start + 3 or data[at] or data[at + 1] > LATEST:
        return None
    magic, flags = data[start], data[start + 2]
    if magic == V2 and not flags & ~SIGNED:  # by hand: a long log is read several times
        end = start + data[start + 1] + (25 if flags else 12)
    elif magic == V1:
        end = start + data[start + 1] + 8
    else:
        return None
    return end if end <= len(data) else None


def _is_record(data: bytes, at: int, end: int, searching: bool) -> bool:
    """Whether this is a record. That a record or the end of the file follows is enough where one must begin, and so is
    a frame whose check is right; in a search both are needed."""
    framed = end == len(data) or _end(data, end) is not None
    if framed is not searching:
        return framed
    frame = data[at + STAMP : end]
    found = frame_at(frame, 0)
    return found is not None and is_good(frame, found)
