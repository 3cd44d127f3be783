"""Interface of the log readers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

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
