"""Reads the positions and ranges in a log of any supported format."""

from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Sequence
from pathlib import Path

from circnav_mav.extras.locate.logs.columns import TABLE
from circnav_mav.extras.locate.logs.dataflash import DATAFLASH
from circnav_mav.extras.locate.logs.interface import Format, ReadOptions, listed
from circnav_mav.extras.locate.logs.screening import screen
from circnav_mav.extras.locate.logs.tlog import TLOG
from circnav_mav.extras.locate.logs.ulog import ULOG
from circnav_mav.extras.locate.range_log import EmptyLogError, RangeLog
from circnav_mav.foreign import open_file, printable
from circnav_mav.runlog.run_folder import RunError

FORMATS = (ULOG, DATAFLASH, TLOG)
"""Formats with an identifying header. Other text is read as a CSV."""


def read_logs(path: Path, options: ReadOptions | None = None) -> list[RangeLog]:
    """Return the vehicles of a run folder or of a log, each with its positions and ranges. Raises
    RunError, OSError."""
    options = options or ReadOptions()
    file = path / "flight.tlog" if path.is_dir() else path
    if not file.exists():
        raise RunError(f"{file}: no such file")
    with open_file(file) as opened:
        # 4096: number of bytes used to recognize a format.
        head = opened.read(4096)
    try:
        known = recognize(head)
        if options.vehicle is not None and known is not TLOG:
            raise RunError(f"--vehicle selects one of the vehicles of a tlog; this is {known.name}")
        logs = known.read(file, options)
        for log in logs:
            screen(log)
        _demand(logs, known, options.range_name)
    except EmptyLogError as error:
        raise EmptyLogError(f"{file}: {error}") from None
    except RunError as error:
        raise RunError(f"{file}: {error}") from None
    return logs


def recognize(head: bytes) -> Format:
    """Return the format of a file by its first bytes. Raises RunError if no reader exists."""
    for known in FORMATS:
        if known.matches(head):
            return known
    if head.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        raise RunError("is a text in UTF-16: save it in UTF-8")
    if b"\0" in head:
        raise RunError(
            f"is none of {', '.join(known.name for known in FORMATS)}; convert it to a CSV"
        )
    return TABLE


def _demand(logs: Sequence[RangeLog], known: Format, range_name: str) -> None:
    """Raise EmptyLogError if positions or ranges are missing."""
    notes = "".join(f"; {note}" for log in logs for note in log.notes)
    if not any(log.ranges for log in logs):
        missing = f"no ranges in it; in {known.name} they are {known.ranges}{notes}"
        if names := sorted({name for log in logs for name in log.names} - {range_name}):
            missing += (
                f", and none has the name {range_name!r}. Names that may be ranges:"
                f" {listed(names)}. "
            )
            missing += f"Give one: --range-name {printable(names[0])}"
        raise EmptyLogError(missing)
    if not any(len(log.positions) > 1 for log in logs):
        raise EmptyLogError(
            f"no positions in it; in {known.name} they are {known.positions}{notes}"
        )
