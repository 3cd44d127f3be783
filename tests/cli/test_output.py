"""Standard output that cannot be written is named as such, and a reader that goes away is nobody's error."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.process import PATIENCE, ROOT

CAMPAIGN = f"""mission = "{ROOT / "config" / "campaign_mission.toml"}"
runs = 4
[vary]
"guidance.law" = ["smooth"]
"limits.duration_s" = [5.0]
"""
COMMANDS = ["replay run", "campaign c.toml --processes 1", "preflight quickstart --seconds 1", "--help"]
FULL = "circnav: standard output cannot be written: No space left on device\n"


@pytest.fixture
def told(run):
    """Exit code and standard error of a command whose standard output, or error, is a file of ours."""
    (run.parent / "c.toml").write_text(CAMPAIGN)

    def told(command, stdout, stderr=subprocess.PIPE, **environment):
        ran = subprocess.run(
            [sys.executable, "-m", "circnav_mav", *command.split()], cwd=run.parent, stdout=stdout, stderr=stderr,
            text=True, check=False, env={"PYTHONPATH": str(ROOT), "PATH": "/bin"} | environment, timeout=PATIENCE,
        )  # fmt: skip
        return ran.returncode, ran.stderr

    return told


@pytest.fixture
def full():
    if not Path("/dev/full").exists():
        pytest.skip("needs /dev/full")
    with Path("/dev/full").open("w") as file:
        yield file


@pytest.mark.parametrize("command", [*COMMANDS, "emulate"])
def test_an_output_that_is_full_is_one_line_that_names_it(told, full, command):
    assert told(command, full) == (2, FULL)


def test_it_is_one_line_without_pythons_buffer_too(told, full):
    assert told("check quickstart", full, PYTHONUNBUFFERED="1") == (2, FULL)


def test_a_complaint_that_nobody_can_read_has_its_exit_code_all_the_same(told, full):
    assert told("report nowhere", None, full) == (2, None)


@pytest.mark.parametrize(
    "command", [*COMMANDS, "report run", "paper --starts 1", "bench --law pd --situation calm --flights 2"]
)
def test_a_reader_that_went_away_ends_the_command_without_a_word(told, command):
    """As in `| head -1`."""
    ours, theirs = os.pipe()
    os.close(ours)
    said = told(command, theirs)
    os.close(theirs)
    assert said == (1, "")
