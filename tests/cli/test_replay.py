"""`circnav replay`: what it says, and one line for every log that cannot be replayed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.flight.recorded import recorded_flight


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart", "limits.duration_s=10").fly(20).recorder.close()
    return folder


def copy_of(folder, to, leave_out=()):
    to.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in leave_out:
            (to / path.name).write_bytes(path.read_bytes())
    return to


def test_a_run_replayed_as_it_was_says_byte_for_byte(circnav, flown):
    ran = circnav("replay", flown)
    assert (ran.code, ran.err) == (0, "")
    assert "byte for byte the same" in ran.out
    assert "range rate       the same" in ran.out
    assert "completed: flown to its end" in ran.out


def test_another_law_is_told_apart_and_drawn(circnav, flown, tmp_path):
    ran = circnav("replay", flown / "flight.tlog", "--law", "switching", "--out", tmp_path / "what-if")
    assert ran.code == 0
    assert "first frame that differs" in ran.out
    assert (tmp_path / "what-if" / "replay.png").read_bytes().startswith(b"\x89PNG")
    assert len((tmp_path / "what-if" / "ticks.csv").read_text().splitlines()) > 100


def test_a_plain_tlog_is_replayed_with_a_mission(circnav, flown, tmp_path, config):
    log = tmp_path / "yesterday.tlog"
    log.write_bytes((flown / "flight.tlog").read_bytes())
    ran = circnav("replay", log, "--mission", config / "quickstart.toml", "--set", "orbit.radius_m=80")
    assert ran.code == 0
    assert "steering" in ran.out


@pytest.mark.parametrize(
    ("make", "options", "code", "says"),
    [
        (lambda flown, to: to / "nowhere", [], 2, "no such run folder"),
        (lambda flown, to: emptied_folder(to), [], 2, "is not a run folder"),
        (lambda flown, to: copy_of(flown, to, ["turns.csv"]), [], 2, "has no turns.csv"),
        (lambda flown, to: copy_of(flown, to, ["manifest.json"]), [], 2, "epoch_us"),
        (lambda flown, to: emptied(copy_of(flown, to)), [], 3, "an empty run"),
        (lambda flown, to: flown, ["--law", "spiral"], 2, "guidance.law: 'spiral' is not one of"),
        (lambda flown, to: flown, ["--estimator", "guess"], 2, "guidance.estimator: 'guess' is not"),
        (lambda flown, to: written(to, b"not a log"), ["--mission", "QUICKSTART"], 3, "no MAVLink frame in it"),
        (lambda flown, to: written(to, b""), ["--mission", "QUICKSTART"], 3, "no MAVLink frame in it"),
        (lambda flown, to: written(to, b""), [], 2, "a plain tlog needs --mission"),
        (lambda flown, to: written(to, b""), ["--mission", "no.toml"], 2, "cannot be read"),
    ],
    ids=[f"{number}" for number in range(11)],
)
def test_what_cannot_be_replayed_is_one_line(circnav, flown, tmp_path, config, make, options, code, says):
    log = make(flown, tmp_path / "run")
    ran = circnav("replay", log, *(config / "quickstart.toml" if o == "QUICKSTART" else o for o in options))
    assert ran.code == code
    assert says in ran.line


def emptied(folder):
    for name in ("flight.tlog", "turns.csv", "ticks.csv"):
        (folder / name).write_bytes(b"")
    return folder


def written(to, data):
    to.mkdir()
    (to / "x.tlog").write_bytes(data)
    return to / "x.tlog"


def test_a_log_without_ranging_says_what_is_missing(circnav, flown, tmp_path, config):
    log = tmp_path / "x.tlog"
    log.write_bytes((flown / "flight.tlog").read_bytes())
    ran = circnav("replay", log, "--mission", config / "quickstart.toml", "--set", "ranging.message=ranging_beacon")
    assert ran.code == 3
    assert "0 ranges of ranging_beacon taken" in ran.line


def test_a_gain_of_another_law_is_not_taken_over(circnav, tmp_path, config):
    recorded_flight(tmp_path / "run", "paper_example_1", "limits.duration_s=2").fly(5).recorder.close()
    ran = circnav("replay", tmp_path / "run", "--law", "switching")
    assert ran.code == 2
    assert "belongs to the law smooth" in ran.line


def emptied_folder(to):
    to.mkdir()
    return to


def test_a_reader_of_the_output_that_goes_away_is_not_blamed_on_the_run(flown):
    """As in `circnav replay RUN | head -1`."""
    ours, theirs = os.pipe()
    os.close(ours)
    ran = subprocess.run(
        [sys.executable, "-m", "circnav_mav", "replay", flown],
        stdout=theirs, stderr=subprocess.PIPE, text=True, check=False,
        env={"PYTHONPATH": str(Path(__file__).parents[2]), "PATH": "/bin"},
    )  # fmt: skip
    os.close(theirs)
    assert (ran.returncode, ran.stderr) == (1, "")
