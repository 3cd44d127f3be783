"""ArduPilot's dataflash logs, binary (.BIN) and text (.log), read by pymavlink's DFReader."""

import io
import mmap
from collections.abc import Collection, Iterable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pymavlink.DFReader import DFReader, DFReader_binary, DFReader_text

from circnav_mav.extras.locate.logs.interface import (
    FIX_3D,
    Format,
    ReadOptions,
    by_boot,
    first_track,
)
from circnav_mav.extras.locate.place import Plane
from circnav_mav.extras.locate.range_log import Position, RangeLog
from circnav_mav.mav.ranging.distance_sensor import DOWNWARD
from circnav_mav.runlog.run_folder import RunError

HEAD = b"\xa3\x95"
"""First bytes of every message. The message type and its fields follow."""
FMT = 128
"""Type of the message that defines the length and the fields of a type."""
LONGEST = 255
"""Length of the longest message, bytes."""
BINARY = HEAD + bytes([FMT])
TEXT = b"FMT, 128, "
GOOD = 4
"""Value of RangeFinder::Status with a valid distance."""
BEACONS = ("D0", "D1", "D2", "D3")
NO_READINGS = ("FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG")
"""Messages that contain no measurements: they describe the log or the autopilot."""
LIKE_RANGES = ("dist", "range", "rng", "slant")
"""Prefixes of field names that may hold a range. If no known message has a range, these fields are
suggested to the user."""
Message = Any


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    # DFReader prints warnings to stdout and stderr, and raises exceptions of any kind on damaged
    # files.
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            with path.open("rb") as file:
                text = file.read(len(TEXT)) == TEXT
            if text:
                return _logs(DFReader_text(str(path), zero_time_base=True), options)
            with TemporaryDirectory() as folder:
                whole, note = _without_damage(path, Path(folder))
                logs = _logs(DFReader_binary(str(whole), zero_time_base=True), options)
            if note:
                logs[0].note(note)
            return logs
    except (RunError, OSError):
        raise
    except Exception as error:
        raise RunError(f"cannot be read as a dataflash log: {error!r}") from None


def _without_damage(path: Path, folder: Path) -> tuple[Path, str]:
    """Return the path of a binary log without damage, and a note about the bytes left out.

    A damaged log is copied into the folder, without its damaged bytes. DFReader reads no message
    behind some kinds of damage, and its indexer in C prints a line for each damaged byte.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        parts = list(_whole_parts(data))
        size = len(data)
        ends = [0, *(byte for part in parts for byte in part), size]
        gaps = [end - begin for begin, end in list(pairwise(ends))[::2] if end > begin]
        if not gaps:
            return path, ""
        whole = folder / "whole.bin"
        with whole.open("wb") as copy:
            for begin, end in parts:
                copy.write(data[begin:end])
    # If the power was cut during logging, the log ends within a message. This rest is no damage: it
    # is at the end of the file, and not longer than a message.
    if ends[-2] == size - gaps[-1] and gaps[-1] <= LONGEST:
        gaps.pop()
    where = "1 place" if len(gaps) == 1 else f"{len(gaps)} places"
    return whole, f"damaged: {sum(gaps)} of {size} bytes, in {where}, are left out" if gaps else ""


def _whole_parts(data: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Yield begin and end of each stretch of whole messages. A message is whole if the next one
    begins at its end."""
    lengths = {FMT: 89}
    begin = at = 0
    while 0 <= at <= len(data) - 3:
        kind = data[at + 2]
        end = at + lengths.get(kind, 0) if data[at : at + 2] == HEAD else at
        whole = end > at and (end == len(data) or data[end : end + 2] == HEAD)
        if whole and kind == FMT:
            # A message has at least the three bytes of its header.
            whole = data[at + 4] >= 3
            lengths[data[at + 3]] = data[at + 4]
        if whole:
            at = end
            continue
        if at > begin:
            yield begin, at
        begin = at = data.find(HEAD, at + 1)
    if at > begin >= 0:
        yield begin, at


def _logs(reader: DFReader, options: ReadOptions) -> list[RangeLog]:
    """Return the log of each boot, and close the reader."""
    try:
        fields = {
            format.name: format.columns
            for format in reader.formats.values()
            if format.name not in NO_READINGS
        }
        with_names = {name for name, columns in fields.items() if "Name" in columns}
        named, _, _ = options.range_name.partition(".")
        wanted = {"POS", "ORGN", "XKF1", "GPS", "RFND", "BCN", *with_names, named}
        names = {
            f"{name}.{one}"
            for name, columns in fields.items()
            for one in columns
            if one.lower().startswith(LIKE_RANGES) and not name.startswith(("RFND", "NKF", "XKF"))
        }
        rows = ((time, (time, message)) for time, message in _messages(reader, wanted))
        return by_boot(rows, lambda part: [_collect(part, names, options)])
    finally:
        reader.close()


def _collect(
    messages: Iterable[tuple[float, Message]], names: Collection[str], options: ReadOptions
) -> RangeLog:
    """Return the positions and ranges of one boot.

    messages: time since boot (s) and message.
    names: names of fields that may hold a range.
    """
    log = RangeLog(names=set(names))
    fixed: bool | None = None
    # Prefer the position of the autopilot's filter, as telemetry does, to the position of the GPS
    # receiver.
    tracks: dict[str, list[tuple[Position, bool | None]]] = {"POS": [], "XKF1": [], "GPS": []}
    origin: tuple[Plane, float] | None = None
    for time, message in messages:
        match message.get_type():
            # The field U marks the primary receiver, which the filter uses. Without a fix of this
            # receiver, the filter's position is dead reckoning. Logs without the field I have one
            # receiver.
            case "GPS" if getattr(message, "U", getattr(message, "I", 0) == 0):
                fixed = message.Status >= FIX_3D
                tracks["GPS"].append(((time, message.Lat, message.Lng, message.Alt), fixed))
            case "POS":
                tracks["POS"].append(((time, message.Lat, message.Lng, message.Alt), fixed))
            # Type 0 is the origin of the estimator (ArduPilot's LogOriginType).
            case "ORGN" if message.Type == 0:
                origin = Plane(message.Lat, message.Lng), message.Alt
            case "XKF1" if origin is not None and not getattr(message, "C", 0):
                latitude, longitude = origin[0].to_degrees(message.PE, message.PN)
                tracks["XKF1"].append(((time, latitude, longitude, origin[1] - message.PD), fixed))
        for tag, slant in _ranges(message, options.range_name):
            options.add(log, tag, time, slant)
        if "Name" in message.get_fieldnames():
            log.names.add(message.Name)
    log.positions = first_track(tracks.values())
    return log


def _messages(reader: DFReader, wanted: set[str]) -> Iterator[tuple[float, Message]]:
    """Yield (time since boot in s, message) pairs."""
    while (
        message := reader.recv_match(
            type=wanted & {format.name for format in reader.formats.values()}
        )
    ) is not None:
        if hasattr(message, "TimeUS"):
            yield message.TimeUS / 1e6, message
        elif hasattr(message, "TimeMS"):
            yield message.TimeMS / 1e3, message


def _ranges(message: Message, wanted: str) -> Iterator[tuple[str, float]]:
    """Yield tags and values of the ranges in a message. wanted: MESSAGE.FIELD, or the name of a
    named value."""
    kind = message.get_type()
    fields = message.get_fieldnames()
    if kind == "RFND":
        yield from _rangefinders(message)
    elif kind == "BCN" and message.Health:
        for number, name in enumerate(BEACONS[: message.Cnt]):
            yield f"beacon {number}", getattr(message, name)
    elif "Name" in fields and message.Name == wanted:
        yield wanted, message.Value if "Value" in fields else message.Val
    named, _, field = wanted.partition(".")
    if kind == named and field in fields:
        of = f" of {message.Id}" if "Id" in fields else ""  # one message for several beacons
        yield wanted + of, getattr(message, field)


def _rangefinders(message: Message) -> Iterator[tuple[str, float]]:
    """Yield names and distances of a RFND message. Downward rangefinders are skipped: they measure
    the height."""
    if hasattr(message, "Dist"):
        if message.Orient != DOWNWARD and getattr(message, "Stat", GOOD) == GOOD:
            yield f"rangefinder {message.Instance}", message.Dist
        return
    for number in (1, 2):  # logs before 2019
        distance = getattr(message, f"Dist{number}", 0.0)
        if distance and getattr(message, f"Orient{number}", DOWNWARD) != DOWNWARD:
            yield f"rangefinder {number - 1}", distance


DATAFLASH = Format(
    name="an ArduPilot dataflash log",
    # Download tools may put bytes before the first message.
    matches=lambda head: head.startswith((BINARY, TEXT)) or BINARY + b"\x80\x59FMT" in head,
    read=_read,
    ranges="RFND of a rangefinder that does not look down, BCN",
    positions="POS, XKF1 or GPS with a 3D fix",
)
