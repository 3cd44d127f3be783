"""GPX tracks: positions only."""

from datetime import datetime
from math import nan
from pathlib import Path
from xml.etree import ElementTree as Xml

from circnav_mav.extras.locate.logs.interface import Format, ReadOptions, utc_seconds
from circnav_mav.extras.locate.range_log import RangeLog
from circnav_mav.runlog.run_folder import RunError


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    log, untimed = RangeLog(epoch=0.0), 0
    try:
        root = Xml.parse(path).getroot()
        for point in root.iterfind(".//{*}trkpt"):
            when, height = point.findtext("{*}time"), point.findtext("{*}ele")
            if not when:
                untimed += 1
                continue
            moment = datetime.fromisoformat(when.strip())
            if moment.tzinfo is None:
                log.note("times of the GPX have no time zone and are read as UTC, as GPX defines")
            place = float(point.attrib["lat"]), float(point.attrib["lon"])
            log.positions.append((utc_seconds(moment, None), *place, float(height) if height else nan))
    except (Xml.ParseError, KeyError, ValueError) as error:
        raise RunError(f"cannot be read as GPX: {error}") from None
    if untimed and not log.positions:
        raise RunError("its points have no time: record a track, not a route, and export it with times")
    if untimed:
        log.note(f"{untimed} points without a time are left out")
    return [log]


GPX = Format(
    name="a GPX track",
    matches=lambda head: b"<gpx" in head,
    read=_read,
    ranges="absent: it has only positions. With ranges in a file: circnav locate RANGES --positions GPX",
    positions="trkpt with a time",
)
