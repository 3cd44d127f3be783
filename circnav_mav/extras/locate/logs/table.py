"""Reads a log of any known format. For other formats, the error names the format and a way to convert it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from circnav_mav.extras.locate.logs.columns import TABLE
from circnav_mav.extras.locate.logs.dataflash import DATAFLASH
from circnav_mav.extras.locate.logs.gpx import GPX
from circnav_mav.extras.locate.logs.interface import Format, ReadOptions, listed
from circnav_mav.extras.locate.logs.nmea import NMEA
from circnav_mav.extras.locate.logs.rtklib import RTKLIB
from circnav_mav.extras.locate.logs.screening import screen
from circnav_mav.extras.locate.logs.tlog import TLOG
from circnav_mav.extras.locate.logs.ulog import ULOG
from circnav_mav.extras.locate.range_log import EmptyLogError, Position, Range, RangeLog
from circnav_mav.foreign import open_file, printable
from circnav_mav.runlog.run_folder import RunError

FORMATS = (ULOG, DATAFLASH, GPX, RTKLIB, NMEA, TLOG)
"""Formats with an identifying header. Other text is read as a table, other binary files as a damaged tlog."""
AS_CSV = "save it as CSV with the columns time, latitude, longitude, range"
TO_GPX = "convert it: gpsbabel -t -i {} -f FILE -o gpx,gpxver=1.1 -F track.gpx"
MARKS: Mapping[bytes, tuple[str, str]] = {
    b"PK\x03\x04": ("a zip archive", "unpack it and give the log in it"),
    b"\x1f\x8b": ("a gzip archive", "unpack it: gunzip FILE"),
    b"7z\xbc\xaf": ("a 7-Zip archive", "unpack it and give the log in it"),
    b"#ROSBAG": ("a ROS 1 bag", f"export its topics, with rostopic echo -b FILE -p TOPIC, and {AS_CSV}"),
    b"SQLite format 3": ("an SQLite file, as ROS 2 bags (.db3) are", f"export its topics, and {AS_CSV}"),
    b"\x89MCAP": ("an MCAP file", f"export its topics, for example with PlotJuggler, and {AS_CSV}"),
    b"\xd0\xcf\x11\xe0": ("a spreadsheet (.xls)", AS_CSV),
    b"\x89HDF": ("an HDF5 file", AS_CSV),
    b"MATLAB": ("a MATLAB file", f"export it with writetable, and {AS_CSV}"),
    b"PAR1": ("a Parquet file", AS_CSV),
    b"\xb5\x62": ("raw data of a u-blox receiver", "make a .pos of it with RTKLIB (convbin, rnx2rtkp)"),
    b"\xd3\x00": ("RTCM corrections", "make a .pos of them with RTKLIB (convbin, rnx2rtkp)"),
    b"\xfe": ("a raw MAVLink stream", "it has no times: record a tlog"),
    b"\xfd": ("a raw MAVLink stream", "it has no times: record a tlog"),
    b"{": ("JSON", AS_CSV),
    b"[": ("JSON", AS_CSV),
}  # fmt: skip
"""Formats that cannot be read, by their first bytes."""
SUFFIXES: Mapping[str, tuple[str, str]] = {
    ".kml": ("KML", TO_GPX.format("kml")),
    ".kmz": ("zipped KML", f"unpack it, then {TO_GPX.format('kml')}"),
    ".fit": ("a Garmin FIT file", TO_GPX.format("garmin_fit")),
    ".tcx": ("a Garmin TCX file", TO_GPX.format("gtrnctr")),
    ".xlsx": ("a spreadsheet", AS_CSV),
    ".ods": ("a spreadsheet", AS_CSV),
    ".px4log": ("a log of PX4 before 2017 (sdlog2)", f"convert it with sdlog2_dump.py, and {AS_CSV}"),
    ".obs": ("RINEX observations", "make a .pos of them with RTKLIB (rnx2rtkp)"),
    ".rnx": ("RINEX observations", "make a .pos of them with RTKLIB (rnx2rtkp)"),
    ".pcap": ("a network capture", "extract the MAVLink stream, and record it as a tlog"),
    ".pcapng": ("a network capture", "extract the MAVLink stream, and record it as a tlog"),
}
"""Formats that cannot be read, by the suffix of the file."""
HEAD = 4096
"""Number of bytes used to recognize a format."""


def read_logs(path: Path, options: ReadOptions | None = None) -> list[RangeLog]:
    """Return the vehicles of a run folder or of a log, each with its positions and ranges. Raises RunError, OSError."""
    options = options or ReadOptions()
    file = path / "flight.tlog" if path.is_dir() else path
    if not file.exists():
        raise RunError(f"{file}: no such file")
    with open_file(file) as opened:
        head = opened.read(HEAD)
    try:
        known = recognize(file, head)
        if options.vehicle is not None and known is not TLOG:
            raise RunError(f"--vehicle selects one of the vehicles of a tlog; this is {known.name}")
        if options.range_columns and known is not TABLE:
            raise RunError(f"--range-column selects a column of a table; this is {known.name}")
        logs = known.read(file, options)
        for log in logs:
            screen(log)
        _demand(logs, known, options)
    except EmptyLogError as error:
        raise EmptyLogError(f"{file}: {error}") from None
    except RunError as error:
        raise RunError(f"{file}: {error}") from None
    return logs


def recognize(file: Path, head: bytes) -> Format:
    """Return the format of a file. Raises RunError if it cannot be read."""
    for known in FORMATS:
        if known.matches(head):
            return known
    unreadable = SUFFIXES.get(file.suffix.lower())
    if unreadable is None and b"<kml" in head:
        unreadable = SUFFIXES[".kml"]
    if unreadable is None:
        unreadable = next((entry for mark, entry in MARKS.items() if head.startswith(mark)), None)
    if unreadable is not None:
        name, way = unreadable
        raise RunError(f"is {name}, which is not supported: {way.replace('FILE', file.name)}")
    utf16 = head.startswith((b"\xff\xfe", b"\xfe\xff"))
    return TLOG if b"\0" in head and not utf16 else TABLE


def _demand(logs: Sequence[RangeLog], known: Format, options: ReadOptions) -> None:
    """Raise EmptyLogError if required positions or ranges are missing."""
    if options.ranges and not any(log.ranges for log in logs):
        missing = f"no ranges in it; in {known.name} they are {known.ranges}"
        if names := sorted({name for log in logs for name in log.names} - {options.range_name}):
            missing += f", and none has the name {options.range_name!r}. Names that may be ranges: {listed(names)}. "
            missing += f"Give one: --range-name {printable(names[0])}"
        raise EmptyLogError(missing)
    if options.positions and not any(len(log.positions) > 1 for log in logs):
        notes = "".join(f"; {note}" for log in logs for note in log.notes)
        raise EmptyLogError(f"no positions in it; in {known.name} they are {known.positions}{notes}")


def with_positions(logs: Sequence[RangeLog], carriers: Sequence[RangeLog], source: Path) -> list[RangeLog]:
    """Return the ranges of the logs with the positions of another file. Raises RunError."""
    tracks = [log for log in carriers if len(log.positions) > 1]
    if len(tracks) != 1:
        raise RunError(f"{source}: it has positions of {len(tracks)} vehicles: give --vehicle")
    track = tracks[0]
    joined = []
    for log in logs:
        later = 0.0
        if (log.epoch is None) != (track.epoch is None):
            utc, other = ("ranges", "positions") if track.epoch is None else ("positions", "ranges")
            raise RunError(
                f"{source}: the {utc} have UTC, the {other} another clock: write the times of the {other} in UTC, in "
                "ISO 8601 or as seconds since 1970"
            )
        if log.epoch is not None and track.epoch is not None:
            later = log.epoch - track.epoch
        else:
            log.note("positions and ranges have no UTC: their times are taken to be of one clock")
        shifted = {
            tag: [(time + later, slant, sigma) for time, slant, sigma in rows] for tag, rows in log.ranges.items()
        }
        _compare_spans(log, shifted, track.positions)
        joined.append(RangeLog(track.positions, shifted, log.vehicle, track.epoch, [*log.notes, *track.notes]))
    return joined


def _compare_spans(log: RangeLog, ranges: Mapping[str, Sequence[Range]], positions: Sequence[Position]) -> None:
    """Add a note if ranges and positions do not overlap in time."""
    times = [time for rows in ranges.values() for time, *_ in rows]
    begin, end = min(row[0] for row in positions), max(row[0] for row in positions)
    if times and (max(times) < begin or min(times) > end):
        hours = (min(times) - begin) / 3600
        order = "after" if hours > 0 else "before"
        log.note(
            f"ranges and positions do not overlap: the ranges begin {abs(hours):.2f} h {order} the positions. "
            "If one file has local time, give --timezone"
        )
