"""CSV with a fixed header, separated by commas or semicolons: time, latitude, longitude, range, and
optionally altitude, sigma, tag. With semicolons, a number may have a decimal comma.

A name may end in the unit of its column: time_ms, range_ft. Other columns are ignored.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain
from math import inf, isfinite, isnan, nan
from pathlib import Path

from circnav_mav.extras.locate.logs.interface import FAR, METERS, Format, ReadOptions
from circnav_mav.extras.locate.range_log import RangeLog
from circnav_mav.foreign import printable, read_lines
from circnav_mav.runlog.run_folder import RunError

DEGREES = {"deg": 1.0}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "latitude": DEGREES,
    "longitude": DEGREES,
    "range": METERS,
    "altitude": METERS,
    "sigma": METERS,
    "tag": {},
}
"""Factors from the units of a column to s, degrees or m, by the name of the column."""
REQUIRED = ("time", "latitude", "longitude", "range")
HEADER = (
    "the first line must name, separated by commas or semicolons, time (s or ISO 8601), latitude,"
    " longitude (degrees) and range (m), and may name altitude, sigma, tag; a unit is a suffix:"
    " range_ft, time_ms"
)
ONE_TAG = "target"
LEAST_SIGMA = 1e-3
"""Smallest standard deviation that is used, m. Some tables contain zero for an unknown one."""


@dataclass(frozen=True, slots=True)
class Column:
    """Column in use.

    index: position of its cells in a row.
    factor: factor from its numbers to s, degrees or m.
    """

    index: int
    factor: float


@dataclass(frozen=True, slots=True)
class _Row:
    """Cells of a row. line: number of its line in the file."""

    cells: Sequence[str]
    line: int
    columns: Mapping[str, Column]
    decimal_comma: bool

    def text(self, name: str) -> str:
        """Return the text of a cell, empty if the row or the file has none."""
        column = self.columns.get(name)
        if column is None or column.index >= len(self.cells):
            return ""
        return self.cells[column.index].strip()

    def number(self, name: str) -> float:
        """Return the number in a cell in s, degrees or m, NaN if the cell is empty. Raises
        RunError."""
        cell = self.text(name)
        if not cell:
            return nan
        try:
            value = self._float(cell) * self.columns[name].factor
        except ValueError:
            raise self.error(name, f"{printable(cell)[:40]!r} is not a number") from None
        if 10 * FAR < abs(value) < inf:
            raise self.error(name, f"{value:g} is too large: degrees or m expected")
        return value

    def time(self) -> float:
        """Return the time, s. A time in ISO 8601 is counted from 1970, and is UTC without a zone.
        Raises RunError."""
        cell = self.text("time")
        if not cell:
            raise self.error("time", "is missing")
        try:
            value = self._float(cell) * self.columns["time"].factor
        except ValueError:
            return self._moment(cell)
        # 1e11: latest accepted time, s. It is past the year 5000, so a larger number is in
        # milliseconds or microseconds.
        if not abs(value) <= 1e11:
            raise self.error(
                "time", f"{value:g} is not a time in s: name its unit, time_ms or time_us"
            )
        return value

    def _float(self, cell: str) -> float:
        return float(cell.replace(",", ".") if self.decimal_comma else cell)

    def _moment(self, cell: str) -> float:
        try:
            moment = datetime.fromisoformat(cell)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            what = (
                f"{printable(cell)[:40]!r} is not a time: write seconds, or a time such as"
                " 2026-07-01T12:00:00Z"
            )
            raise self.error("time", what) from None

    def error(self, name: str, what: str) -> RunError:
        """Return the error of a cell."""
        return RunError(f"line {self.line}: {name}: {what}")


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    log = RangeLog()
    dropped = 0
    read = 0
    damaged: list[RunError] = []
    try:
        lines = read_lines(path, "replace")
        header = next(lines, "")
        semicolons = ";" in header
        rows = csv.reader(
            chain([header], lines), delimiter=";" if semicolons else ",", skipinitialspace=True
        )
        columns = _columns(next(rows, []), options)
        for cells in rows:
            if not any(cells):
                continue
            read += 1
            try:
                dropped += _add(log, _Row(cells, rows.line_num, columns, semicolons))
            except RunError as error:
                damaged.append(error)
    except (csv.Error, ValueError) as error:  # for example a quoted text without an end
        raise RunError(f"is not a CSV: {error}") from None
    # A wrong unit or column damages every row. A few damaged rows are defects of the file.
    # 0.02: largest share of rows with an unreadable cell. With more, the table is refused.
    if len(damaged) > 0.02 * read:
        raise damaged[0]
    if damaged:
        log.note(f"{len(damaged)} damaged rows are left out, the first: {damaged[0]}")
    if dropped:
        log.note(f"{dropped} ranges of 0 m or less are left out")
    return [log]


def _columns(header: Sequence[str], options: ReadOptions) -> dict[str, Column]:
    """Return the columns in use, by their names without units. Raises RunError."""
    columns: dict[str, Column] = {}
    for index, given in enumerate(header):
        name, _, unit = given.strip().lower().partition("_")
        if name not in UNITS or (unit and unit not in UNITS[name]):
            continue
        if name in columns:
            raise RunError(f"two columns {name}: keep one")
        factor = UNITS[name][unit] if unit else 1.0
        if name == "range" and options.unit is not None:
            factor = options.unit
        columns[name] = Column(index, factor)
    missing = [name for name in REQUIRED if name not in columns]
    if missing:
        raise RunError(f"no column {', '.join(missing)}: {HEADER}")
    return columns


def _add(log: RangeLog, row: _Row) -> bool:
    """Add the position and the range of a row. Return True if the range is not a valid distance.
    Raises RunError."""
    time = row.time()
    latitude = row.number("latitude")
    longitude = row.number("longitude")
    if isfinite(latitude) and isfinite(longitude):
        if abs(latitude) > 90 or abs(longitude) > 360:
            raise RunError(
                f"line {row.line}: {latitude:g} {longitude:g} is not a position: in degrees?"
            )
        altitude = row.number("altitude")
        if (
            not isnan(altitude) and not -1000 <= altitude <= 1e5
        ):  # some tables mark an unknown altitude by -9999
            raise row.error("altitude", f"{altitude:g} m is none: leave an unknown one empty")
        log.positions.append((time, latitude, (longitude + 180) % 360 - 180, altitude))
    slant = row.number("range")
    if not isfinite(slant):
        return False
    if slant <= 0:
        return True
    sigma = row.number("sigma")
    log.add(
        printable(row.text("tag")) or ONE_TAG,
        time,
        slant,
        sigma if LEAST_SIGMA <= sigma < inf else nan,
    )
    return False


TABLE = Format(
    name="a CSV",
    matches=lambda head: True,
    read=_read,
    ranges="the column range",
    positions="the columns latitude and longitude",
)
