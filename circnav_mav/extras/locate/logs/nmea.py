"""NMEA 0183 sentences of a receiver: positions only."""

from datetime import UTC, datetime, timedelta
from functools import reduce
from math import nan
from operator import xor
from pathlib import Path

from circnav_mav.extras.locate.logs.interface import Format, ReadOptions, sentences
from circnav_mav.extras.locate.range_log import Position, RangeLog

DAY = 86_400.0
"""Seconds of a day."""


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    """Read a file. GGA has the height, RMC the date. Days are counted at midnight and dated by the first RMC."""
    log, damaged = RangeLog(), 0
    rows: dict[float, Position] = {}
    midnight: float | None = None
    days, before = 0, 0.0
    for _, line in sentences(path.read_text(encoding="ascii", errors="replace")):
        cells = _cells(line[line.find("$") :]) if "$" in line else None
        if cells is None:
            damaged += 1
            continue
        kind = cells[0][-3:]
        if kind not in ("GGA", "RMC"):
            continue
        try:
            clock = int(cells[1][:2]) * 3600 + int(cells[1][2:4]) * 60 + float(cells[1][4:])
            days, before = days + (clock < before - DAY / 2), clock
            time = days * DAY + clock
            if kind == "RMC" and midnight is None and cells[9]:
                moment = datetime.strptime(cells[9], "%d%m%y").replace(tzinfo=UTC) - timedelta(days=days)
                midnight = moment.timestamp()
            at = 2 if kind == "GGA" else 3
            good = int(cells[6]) > 0 if kind == "GGA" else cells[2] == "A"
            if not good:
                continue
            latitude, longitude = _degrees(cells[at], cells[at + 1]), _degrees(cells[at + 2], cells[at + 3])
            height = float(cells[9]) if kind == "GGA" and cells[9] else nan
        except (ValueError, IndexError):
            damaged += 1
            continue
        if kind == "GGA" or time not in rows:
            rows[time] = (time, latitude, longitude, height)
    log.positions = [(time + (midnight or 0.0), *rest) for time, *rest in rows.values()]  # type: ignore[misc]
    log.epoch = 0.0 if midnight is not None else None
    if damaged:
        log.note(f"{damaged} damaged lines of the NMEA file are left out")
    if rows and midnight is None:
        log.note("the NMEA file has no date (RMC): its times are seconds of the day, UTC")
    return [log]


def _cells(sentence: str) -> list[str] | None:
    """Return the fields of a sentence, None if its checksum is wrong. A sentence without a checksum is accepted."""
    body, star, check = sentence[1:].partition("*")
    if star and check.strip()[:2].upper() != f"{reduce(xor, body.encode('ascii', 'replace'), 0):02X}":
        return None
    return body.split(",")


def _degrees(cell: str, side: str) -> float:
    """Return degrees from ddmm.mmm or dddmm.mmm and a hemisphere letter. Raises ValueError."""
    point = cell.index(".") if "." in cell else len(cell)
    whole = float(cell[: point - 2]) + float(cell[point - 2 :]) / 60
    return -whole if side in ("S", "W") else whole


NMEA = Format(
    name="an NMEA log",
    matches=lambda head: head.lstrip().startswith((b"$GP", b"$GN", b"$GL", b"$GA", b"$GB", b"$BD", b"!AIVDM")),
    read=_read,
    ranges="absent: it has only positions. With ranges in a file: circnav locate RANGES --positions NMEA",
    positions="GGA or RMC with a fix",
)
