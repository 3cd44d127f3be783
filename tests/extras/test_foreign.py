"""Unusual files, texts and computers: each command ends in one line of printable text."""

import json
import os
import re
import select
import time
from math import cos, radians, sin
from pathlib import Path
from unittest.mock import Mock

import pytest

from circnav_mav.extras.web.feed import _facts
from circnav_mav.foreign import printable, read_bytes
from circnav_mav.mission.load import parse_mission
from circnav_mav.mission.schema import MAX_NAME
from circnav_mav.pilot import Pilot
from tests import small_mission
from tests.cli.test_output import ended
from tests.process import QUICKSTART

ESCAPE = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e"
OBEYED = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]")
"""Control codes except tabs and line ends, and codes that reverse the direction of writing."""


def circle_log(tag):
    """A CSV of a circle of 60 m around a beacon 20 m east of its center."""
    rows = ["time,latitude,longitude,range,tag"]
    for second in range(200):
        north, east = 60 * cos(radians(6 * second)), 60 * sin(radians(6 * second))
        distance = (north**2 + (east - 20) ** 2) ** 0.5
        rows.append(f"{second},{46 + north / 111_195},{7 + east / 77_240},{distance:.3f},{tag}")
    return "\n".join(rows)


# --- texts


def test_printable_escapes_control_characters():
    assert printable("Nairobi è – 北 §4") == "Nairobi è – 北 §4"
    assert printable("a\x1b[31m\nb\udcff") == r"a\x1b[31m\nb\udcff"


def test_escape_codes_in_input_are_not_printed(circnav, tmp_path):
    (tmp_path / "collar.csv").write_text(circle_log(ESCAPE))
    ran = circnav("locate", "collar.csv")
    assert "200 ranges" in ran.done
    (tmp_path / "odd.toml").write_text('"\\u001b[31m" = 1\n["a\\nb\\u009b2J"]\n')
    outputs = [
        ran.out,
        circnav("check", "odd.toml").refused,
        circnav("emulate", "odd.toml").refused,
    ]
    for arguments in (
        ["replay", ESCAPE],
        ["check", ESCAPE],
        ["fly", "quickstart", ESCAPE],
        ["fly", f"--{ESCAPE}"],
    ):
        outputs.append(circnav(*arguments).err)
    outputs += [path.read_text() for path in tmp_path.glob("*.locate.*json")]
    outputs += [path.read_text() for path in tmp_path.glob("*.kml")]
    assert [text for text in outputs if OBEYED.search(text)] == []


@pytest.mark.usefixtures("no_pictures")
def test_report_omits_escape_codes_of_run_folder(circnav, run, with_manifest):
    with_manifest(
        mission=ESCAPE,
        outcome=ESCAPE,
        reason=ESCAPE,
        versions={ESCAPE: ESCAPE},
        autopilot={"name": ESCAPE},
    )
    mission = (run / "mission.toml").read_text()
    (run / "mission.toml").write_text(
        mission.replace("[ranging]", '[ranging]\nname = "\\u001b[31m"')
    )
    outputs = [
        circnav("report", run).done,
        circnav("replay", run).out,
        (run / "report.html").read_text(),
    ]
    assert r"\x1b[31m" in outputs[2]
    assert [text[:99] for text in outputs if OBEYED.search(text)] == []


# --- files


def pipe(path):
    os.mkfifo(path, 0o600)


def endless(path):
    path.symlink_to("/dev/zero")


def long_line(path):
    with path.open("wb") as file:
        file.write(b"time," * 1000)  # a file that begins with zeros is no CSV
        file.truncate(2**30)


READERS = {
    "check {0}": "x.toml",
    "check quickstart --set signing.key_file={0}": "x.key",
    "fly quickstart --duration 1 --set signing.key_file={1}/good.key --out {1}/out": (
        "good.key.timestamp"
    ),
    "campaign {0}": "x.toml",
    "locate {0}": "x.csv",
    "replay {0} --mission quickstart": "x.tlog",
    "report {1}": "manifest.json ticks.csv mission.toml flight.tlog",
    "replay {1}": "steps.csv mission.toml",
    "locate {1}": "flight.tlog",
    "fly quickstart --duration 1 --out {1}/out": "out/mission.toml",
}


@pytest.mark.usefixtures("no_pictures", "undrawn")
@pytest.mark.parametrize("make", [pipe, endless, long_line])
@pytest.mark.parametrize(
    ("command", "name"), [(one, name) for one, names in READERS.items() for name in names.split()]
)
def test_endless_file_is_refused_in_one_line(circnav, run, command, name, make):
    """Tested with a pipe without a writer, a link to /dev/zero, and a file with a line of a
    gigabyte."""
    if make is long_line and name.endswith("tlog"):
        pytest.skip("a long log is read piece by piece")
    (run / "good.key").write_bytes(bytes(range(32)))
    (run / "good.key").chmod(0o600)
    path = run / name
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)
    make(path)
    ran = circnav(*command.format(path, run, run.parent).split())
    assert ran.code in (2, 3)
    assert str(path) in ran.line or str(path.parent) in ran.line
    if make is long_line and name == "x.csv":
        assert "a line is longer than 100000 characters" in ran.line


def test_mission_size_is_limited(circnav, tmp_path):
    (tmp_path / "x.toml").write_text("#" * 11_000_000)
    assert circnav("check", "x.toml").refused == "x.toml: cannot be read: is larger than 10 MB"


def test_read_bytes_allocates_only_size_of_file(tmp_path):
    """A read of at most 1 PB once allocated 1 PB."""
    (tmp_path / "small").write_bytes(b"123")
    assert read_bytes(tmp_path / "small", 10**15) == b"123"


def test_windows_mission_file_is_read(circnav, tmp_path):
    text = Path(QUICKSTART).read_bytes()
    (tmp_path / "bom.toml").write_bytes(b"\xef\xbb\xbf" + text.replace(b"\n", b"\r\n"))
    assert circnav("check", "bom.toml").done.replace("bom.toml", "") == circnav(
        "check", QUICKSTART
    ).done.replace(QUICKSTART, "")


@pytest.mark.parametrize(
    "command", ["fly mission.toml", "replay x", "locate x", "bench", "campaign wind", "paper"]
)
def test_output_refuses_root_folder_and_links(circnav, mission, tmp_path, command):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    for root in ("/", "//", "/usr/.."):
        assert circnav(*command.split(), "--out", root).refused.endswith(
            "is the root of the disk, name a folder in it"
        )
    assert (
        f"is a link to {tmp_path / 'mine'}, which is not empty"
        in circnav(*command.split(), "--out", "link").refused
    )
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


# --- missions of extreme size


def test_live_page_shows_longest_mission_name():
    """The page's server receives each state as a line over a pipe. A line longer than PIPE_BUF
    would be dropped."""
    pilot = Pilot(parse_mission(small_mission.TEXT, "x"))
    assert len(json.dumps(_facts(pilot, "x" * MAX_NAME, 1.0))) < select.PIPE_BUF


# --- computers


@pytest.mark.parametrize(
    ("limit", "command"),
    [
        ("-n 8", "fly quickstart --duration 1"),
        ("-n 5", "locate x.csv"),
        ("-v 60000", "check quickstart"),
    ],
)
def test_lack_of_memory_or_descriptors_gives_one_line(tmp_path, limit, command):
    (tmp_path / "x.csv").write_text(circle_log("a"))
    ran = ended(tmp_path, command, limit=limit, OPENBLAS_NUM_THREADS="1")
    assert ran.returncode in (1, 2)
    assert re.fullmatch(r"circnav: .*(Too many open files|out of memory).*\n", ran.stderr)


@pytest.mark.parametrize("year", [1947, 2120])
def test_flight_is_refused_if_computer_clock_is_unset(circnav, monkeypatch, year):
    monkeypatch.setattr(time, "time", lambda: (year - 1970) * 31_556_952.0)
    refused = circnav("fly", "quickstart").refused
    assert refused == "the clock of this computer is not between 1970 and 2100: set the clock"


def test_unexpected_exception_prints_one_line(circnav, monkeypatch):
    for failure, code, error in (
        (MemoryError(), 1, "out of memory"),
        (RuntimeError("can't start new thread"), 1, "out of memory"),
        (ZeroDivisionError("a\nb"), 1, r"internal error: ZeroDivisionError: a\nb (mock.py:"),
    ):
        monkeypatch.setattr("circnav_mav.mission.load.parse_mission", Mock(side_effect=failure))
        ran = circnav("check", "quickstart")
        assert ran.code == code
        assert ran.line.startswith(f"circnav: {error}")
