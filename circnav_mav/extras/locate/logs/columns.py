"""CSV with a fixed header: time, latitude, longitude, range, and optionally altitude, sigma, tag.

The header shows the separator: comma, semicolon or tab. A number may have a decimal comma, with
commas as separators only in quotes. A name may end in the unit of its column: time_ms, range_ft.
Other columns are ignored.
"""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain
from math import inf, isfinite, isnan, nan
from pathlib import Path

import numpy as np

from circnav_mav.extras.locate.estimator import LEAST
from circnav_mav.extras.locate.logs.interface import FAR, METERS, Format, ReadOptions, by_boot
from circnav_mav.extras.locate.place import wrapped
from circnav_mav.extras.locate.range_log import RangeLog
from circnav_mav.foreign import printable, read_lines
from circnav_mav.runlog.run_folder import RunError

DEGREES = {"deg": 1.0, "e7": 1e-7}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
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
    "the first line must name, separated by commas, semicolons or tabs, time (s or ISO 8601),"
    " latitude, longitude (degrees) and range (m), and may name altitude, sigma, tag; a unit is a"
    " suffix: range_ft, time_ms"
)
ONE_TAG = "target"
MISSING = frozenset({"", "na", "n/a", "#n/a", "nan", "null", "none", "nil", "-", "--"})
"""Texts of a cell without a value, in lower case: pandas and R write NaN and NA, databases NULL."""
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
    """Cells of a row. line: number of its line in the file. separator: text between its cells."""

    cells: Sequence[str]
    line: int
    columns: Mapping[str, Column]
    separator: str

    def text(self, name: str) -> str:
        """Return the text of a cell, empty if the row or the file has no value."""
        column = self.columns.get(name)
        if column is None or column.index >= len(self.cells):
            return ""
        cell = self.cells[column.index].strip()
        return "" if cell.lower() in MISSING else cell

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

    def degrees(self, name: str, most: float) -> float:
        """Return an angle up to `most` degrees, NaN if the cell is empty. Raises RunError."""
        value = self.number(name)
        if abs(value) <= most or not isfinite(value):
            return value
        # Autopilots store degrees times ten million. NMEA receivers write degrees and minutes
        # without a separator: 4712.043.
        if abs(value) >= 1e6:
            likely = f"degrees times 1e7? Name the column {name}_e7"
        else:
            likely = "degrees and minutes, or latitude and longitude swapped?"
        raise self.error(name, f"{self.text(name)[:40]} is not in degrees: {likely}")

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
        # A comma in a quoted cell of a table with commas groups thousands or marks decimals. A
        # latitude has no thousands, so it shows the decimal comma.
        decimal_comma = self.separator != "," or "," in self.text("latitude")
        return float(cell.replace(",", ".") if decimal_comma else cell)

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
    damaged: list[RunError] = []
    try:
        lines = read_lines(path, "replace")
        first = next(lines, "")
        # Spreadsheets name the separator in a line before the header: sep=;
        named = first.lower().startswith("sep=")
        # numpy writes a header behind a comment sign.
        header = (next(lines, "") if named else first).removeprefix("#")
        separator = first[4:5] if named else max(",;\t", key=header.count)
        table = csv.reader(chain([header], lines), delimiter=separator, skipinitialspace=True)
        names = next(table, [])
        columns = _columns(names, options)
        rows = (
            _Row(cells, table.line_num + named, columns, separator) for cells in table if any(cells)
        )
        logs = by_boot(_stamped(rows, len(names), damaged), lambda part: [_log(part, damaged)])
        read = table.line_num
    except (csv.Error, TypeError, ValueError) as error:  # e.g. a quoted text without an end
        raise RunError(f"is not a CSV: {error}") from None
    # A wrong unit or column damages every row. A few damaged rows are defects of the file.
    # 0.02: largest share of rows with an unreadable cell. With more, the table is refused.
    if len(damaged) > 0.02 * read:
        raise damaged[0]
    if damaged:
        logs[0].note(f"{len(damaged)} damaged rows are left out, the first: {damaged[0]}")
    for log in logs:
        _check_time_unit(log, columns["time"], names[columns["time"].index].strip())
    return logs


def _stamped(
    rows: Iterable[_Row], width: int, damaged: list[RunError]
) -> Iterator[tuple[float | None, _Row]]:
    """Yield time and content of each row, the time only for a row with a position: a table may have
    the positions before the ranges, and the ranges by tag. Errors of rows are added to `damaged`.

    width: number of names in the header.
    """
    for row in rows:
        try:
            if any(row.cells[width:]):
                # A decimal comma splits a number of a table with commas into two cells.
                likely = ": decimal commas?" if row.separator == "," else ""
                raise RunError(
                    f"line {row.line} has {len(row.cells)} values for {width} names{likely}"
                )
            time = row.time()
            yield time if row.text("latitude") else None, row
        except RunError as error:
            damaged.append(error)


def _log(rows: Iterable[_Row], damaged: list[RunError]) -> RangeLog:
    """Return the positions and ranges of one boot. Errors of rows are added to `damaged`."""
    log = RangeLog()
    dropped = 0
    for row in rows:
        try:
            dropped += _add(log, row)
        except RunError as error:
            damaged.append(error)
    if dropped:
        log.note(f"{dropped} ranges of 0 m or less are left out")
    return log


def _check_time_unit(log: RangeLog, column: Column, name: str) -> None:
    """Raise RunError if the positions fit another unit of time much better."""
    if len(log.positions) < LEAST:
        return
    track = log.track(log.plane())
    steps = np.diff(track.time)
    moved = np.hypot(np.diff(track.east), np.diff(track.north))[steps > 0]
    steps = steps[steps > 0]
    if not len(steps):
        return
    speed = float(np.median(moved / steps))
    period = float(np.median(steps))

    def fits(factor: float) -> bool:
        # 350.0: largest speed of a vehicle with a ranging radio, m/s. 20.0: longest usual time
        # between two positions, s. No range between positions farther apart can be used.
        ratio = factor / column.factor
        return speed < 350.0 * ratio and period * ratio <= 20.0

    likely = next((unit for unit, factor in UNITS["time"].items() if fits(factor)), None)
    if not fits(column.factor) and likely is not None:
        raise RunError(
            f"{name}: positions {period:.3g} s apart at {speed:.3g} m/s: are the times in"
            f" {likely}? Name the column time_{likely}"
        )


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
    latitude = row.degrees("latitude", 90.0)
    longitude = row.degrees("longitude", 360.0)
    if isfinite(latitude) and isfinite(longitude):
        altitude = row.number("altitude")
        if (
            not isnan(altitude) and not -1000 <= altitude <= 1e5
        ):  # some tables mark an unknown altitude by -9999
            raise row.error("altitude", f"{altitude:g} m is none: leave an unknown one empty")
        log.positions.append((time, latitude, wrapped(longitude), altitude))
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
