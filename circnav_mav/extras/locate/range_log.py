"""Positions and ranges out of anybody's log: a tlog, or a CSV with time, latitude, longitude, altitude and range."""

import csv
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.locate.estimator import Ranges, Track
from circnav_mav.extras.locate.place import Plane
from circnav_mav.foreign import printable, read_lines
from circnav_mav.mav.codec import Message, ids
from circnav_mav.mav.ranging.interface import RangingSettings, Reading
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.runlog.run_folder import RunError
from circnav_mav.runlog.tlog import read_messages

NAMES = {
    "time": ("time", "time_s", "t", "timestamp"),
    "latitude": ("latitude", "latitude_deg", "lat", "location-lat"),
    "longitude": ("longitude", "longitude_deg", "lon", "lng", "location-long"),
    "altitude": ("altitude", "altitude_m", "alt", "height-above-msl"),
    "range": ("range", "range_m", "distance", "distance_m"),
    "sigma": ("sigma", "sigma_m", "range_sigma", "range_sigma_m", "accuracy"),
    "tag": ("tag", "tag_id", "id", "beacon_id", "beacon", "tag-local-identifier"),
}
"""The columns of a CSV, by the names that are understood; those with hyphens are Movebank's."""
NEEDED = ("time", "latitude", "longitude", "range")
FAR, LEAST_SIGMA = 1e9, 1e-3
"""No range or altitude is beyond it, m; a standard deviation, m, below which none is meant: others write zero where
they do not know."""
LATEST = 1e13
"""A time, s, in whatever unit it was meant."""
ONE_TAG = "target"
FIX_3D = 3
OURS = "CN_TEAST"
"""A NAMED_VALUE_FLOAT of our own survey, whose RANGING_BEACON repeats a range that the log holds already."""


class EmptyLogError(RunError):
    """A log without what a place is made from."""


@dataclass(slots=True)
class RangeLog:
    """positions: time (s), latitude, longitude (degrees), altitude (m, NaN where there is none). ranges: of each tag,
    time (s), range (m), standard deviation (m, NaN where it says none)."""

    positions: list[tuple[float, float, float, float]] = field(default_factory=list)
    ranges: dict[str, list[tuple[float, float, float]]] = field(default_factory=dict)

    def plane(self) -> Plane:
        """That touches the earth at the first position."""
        return Plane(*self.positions[0][1:3])

    def track(self, plane: Plane) -> Track:
        """The positions in the order of their times. An altitude that is missing is that between its neighbours, or
        zero where there is none at all."""
        time, latitude, longitude, up = np.array(sorted(self.positions)).T
        told = np.isfinite(up)
        up = np.interp(time, time[told], up[told]) if told.any() else np.zeros_like(up)
        return Track(time, *plane.to_metres(latitude, longitude), up)

    def of(self, tag: str, sigma: float | None) -> tuple[Ranges, bool]:
        """A tag's ranges, and whether they say how good they are. sigma: m, for all that do not; None: not known."""
        table = np.array(sorted(self.ranges[tag]))
        told = np.isfinite(table[:, 2])
        filled = np.where(told, table[:, 2], 1.0 if sigma is None else sigma)
        return Ranges(table[:, 0], table[:, 1], filled), bool(told.all() or sigma is not None)


def read_log(path: Path, name: str = RangingSettings().name) -> RangeLog:
    """Positions and ranges of a run folder, a tlog or a CSV. name: of a NAMED_VALUE_FLOAT that is a range. Raises
    RunError, OSError."""
    file = path / "flight.tlog" if path.is_dir() else path
    if not file.exists():
        raise RunError(f"{file}: no such file")
    log = _read_csv(file) if file.suffix.lower() in (".csv", ".txt") else _read_tlog(file, name)
    if not log.ranges:
        kinds = ", ".join(kind.type for kind in RANGING_MESSAGES.values())
        raise EmptyLogError(f"{file}: no ranges in it: {kinds} of a tlog, or the column range of a CSV")
    if len(log.positions) < 2:
        kinds = "GLOBAL_POSITION_INT with a 3D fix, or latitude and longitude of a CSV"
        raise EmptyLogError(f"{file}: no positions in it: {kinds}")
    return log


def _read_csv(file: Path) -> RangeLog:
    log = RangeLog()
    try:
        with closing(read_lines(file)) as lines:
            rows = csv.DictReader(lines)
            columns = _columns(file, rows.fieldnames or [])
            for row in rows:
                line, cells = f"{file}: line {rows.line_num}", dict.fromkeys(NAMES, nan)
                for name, column in columns.items():
                    cell = row.get(column) or ""
                    try:
                        if cell.strip() and name != "tag":
                            cells[name] = _seconds(cell) if name == "time" else float(cell)
                    except (ValueError, OverflowError):
                        what = "a number" if name != "time" else "a time: seconds, or as 2026-07-01T12:00:00Z"
                        raise RunError(f"{line}: {name}: {printable(cell)[:40]!r} is not {what}") from None
                    if isfinite(cells[name]) and abs(cells[name]) > (LATEST if name == "time" else FAR):
                        raise RunError(f"{line}: {name}: {cells[name]:g} is too large: s, degrees and m are meant")
                time, latitude, longitude = cells["time"], cells["latitude"], cells["longitude"]
                if not isfinite(time):
                    raise RunError(f"{line}: time: is missing")
                if isfinite(latitude) and isfinite(longitude):
                    if abs(latitude) > 90 or abs(longitude) > 180:
                        raise RunError(f"{line}: {latitude:g} {longitude:g} is no place: degrees?")
                    log.positions.append((time, latitude, longitude, cells["altitude"]))
                if 0 < cells["range"] < inf:
                    told = LEAST_SIGMA <= cells["sigma"] < inf
                    tag = printable(row.get(columns.get("tag", ""), "") or "") or ONE_TAG
                    log.ranges.setdefault(tag, []).append((time, cells["range"], cells["sigma"] if told else nan))
    except (ValueError, csv.Error) as error:
        raise RunError(f"{file}: is no CSV: {error}") from None
    return log


def _seconds(cell: str) -> float:
    """A number of seconds, or a date and time of ISO 8601, UTC where it says no zone. Raises ValueError."""
    try:
        return float(cell)
    except ValueError:
        moment = datetime.fromisoformat(cell.strip())
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _columns(file: Path, header: Sequence[str]) -> dict[str, str]:
    """Our names of the columns that are there. Raises RunError."""
    known = {column.strip().lower(): column for column in header}
    found = {name: known[wanted] for name, names in NAMES.items() for wanted in reversed(names) if wanted in known}
    missing = [name for name in NEEDED if name not in found]
    if missing:
        raise RunError(
            f"{file}: no column {', '.join(missing)}: the first line must name, with commas between, time (s or ISO "
            "8601), latitude, longitude (degrees) and range (m), and may name altitude (m), sigma (m), tag"
        )
    return found


def _read_tlog(file: Path, name: str) -> RangeLog:
    """Positions of the first vehicle while it has a fix; ranges of every source but our own survey, a tag each."""
    log, fixed, vehicle, began, ours = RangeLog(), None, None, None, set[tuple[int, int]]()
    kinds = {kind.id: kind for kind in RANGING_MESSAGES.values()}
    wanted = {dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_GPS_RAW_INT, *kinds}
    newest = dict[str, tuple[float | None, float]]()
    for stamp, message in read_messages(file, wanted):
        began = stamp if began is None else began
        time = (stamp - began) / 1e6
        sender, kind = ids(message), kinds.get(message.get_msgId())
        if kind is not None:
            if message.get_type() == "NAMED_VALUE_FLOAT" and message.name == OURS:
                ours.add(sender)
            reading, tag = kind.read(message), None if sender in ours else _tag(message, name)
            if isinstance(reading, Reading) and tag is not None and reading.slant <= FAR:
                one = reading.stamp, reading.slant
                if newest.get(tag) != one:  # autopilots repeat a range
                    newest[tag] = one
                    log.ranges.setdefault(tag, []).append((time, reading.slant, reading.sigma or nan))
        elif vehicle in (None, sender):
            if message.get_type() == "GPS_RAW_INT":
                fixed = message.fix_type >= FIX_3D
            elif fixed is not False and (message.lat, message.lon) != (0, 0):
                vehicle = sender
                log.positions.append((time, message.lat / 1e7, message.lon / 1e7, message.alt / 1000))
    return log


def _tag(message: Message, wanted: str) -> str | None:
    """Name of the source of a range, None where it is none: a value of another name."""
    sender = f"{message.get_srcSystem()}/{message.get_srcComponent()}"
    match message.get_type():
        case "DISTANCE_SENSOR":
            return f"sensor {message.id} of {sender}"
        case "RANGING_BEACON":
            return f"beacon {message.beacon_id} of {sender}"
    return f"{wanted} of {sender}" if message.name == wanted else None
