"""Fleet reports in the tlog of a flight. Each run folder holds the own and the accepted reports."""

from collections.abc import Iterator
from pathlib import Path

from circnav_mav.extras.fleet.frames import MESSAGE, from_message, is_report
from circnav_mav.extras.fleet.report import MemberReport
from circnav_mav.runlog.tlog import read_messages


def recorded_reports(tlog: Path) -> Iterator[tuple[float, MemberReport]]:
    """Yield (Unix time of recording in s, report) pairs in order. Raises OSError."""
    for stamp_us, message in read_messages(tlog, {MESSAGE}):
        if is_report(message):
            try:
                yield stamp_us / 1e6, from_message(message)
            except ValueError:
                continue  # a log of other software: the carrier does not record such reports
