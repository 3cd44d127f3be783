"""A full standard output or a full disk is reported as such. A reader that closes its pipe causes
no error."""

import json
import os

import pytest

from tests.command_line import FULL, ended


@pytest.fixture
def ran_with(run):
    """Return exit code and standard error of a command with a given standard output or error."""

    def ran_with(command, *streams, **environment):
        ran = ended(run.parent, command, *streams, **environment)
        return ran.returncode, ran.stderr

    return ran_with


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("command", ["--help", "emulate"])
def test_unwritable_stdout_is_reported_in_one_line(ran_with, full, command, unbuffered):
    assert ran_with(command, full, PYTHONUNBUFFERED=unbuffered) == (2, FULL)


def test_unwritable_stderr_keeps_exit_code(ran_with, full):
    assert ran_with("emulate nowhere", None, full) == (2, None)


@pytest.mark.parametrize("command", ["--help", "emulate"])
def test_closed_stdout_pipe_ends_command_silently(ran_with, command):
    """Example: `circnav check quickstart | head -1`. All commands share this code."""
    ours, theirs = os.pipe()
    os.close(ours)
    result = ran_with(command, theirs)
    os.close(theirs)
    assert result == (1, "")


# --- disks


@pytest.mark.parametrize(
    ("command", "name"),
    [("init copter", "copter.toml"), ("report run", "run/flight.png")],
)
def test_full_disk_keeps_previous_file(run, command, name):
    """An incomplete mission would block the next `init` as "exists already"."""
    path = run.parent / name
    if not command.startswith("init"):
        path.write_text("of before")
    before = {file: file.read_bytes() for file in run.parent.rglob("*") if file.is_file()}
    ran = ended(run.parent, command, limit="-f 1")
    assert (ran.returncode, ran.stderr.splitlines()[-1]) == (2, f"circnav: {name}: File too large")
    assert {file: file.read_bytes() for file in run.parent.rglob("*") if file.is_file()} == before


def test_incomplete_recording_of_aborted_flight_is_reported(tmp_path):
    """tests/cli/test_closing.py has the exit code of a completed flight."""
    options = "--set bounds.max_range_m=340 --set orbit.direction=counterclockwise --out run"
    ran = ended(tmp_path, f"fly quickstart {options}", limit="-f 8")
    assert (ran.returncode, ran.stderr) == (4, "")
    assert "ABORTED: " in ran.stdout
    assert "WARNING    run: recording stopped: File too large" in ran.stdout
    assert json.loads((tmp_path / "run" / "manifest.json").read_text())["exit"] == 4
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["outcome"] == "aborted"
