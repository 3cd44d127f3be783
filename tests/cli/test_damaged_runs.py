"""Damaged run folders: report and replay use the readable part, or refuse in one line."""

import re

import pytest

from circnav_mav.runlog.ticks import read_truth
from circnav_mav.runlog.tlog import read_tlog
from tests.flight.recorded import EPOCH_US

pytestmark = pytest.mark.usefixtures("no_pictures")


@pytest.fixture
def printed_by(circnav, run):
    """Return a function that runs a command on the run folder: printed_by("report")."""
    return lambda command: circnav(command, run)


def rows(run):
    return [line.split(",") for line in (run / "ticks.csv").read_text().splitlines()]


def write(run, lines):
    (run / "ticks.csv").write_text("".join(",".join(line) + "\n" for line in lines))


def with_cells(run, line, **cells):
    """Change some cells of a line in ticks.csv. Lines count from 1, or from the end if negative."""
    changed = rows(run)
    for name, cell in cells.items():
        changed[line if line < 0 else line - 1][changed[0].index(name)] = cell
    write(run, changed)


NO_TIME = "time: must be seconds of the run, not"


@pytest.mark.parametrize(
    ("command", "spoil", "error"),
    [
        ("report", lambda run: with_cells(run, 2, time=""), f"line 2: {NO_TIME} nan"),
        ("replay", lambda run: with_cells(run, -1, time="0.0"), "time: 0.000000 comes after "),
        (
            "report",
            lambda run: write(run, [*rows(run)[:2], *rows(run)[1:2]]),
            "line 3: time: does not increase to the end",
        ),
        ("report", lambda run: with_cells(run, 7, r="far"), "line 7: r: 'far' is not a number"),
        (
            "report",
            lambda run: with_cells(run, 7, direction="left"),
            "line 7: direction: 'left' is none of clockwise",
        ),
        (
            "report",
            lambda run: (run / "ticks.csv").write_text("time", "utf-16"),
            "is not a text file in UTF-8",
        ),
    ],
    ids=[
        "empty first time",
        "last time 0",
        "equal times",
        "time is a word",
        "foreign word",
        "UTF-16",
    ],
)
def test_invalid_ticks_are_refused_with_line_number(printed_by, run, command, spoil, error):
    spoil(run)
    line = printed_by(command).refused
    assert line.startswith(f"{run / 'ticks.csv'}: ")
    assert error in line


def test_report_accepts_implausible_and_non_finite_ticks(printed_by, run):
    too_large = dict.fromkeys(
        ("accepted", "rejected", "r", "measured", "nis", "turn_rate"), "1e308"
    )
    for cells in (too_large, too_large | {"accepted": "", "measured": "nan", "turn_rate": "inf"}):
        with_cells(run, -1, **cells)
        assert printed_by("report").done


def page_with(printed_by, run, summary):
    """Return the part of the report that begins with the outcome, for a given summary."""
    (run / "summary.json").write_text(summary)
    assert printed_by("report").done
    return (run / "report.html").read_text().partition('<div class="outcome')[2]


def test_report_uses_ticks_when_summary_is_incomplete(printed_by, run):
    for text in ("", "{", "[]", "{}", "null"):
        assert (
            "summary.json is missing or incomplete: figures from the recorded ticks"
            in page_with(printed_by, run, text)
        ), text[:9]


def test_report_refuses_invalid_start_time(printed_by, with_manifest):
    for epoch in (-1, 2**63, 10**30, 0, "now", None, 1.5, True):
        with_manifest(epoch_us=epoch)
        assert "has the start time of the run (epoch_us)" in printed_by("report").refused, epoch


# --- damaged logs: replayed up to the damage, which is reported


def records(log):
    """Return the offset of each record of the tlog."""
    at = 0
    found = []
    for _, frame in read_tlog(log):
        found.append(at)
        at += 8 + len(frame)
    return found


def spoil(path, at, data):
    whole = bytearray(path.read_bytes())
    whole[at : at + len(data)] = data
    path.write_bytes(whole)


def spoil_check(log):
    """Change a byte in a received ATTITUDE (30)."""
    frames = list(read_tlog(log))
    received = next(
        n for n, (_, frame) in enumerate(frames) if n > 100 and frame[5] != 255 and frame[7] == 30
    )
    spoil(log, records(log)[received] + 8 + 10, b"\xaa\x55")


def test_truncated_log_is_replayed_to_its_end(printed_by, run):
    log = run / "flight.tlog"
    third = records(log)[len(records(log)) // 3]
    log.write_bytes(log.read_bytes()[: third + 10])
    out = printed_by("replay").done
    assert f"WARNING    flight.tlog: cut off or damaged at byte {third} of {third + 10} (" in out
    assert re.search(r"byte for byte the same up to \d\.\d s, as", out)
    assert "cut off or damaged at byte" in printed_by("report").done
    assert "cut off or damaged at byte" in (run / "report.html").read_text()


def test_replay_reports_position_of_log_damage(printed_by, run):
    newest = read_truth(run, EPOCH_US).time[-1]
    middle = records(run / "flight.tlog")[len(records(run / "flight.tlog")) // 2]
    spoil(run / "flight.tlog", middle, bytes(64))
    out = printed_by("replay").done
    assert f"WARNING    flight.tlog: damaged at byte {middle} of " in out
    assert re.search(
        r"replayed up to \d\.\d s of \d+\.\d s, where flight\.tlog or steps\.csv is damaged", out
    )
    assert "byte for byte the same up to" in out
    lost = rf"flight\.tlog: damaged at byte {middle} of \d+, \d+ bytes left out \(from \d\.\d s of"
    assert re.search(lost, printed_by("report").done)
    assert read_truth(run, EPOCH_US).time[-1] == newest


def test_replay_counts_frames_with_wrong_checksum(printed_by, run):
    spoil_check(run / "flight.tlog")
    assert "flight.tlog: 1 damaged frames left out\n" in printed_by("replay").done


# --- names
