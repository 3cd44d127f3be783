"""RTKLIB's solution files (.pos): positions only."""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

from circnav_mav.extras.locate.logs.interface import Format, ReadOptions, sentences
from circnav_mav.extras.locate.range_log import RangeLog
from circnav_mav.runlog.run_folder import RunError

GPS_ZERO, LEAP = datetime(1980, 1, 6, tzinfo=UTC), timedelta(seconds=18)
"""GPS epoch, and leap seconds by which GPS time is ahead of UTC since 2017."""
AHEAD = {"GPST": LEAP, "UTC": timedelta(0), "JST": timedelta(hours=9)}
LATITUDE = "latitude(deg)"
ANGLES = "prints its coordinates in another form: set RTKLIB's output to Lat/Lon/Height, decimal degrees"


def _read(path: Path, options: ReadOptions) -> list[RangeLog]:
    log, ahead, known = RangeLog(epoch=0.0), LEAP, False
    for number, line in sentences(path.read_text(encoding="utf-8", errors="replace")):
        if line.startswith("%"):
            words = line.lstrip("% ").split()
            if words and words[0] in AHEAD and len(words) > 1 and "(" in words[1]:
                if words[1] != LATITUDE:
                    raise RunError(f"{ANGLES}, not {words[1]}")
                ahead, known = AHEAD[words[0]], True
                if words[0] == "GPST":
                    log.note("times are GPS time and read as UTC + 18 s")
            continue
        cells = [cell for cell in re.split(r"[,;\s]+", line) if cell]
        try:
            if "/" in cells[0]:
                moment = datetime.strptime(f"{cells[0]} {cells[1][:15]}", "%Y/%m/%d %H:%M:%S.%f").replace(tzinfo=UTC)
            else:
                moment = GPS_ZERO + timedelta(weeks=int(cells[0]), seconds=float(cells[1]))
            latitude, longitude, height = map(float, cells[2:5])
            quality = int(cells[5])
        except (ValueError, IndexError):
            raise RunError(f"line {number}: is not a solution of RTKLIB: {line[:60]!r}") from None
        if abs(latitude) > 90 or abs(longitude) > 180:
            raise RunError(f"line {number}: {ANGLES}")
        if quality > 0:
            log.positions.append(((moment - ahead).timestamp(), latitude, longitude, height))
    if log.positions:
        log.note("heights are above the ellipsoid, for the target too")
        if not known:
            log.note("the file does not name its time system: times are read as GPS time, UTC + 18 s")
    return [log]


FIRST_ROW = re.compile(rb"(\d{4}/\d{2}/\d{2} \d{2}:\d{2}:\d{2}\.\d+|\d{4} +\d+\.\d+)[,\s]+-?\d+\.\d{6,}[,\s]")
HEADERS = (b"% program", b"%  GPST", b"%  UTC", b"%  JST")
RTKLIB = Format(
    name="a solution of RTKLIB (.pos)",
    matches=lambda head: head.startswith(HEADERS) or FIRST_ROW.match(head) is not None,
    read=_read,
    ranges="absent: it has only positions. With ranges in a file: circnav locate RANGES --positions POS",
    positions="solutions with a quality above 0",
)
