"""Interface of the log readers."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, groupby, pairwise
from math import inf, nan
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from circnav_mav.extras.locate.range_log import Position, RangeLog
from circnav_mav.foreign import printable
from circnav_mav.mav.ranging.interface import RangingSettings

METERS = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "dm": 0.1,
    "km": 1000.0,
    "ft": 0.3048,
    "yd": 0.9144,
    "mi": 1609.344,
    "nmi": 1852.0,
}
"""Meters per unit of length, by the suffixes of columns and the names that --units takes."""
FAR = 1e9
"""Largest range or altitude accepted, m."""
MOST_NAMES = 20
"""Largest number of names listed in a message."""
FIX_3D = 3
"""Smallest fix type with a three-dimensional position, in MAVLink, ArduPilot and PX4 alike."""
MOST_BOOTS = 20
"""Largest number of boots in one log. If the times step back more often, the rows are not in the
order of time."""
Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options of the user for reading a log.

    range_name: name of the range in the log: NAMED_VALUE, debug key or MESSAGE.FIELD.
    unit: unit of the ranges, m per unit, None for the unit named in the log.
    vehicle: system id of the only vehicle to read, None for all vehicles.
    """

    range_name: str = RangingSettings().name
    unit: float | None = None
    vehicle: int | None = None

    @property
    def meters(self) -> float:
        """Unit of the ranges, m per unit. It is 1 if no unit is given, for log formats that define
        meters."""
        return 1.0 if self.unit is None else self.unit

    def add(self, log: RangeLog, tag: str, time: float, slant: float, sigma: float = nan) -> None:
        """Add a range in the given unit to a log, unless it is impossible."""
        if 0 < slant <= FAR:
            log.add(tag, time, slant * self.meters, sigma * self.meters)


class Format(NamedTuple):
    """Readable log format.

    matches(head): True if the first bytes of a file are of this format.
    read: reader of a file of this format.
    ranges, positions: names of the messages or fields with ranges and with positions.
    """

    name: str
    matches: Callable[[bytes], bool]
    read: Callable[[Path, ReadOptions], list[RangeLog]]
    ranges: str
    positions: str


def listed(names: Iterable[str]) -> str:
    """Return names as text for a message, at most MOST_NAMES of them."""
    several = sorted(map(printable, names))
    more = f" and {len(several) - MOST_NAMES} more" if len(several) > MOST_NAMES else ""
    return ", ".join(several[:MOST_NAMES]) + more


def meters_in(unit: str) -> float | None:
    """Return the length of a unit, m. None if `unit` is neither the name of a unit nor a length in
    m."""
    if unit in METERS:
        return METERS[unit]
    try:
        meters = float(unit)
    except ValueError:
        return None
    return meters if 0 < meters < FAR else None


def with_fix(rows: Sequence[tuple[Position, bool | None]]) -> list[Position]:
    """Return the positions with a fix.

    rows: pairs of position and fix. The fix is None before the receiver's first report.
    """
    # Autopilots send positions before the GPS has a fix: near 0,0, or the place where they were
    # switched off. If the log has the receiver's state, keep only positions with a fix. Otherwise
    # keep all.
    if all(fixed is None for _, fixed in rows):
        return [position for position, _ in rows]
    return [position for position, fixed in rows if fixed]


def first_track(sources: Iterable[Sequence[tuple[Position, bool | None]]]) -> list[Position]:
    """Return the positions with a fix of the first source that has several, else none.

    sources: positions of each source, in the order of preference, as in `with_fix`.
    """
    return next((track for rows in sources if len(track := with_fix(rows)) > 1), [])


def by_boot(
    rows: Iterable[tuple[float | None, Row]], collect: Callable[[Iterable[Row]], list[RangeLog]]
) -> list[RangeLog]:
    """Return the vehicles of each boot in a log.

    rows: time (s) and content of each row, in the order of the file. The time is None for a row
        that belongs to the boot of the row before it.
    collect: function that returns the vehicles of the rows of one boot.
    """
    boots = groupby(_numbered(rows), key=itemgetter(0))
    parts = [collect(row for _, row in group) for _, group in boots] or [collect(())]
    if len(parts) > MOST_BOOTS:
        return _merged(parts)
    # A short boot, for example on the bench, may have no fix or no radio.
    usable = [part for part in parts if any(log.ranges and log.positions for log in part)]
    if len(usable) < 2:
        return usable[0] if usable else _merged(parts)
    for number, part in enumerate(usable, 1):
        for log in part:
            log.vehicle = f"{log.vehicle}, boot {number}".removeprefix(", ")
            log.note(f"the times step back: each of {len(usable)} boots is located by itself")
    return [log for part in usable for log in part]


def _numbered(rows: Iterable[tuple[float | None, Row]]) -> Iterator[tuple[int, Row]]:
    """Yield the rows with the number of their boot."""
    last = before = -inf
    boot = 0
    end: tuple[float | None, Any] = None, None
    for (time, row), (following, _) in pairwise(chain(rows, [end])):
        if time is not None:
            # 10.0: largest step back of reordered rows, s. A restarted logger, or a second log
            # appended to the first, steps back by minutes. A single damaged time is no restart: the
            # row after it continues the rows before it.
            begin = min(last, before) - 10.0
            boot += time < begin and (following is None or following < begin)
            before = last
            last = time
        yield boot, row


def _merged(parts: Sequence[Sequence[RangeLog]]) -> list[RangeLog]:
    """Return the vehicles of all parts of a log, one for each name."""
    merged: dict[str, RangeLog] = {}
    for log in (log for part in parts for log in part):
        whole = merged.setdefault(log.vehicle, RangeLog(vehicle=log.vehicle))
        whole.positions += log.positions
        whole.names |= log.names
        for tag, ranges in log.ranges.items():
            whole.ranges.setdefault(tag, []).extend(ranges)
        for note in log.notes:
            whole.note(note)
    return list(merged.values())
