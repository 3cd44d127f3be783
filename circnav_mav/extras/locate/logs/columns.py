"""Text tables from any source. Delimiter, decimal comma, column names, units and empty cells are detected."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from math import inf, isfinite, nan
from pathlib import Path

from circnav_mav.extras.locate.logs.interface import FAR, METERS, Format, ReadOptions
from circnav_mav.extras.locate.range_log import RangeLog
from circnav_mav.foreign import printable, read_bytes
from circnav_mav.runlog.run_folder import RunError

NAMES = {
    "time": "time t timestamp timestampsample timeutc utc utctime utcdatetime datetime datetimeutc unixtime unix epoch "
    "epochtime timeus timems timeboot seconds elapsed elapsedtime",
    "date": "date utcdate dateutc",
    "latitude": "latitude lat locationlat gpslat gpslatitude latwgs84",
    "longitude": "longitude lon lng long locationlong gpslon gpslng gpslong gpslongitude lonwgs84",
    "altitude": "altitude alt heightabovemsl altitudemsl altmsl altitudeamsl altamsl amsl gpsalt gpsaltitude elevation "
    "ele height",
    "range": "range distance dist slant slantrange rng uwbrange uwbdist uwbdistance rangingdistance measuredrange",
    "sigma": "sigma rangesigma accuracy rangeaccuracy rangestd std stddev",
    "tag": "tag tagid id beaconid beacon taglocalidentifier anchor anchorid nodeid deviceid",
}
"""Column names in lower case without spaces and punctuation, preferred ones first. Some are from Movebank."""
ANGLES = {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "dege7": 1e-7, "1e7deg": 1e-7, "e7": 1e-7}
SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds", "µs", "μs"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanoseconds"), 1e-9),
}
UNIT_OF = {"time": SECONDS, **dict.fromkeys(("latitude", "longitude"), ANGLES),
           **dict.fromkeys(("altitude", "range", "sigma"), METERS)}  # fmt: skip
GLUED = {"timeus": 1e-6, "timems": 1e-3}
"""Names that contain their unit."""
EMPTY = {"", "-", "--", "---", "na", "n/a", "#n/a", "nan", "null", "none", "nil", "?", "inf", "-inf", "+inf", "*"}
DELIMITERS = (",", ";", "\t", "|", " ")
HEADER_WITHIN = 40
"""Number of lines searched for the header: some files begin with comments."""
ONE_TAG = "target"
LEAST_SIGMA = 1e-3
"""Smallest standard deviation accepted, m: tables contain zero for an unknown one."""
LATEST = 1e13
"""Latest time accepted, s."""
EPOCHS = ((1e17, 1e-9, "nanoseconds"), (1e14, 1e-6, "microseconds"), (1e11, 1e-3, "milliseconds"))
"""Units of times without a named unit: smallest value, factor, name. As seconds, such values are past the year 5000."""
TOO_SLOW, ENOUGH = 8.0, 10
"""Median time between rows, s, from which the unit is not seconds, and smallest number of rows to measure it."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")
IN_BRACKETS = re.compile(r"(.*?)[\s_]*[\[({]\s*([^\])}]*?)\s*[\])}]\s*")
BEHIND = re.compile(r"(.*?)[\s_,:/.-]+([a-zµμ0-9]+)")
MAX_FILE = 1_000_000_000
"""Largest file size, bytes: a table is read as a whole."""


@dataclass(frozen=True, slots=True)
class Column:
    """Column in use. factor: from its numbers to s, degrees or m, None if the header names no unit."""

    index: int
    header: str
    factor: float | None = None


@dataclass(slots=True)
class Table:
    """Header and rows of a text table. rows: line number and cells of each."""

    header: list[str]
    rows: list[tuple[int, list[str]]]
    columns: dict[str, Column]
    ranges: list[Column]
    decimal_comma: bool = False
    notes: list[str] = field(default_factory=list)


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    table = _table(_text(path), options)
    log = RangeLog(notes=table.notes)
    times = _times(table, log)
    degrees = [_angle_factor(table, name, log) for name in ("latitude", "longitude")]
    meters = {name: table.columns[name].factor or 1.0 for name in ("altitude", "sigma") if name in table.columns}
    several, dropped = len(table.ranges) > 1, 0
    for (line, row), time in zip(table.rows, times, strict=True):
        cells = _Cells(row, line, table)
        latitude, longitude = (
            cells.number(name) * factor for name, factor in zip(("latitude", "longitude"), degrees, strict=True)
        )
        altitude = cells.number("altitude") * meters.get("altitude", 1.0)
        if isfinite(latitude) and isfinite(longitude):
            if abs(latitude) > 90 or abs(longitude) > 360:
                raise RunError(f"line {line}: {latitude:g} {longitude:g} is not a position: in degrees?")
            log.positions.append((time, latitude, (longitude + 180) % 360 - 180, altitude))
        sigma = cells.number("sigma") * meters.get("sigma", 1.0)
        tag = printable(cells.text("tag"))
        for column in table.ranges:
            factor = options.unit or column.factor or 1.0
            slant = cells.number("range", column) * factor
            if 0 < slant < inf:
                name = column.header if several and not tag else f"{tag} {column.header}" if several else tag
                log.add(name or ONE_TAG, time, slant, sigma if LEAST_SIGMA <= sigma < inf else nan)
            else:
                dropped += isfinite(slant)
    if dropped:
        log.note(f"{dropped} ranges of 0 m or less are left out")
    return [log]


def _text(path: Path) -> str:
    """Return the text of a file: UTF-8, UTF-16 (spreadsheets) or cp1252 (older programs). Raises RunError."""
    data = read_bytes(path, MAX_FILE)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", "replace")
    if "\0" in text:
        raise RunError("is not a table: it contains zero bytes, as binary files do")
    return text


def _table(text: str, options: ReadOptions) -> Table:
    """Find the delimiter and the header, and split the rows. Raises RunError."""
    lines = text.splitlines()
    best: Table | None = None
    for number, line in enumerate(lines[:HEADER_WITHIN]):
        for delimiter in DELIMITERS:
            header = next(csv.reader([line.lstrip("#%! ")], delimiter=delimiter, skipinitialspace=True), [])
            columns, ranges = _columns(header, options)
            table = Table(header, [], columns, ranges)
            if not _missing(table, options):
                rows = csv.reader(lines[number + 1 :], delimiter=delimiter, skipinitialspace=True)
                try:
                    table.rows = [
                        (number + 1 + rows.line_num, row) for row in rows if any(row) and not row[0].startswith("#")
                    ]
                except csv.Error as error:
                    raise RunError(f"is not a CSV: {error}") from None
                _find_decimal_comma(table, delimiter)
                return table
            if best is None or len(columns) + len(ranges) > len(best.columns) + len(best.ranges):
                best = table
    missing = _missing(best, options) if best else ["time"]
    some = best is not None and len(best.columns) + len(best.ranges) > 1
    found = ", ".join(printable(name) for name in best.header)[:200] if best and some else "none"
    raise RunError(
        f"no column {', '.join(missing)}. Its columns: {found}. The first line must name time (s or ISO 8601), "
        "latitude, longitude (degrees) and range (m, or with its unit: range_ft), and may name altitude, sigma, tag; "
        "--range-column selects a range by name"
    )


def _columns(header: Sequence[str], options: ReadOptions) -> tuple[dict[str, Column], list[Column]]:
    """Return the columns by their keys in NAMES, and the range columns."""
    found: dict[str, list[tuple[int, Column]]] = {}
    for index, given in enumerate(header):
        for name, aliases in NAMES.items():
            compact, factor = _name_and_unit(given, UNIT_OF.get(name, {}))
            if name == "time" and factor is None and compact in SECONDS:
                compact, factor = "seconds", SECONDS[compact]
            order = aliases.split()
            if compact in order:
                found.setdefault(name, []).append((order.index(compact), Column(index, given.strip(), factor)))
    columns = {name: min(several, key=lambda one: one[0])[1] for name, several in found.items()}
    ranges = [columns.pop("range")] if "range" in columns else []
    if options.range_columns:
        by_header = {given.strip().lower(): index for index, given in enumerate(header)}
        picked = [name for name in options.range_columns if name.strip().lower() in by_header]
        ranges = [
            Column(by_header[name.strip().lower()], name.strip(), _name_and_unit(name, METERS)[1]) for name in picked
        ]
        if len(picked) < len(options.range_columns):
            ranges = []
    return columns, ranges


def _name_and_unit(header: str, units: dict[str, float]) -> tuple[str, float | None]:
    """Split a header such as "Range (ft)" or "alt_m" into a compact name and the factor of its unit."""
    text = header.strip().lower()
    for pattern in (IN_BRACKETS, BEHIND):
        match = pattern.fullmatch(text)
        unit = _compact(match[2]) if match else ""
        if match and unit in units:
            return _compact(match[1]), units[unit]
    compact = _compact(text)
    return compact, GLUED.get(compact)


def _compact(text: str) -> str:
    return re.sub(r"[^a-z0-9µμ]", "", text.lower())


def _missing(table: Table, options: ReadOptions) -> list[str]:
    """Return the names of the required columns that are missing."""
    missing = [name for name in ("time", "latitude", "longitude") if name not in table.columns]
    if not table.ranges:
        missing.append(" or ".join(map(repr, options.range_columns)) or "range")
    return missing


def _find_decimal_comma(table: Table, delimiter: str) -> None:
    """Detect decimal commas. Raises RunError if numbers with a comma and with a point are mixed."""
    used = [column.index for name, column in table.columns.items() if name not in ("tag", "date")]
    used += [column.index for column in table.ranges]
    cells = [row[index].strip() for _, row in table.rows for index in used if index < len(row)]
    commas = [cell for cell in cells if COMMA.fullmatch(cell)]
    if not commas:
        return
    points = [cell for cell in cells if "." in cell and NUMBER.fullmatch(cell)]
    if points:
        raise RunError(f"numbers with a comma ({commas[0]!r}) and with a point ({points[0]!r}): write all with a point")
    table.decimal_comma = True
    table.notes.append(f"numbers are read with a decimal comma, columns are separated by {delimiter!r}")


@dataclass(slots=True)
class _Cells:
    """Cells of a row."""

    row: list[str]
    line: int
    table: Table

    def text(self, name: str, column: Column | None = None) -> str:
        """Return the text of a cell, empty if it is missing or marked as empty."""
        column = column or self.table.columns.get(name)
        cell = self.row[column.index].strip() if column and column.index < len(self.row) else ""
        return "" if cell.lower() in EMPTY else cell

    def number(self, name: str, column: Column | None = None) -> float:
        """Return the number in a cell, NaN if it is empty. Raises RunError."""
        if not (cell := self.text(name, column)):
            return nan
        given = cell
        if self.table.decimal_comma:
            cell = cell.replace(",", ".")
        sign = 1.0
        if name in ("latitude", "longitude") and cell[-1:].upper() in tuple("NSEW"):
            sign, cell = -1.0 if cell[-1].upper() in "SW" else 1.0, cell[:-1].rstrip("° ")
        if not NUMBER.fullmatch(cell):
            raise RunError(f"line {self.line}: {name}: {printable(given)[:40]!r} is not a number")
        value = float(cell) * sign
        if abs(value) > FAR * 10:
            raise RunError(f"line {self.line}: {name}: {value:g} is too large: s, degrees or m expected")
        return value


def _angle_factor(table: Table, name: str, log: RangeLog) -> float:
    """Return the factor from a column of latitudes or longitudes to degrees."""
    column = table.columns.get(name)
    if column is None or column.factor is not None:
        return column.factor or 1.0 if column else 1.0
    values = [value for line, row in table.rows if isfinite(value := _Cells(row, line, table).number(name))]
    # MAVLink and many receivers use degrees times 1e7. Such integers are out of range as degrees.
    if values and all(value.is_integer() and (abs(value) > 1000 or value == 0) for value in values) and any(values):
        log.note(f"column {column.header!r} is read as degrees times ten million")
        return 1e-7
    return 1.0


def _times(table: Table, log: RangeLog) -> list[float]:
    """Return the time of every row, s. Raises RunError."""
    column, date = table.columns["time"], table.columns.get("date")
    raw: list[float | str] = []
    for line, row in table.rows:
        cells = _Cells(row, line, table)
        cell = cells.text("time")
        if not cell:
            raise RunError(f"line {line}: time: is missing")
        number = cell.replace(",", ".") if table.decimal_comma else cell
        day = cells.text("date") if date else ""
        raw.append(float(number) if NUMBER.fullmatch(number) and not day else f"{day} {cell}".strip())
    numbers = [abs(value) for value in raw if isinstance(value, float)]
    factor = 1.0 if column.factor is None else column.factor
    if numbers and column.factor is None:
        for least, scale, name in EPOCHS:
            if least <= max(numbers) < least * 1e4:
                factor = scale
                log.note(f"column {column.header!r} is read as {name} since 1970")
                break
        else:
            factor = _small_unit(numbers, column, log)
    times = []
    for (line, _), value in zip(table.rows, raw, strict=True):
        time = value * factor if isinstance(value, float) else _moment(value, line)
        if abs(time) > LATEST:
            raise RunError(f"line {line}: time: {time:g} is too large: s, degrees or m expected")
        times.append(time)
    return times


def _small_unit(numbers: Sequence[float], column: Column, log: RangeLog) -> float:
    """Return the seconds per unit of a time column: below 1 if its integers, as seconds, would be too far apart."""
    # Autopilots log milliseconds or microseconds since boot, and log converters omit the unit.
    steps = sorted(after - before for before, after in pairwise(sorted(set(numbers))))
    if len(steps) < ENOUGH or not all(number.is_integer() for number in numbers):
        return 1.0
    step = steps[len(steps) // 2]
    if step < TOO_SLOW:
        return 1.0
    factor, name = (1e-3, "milliseconds") if step < 1e3 * TOO_SLOW else (1e-6, "microseconds")
    log.note(f"column {column.header!r} is read as {name}: as seconds, its rows would be {step:g} s apart")
    return factor


def _moment(cell: str, line: int) -> float:
    """Return the seconds since 1970 of an ISO 8601 date and time, in UTC if it has no zone. Raises RunError."""
    try:
        # "2026-07-01 12:00:00 UTC", "2026/07/01 12:00"
        text = re.sub(r"\s*(UTC|GMT)$", "Z", cell)
        text = re.sub(r"^(\d{4})[/.](\d{2})[/.](\d{2})", r"\1-\2-\3", text)
        moment = datetime.fromisoformat(re.sub(r"(\.\d{6})\d+", r"\1", text))
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        where = f"{printable(cell)[:40]!r} is not a time: write seconds, or a time such as 2026-07-01T12:00:00Z"
        raise RunError(f"line {line}: time: {where}") from None


TABLE = Format(
    name="a table (CSV)",
    matches=lambda head: True,
    read=_read,
    ranges="the column range, or the one of --range-column",
    positions="the columns latitude and longitude",
)
