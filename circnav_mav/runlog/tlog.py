"""Reading of a tlog: a timestamp (big-endian microseconds since 1970) and a raw frame, repeated.

The format has no markers. After damage, reading continues at the next plausible timestamp that is
followed by a valid frame and then by another record or the end.
"""

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from circnav_mav.foreign import open_file
from circnav_mav.mav.codec import Decoder, Message
from circnav_mav.mav.framing import SIGNED, V1, V2, frame_at, is_good

STAMP = 8
"""Length of the timestamp before each frame, bytes."""
LONGEST = STAMP + 280
"""Length of the longest record, bytes: a timestamp and a signed frame."""
CHUNK = 1 << 20
"""Bytes read at a time. Chosen."""
RECORD = re.compile(rb"\x00[\x00-\x0e].{6}[\xfd\xfe]", re.DOTALL)
"""Start of a record: a plausible timestamp and a magic byte."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Damage of a tlog.

    byte: position of the first unreadable byte in the file.
    size: size of the file, bytes.
    places: number of unreadable stretches.
    lost: number of bytes in all unreadable stretches.
    until: newest timestamp before the first unreadable stretch, us since 1970, 0 if none.
    newest: newest timestamp in the whole file, us since 1970, 0 if none.
    cut: True if nothing after the first unreadable stretch is readable.
    """

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
    """Return the (microseconds since 1970, frame) pairs of a tlog, without damaged parts. Raises
    OSError."""
    return ((stamp, frame) for _, stamp, frame in _records(path))


def read_unbroken(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the (microseconds since 1970, frame) pairs up to the first damage. Raises OSError."""
    end = 0
    for byte, stamp, frame in _records(path):
        if byte != end:
            return
        end += STAMP + len(frame)
        yield stamp, frame


def find_damage(path: Path) -> Damage | None:
    """Return the damage of a tlog, or None. Raises OSError."""
    end = 0
    newest = 0
    gaps = 0
    lost = 0
    first = None
    until = 0
    for byte, stamp, frame in _records(path):
        if byte != end:
            gaps = gaps + 1
            lost = lost + byte - end
            first, until = (end, newest) if first is None else (first, until)
        end = byte + STAMP + len(frame)
        newest = max(newest, stamp)
    size = path.stat().st_size
    if end < size:
        gaps = gaps + 1
        lost = lost + size - end
    if first is None:
        return Damage(end, size, gaps, lost, newest, newest, cut=True) if gaps else None
    return Damage(first, size, gaps, lost, until, newest, cut=False)


def read_messages(path: Path, wanted: Collection[int]) -> Iterator[tuple[int, Message]]:
    """Yield the (microseconds since 1970, message) pairs of these message ids. Raises OSError."""
    decoder = Decoder(wanted=wanted)
    for stamp, frame in read_tlog(path):
        if message_id(frame) in wanted:
            yield from ((stamp, message) for message in decoder.decode(frame))


def message_id(frame: bytes) -> int:
    """Return the message id of a whole frame, MAVLink 1 or 2."""
    return int.from_bytes(frame[7:10], "little") if frame[0] == V2 else frame[5]


def _records(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Yield (position in the file, timestamp, frame) of each whole record. Raises OSError."""
    with open_file(path) as file:
        # base: position of `data` in the file, bytes.
        data = b""
        base = 0
        at = 0
        ended = searching = any_read = False
        while True:
            if len(data) - at < 2 * LONGEST and not ended:
                fresh = file.read(CHUNK)
                data = data[at:] + fresh
                base = base + at
                at = 0
                ended = not fresh
            if ended and at >= len(data):
                return
            if searching:
                found = RECORD.search(data, at)
                # Keep the last bytes: they may be the begin of a timestamp.
                start = found.start() if found else max(at, len(data) - STAMP)
                if start > at:
                    at = start
                    continue
            end = _end(data, at)
            if end is None or not _is_record(data, at, end, searching):
                at = at + 1
                searching = True
                continue
            if searching and not any_read and end == len(data):
                # May be a coincidence: in a file of frames without timestamps, the last frame can
                # look like a record.
                return
            yield base + at, int.from_bytes(data[at : at + STAMP], "big"), data[at + STAMP : end]
            at = end
            searching = False
            any_read = True


def _end(data: bytes, at: int) -> int | None:
    """Return the end of the record that may begin at `at`, or None if none begins there or it is
    incomplete."""
    start = at + STAMP
    # 14: largest second byte of a timestamp after a first byte of 0, for a time before October
    # 2103.
    if len(data) < start + 3 or data[at] or data[at + 1] > 14:
        return None
    magic = data[start]
    flags = data[start + 2]
    # Do not call `frame_at` here: a long log is read several times, so speed matters.
    if magic == V2 and not flags & ~SIGNED:
        end = start + data[start + 1] + (25 if flags else 12)
    elif magic == V1:
        end = start + data[start + 1] + 8
    else:
        return None
    return end if end <= len(data) else None


def _is_record(data: bytes, at: int, end: int, searching: bool) -> bool:
    """True if this is a record. A record has two signs: a valid checksum, and another record or the
    end of the file after it. At the expected place, one sign is enough. In a search, both signs are
    required."""
    framed = end == len(data) or _end(data, end) is not None
    if framed is not searching:
        return framed
    frame = data[at + STAMP : end]
    found = frame_at(frame, 0)
    return found is not None and is_good(frame, found)
