"""Reads a tlog: big-endian microseconds since 1970 and a raw frame, repeated.

The format has no marks of its own. Where something was damaged, the log goes on at the next place where a moment that
may be is followed by a good frame, and that by another record or the end.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from circnav_mav.mav.framing import SIGNED, V1, V2, frame_at, is_good

STAMP = 8
LONGEST = STAMP + 280
"""A stamp and the longest frame, a signed one, bytes."""
CHUNK = 1 << 20
LATEST = 14
"""Second byte of a stamp at most, the first one is 0: a moment before 2105."""
RECORD = re.compile(rb"\x00[\x00-\x0e].{6}[\xfd\xfe]", re.DOTALL)
"""How a record begins: such a stamp, and a magic byte."""
Record = tuple[int, int, bytes]
"""Where it begins in the file, stamp, frame."""


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


def message_id(frame: bytes) -> int:
    """Message id of a whole frame, MAVLink 1 or 2."""
    return int.from_bytes(frame[7:10], "little") if frame[0] == V2 else frame[5]


def _records(path: Path) -> Iterator[Record]:
    """The whole records of a file. Raises OSError."""
    with path.open("rb") as file:
        window = _Window(file)
        at, end, any_read = 0, None, False
        while True:
            if len(window.data) - at < 2 * LONGEST:
                at, end = window.move(at), None
            end = _end(window.data, at) if end is None else end
            following = None if end is None else _end(window.data, end)
            if end is None or not (following or end == len(window.data) or _is_good(window.data, at, end)):
                found = window.search(at + 1)
                if found is None or not (any_read or found[2]):
                    return  # a single one is chance: the last of frames without stamps may look like it
                at, end, following = found
            data = window.data
            yield window.base + at, int.from_bytes(data[at : at + STAMP], "big"), data[at + STAMP : end]
            at, end, any_read = end, following, True


class _Window:
    """The part of a file that is in memory: two of the longest records, or all that is left. base: where it begins."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.data, self.base = b"", 0

    def move(self, at: int) -> int:
        """Let what is before a place go, and read on; returns where the place is now."""
        self.data, self.base = self.data[at:] + self._file.read(CHUNK), self.base + at
        return 0

    def search(self, at: int) -> tuple[int, int, int | None] | None:
        """Where, from a place on, the next record begins and ends that is surely one, and where the one behind it does;
        None up to the end of the file."""
        while True:
            found = RECORD.search(self.data, at)
            at = found.start() if found else max(at, len(self.data) - LONGEST)
            if len(self.data) - at < 2 * LONGEST:
                left = len(self.data) - at
                at = self.move(at)
                if found is None and len(self.data) == left:
                    return None
            if found:
                end = _end(self.data, at)
                following = None if end is None else _end(self.data, end)
                if end is not None and (following or end == len(self.data)) and _is_good(self.data, at, end):
                    return at, end, following
                at += 1


def _end(data: bytes, at: int) -> int | None:
    """Where the record ends that seems to begin here; None if none does, or not all of it is there."""
    start = at + STAMP
    if len(data) < start + 3 or data[at] or data[at + 1] > LATEST:
        return None
    magic, flags = data[start], data[start + 2]
    if magic == V2 and not flags & ~SIGNED:
        end = start + data[start + 1] + (25 if flags else 12)
    elif magic == V1:
        end = start + data[start + 1] + 8
    else:
        return None
    return end if end <= len(data) else None


def _is_good(data: bytes, at: int, end: int) -> bool:
    frame = data[at + STAMP : end]
    found = frame_at(frame, 0)
    return found is not None and is_good(frame, found)
