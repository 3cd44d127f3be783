"""Standard output that cannot be written is named as such, and a reader that goes away is nobody's error."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.flight.recorded import recorded_flight
from tests.process import PATIENCE

ROOT = Path(__file__).parents[2]
QUICKSTART = ROOT / "config" / "quickstart.toml"
CAMPAIGN = f"""mission = "{ROOT / "config" / "campaign_mission.toml"}"
runs = 4
[vary]
"guidance.law" = ["smooth"]
"limits.duration_s" = [5.0]
"""
COMMANDS = ["replay run", "report run", "campaign c.toml --processes 1", "paper --starts 1",
            "bench --law pd --situation calm --flights 2", "--help", "fly --help", "--version", f"check {QUICKSTART}",
            f"preflight {QUICKSTART} --seconds 1"]  # fmt: skip


FULL = "circnav: standard output cannot be written: No space left on device\n"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("place")
    recorded_flight(folder / "run", "quickstart", "limits.duration_s=5").fly(10).recorder.close()
    (folder / "c.toml").write_text(CAMPAIGN)
    return folder


def told(place, command, stdout, **environment):
    ran = subprocess.run(
        [sys.executable, "-m", "circnav_mav", *command.split()], cwd=place, stdout=stdout, stderr=subprocess.PIPE,
        text=True, check=False, env={"PYTHONPATH": str(ROOT), "PATH": "/bin"} | environment, timeout=PATIENCE,
    )  # fmt: skip
    return ran.returncode, ran.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("command", [*COMMANDS, "emulate"])
def test_an_output_that_is_full_is_one_line_that_names_it(place, command):
    with Path("/dev/full").open("w") as full:
        said = told(place, command, full)
    assert said == (2, FULL)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_it_is_one_line_however_python_buffers(place, unbuffered):
    with Path("/dev/full").open("w") as full:
        assert told(place, "check run/mission.toml", full, PYTHONUNBUFFERED=unbuffered) == (2, FULL)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_complaint_that_nobody_can_read_has_its_exit_code_all_the_same(place):
    command = [sys.executable, "-m", "circnav_mav", "report", "nowhere"]
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(command, cwd=place, stderr=full, check=False, env={"PYTHONPATH": str(ROOT)})
    assert ran.returncode == 2


@pytest.mark.parametrize("command", COMMANDS)
def test_a_reader_that_went_away_ends_the_command_without_a_word(place, command):
    """As in `| head -1`."""
    ours, theirs = os.pipe()
    os.close(ours)
    said = told(place, command, theirs)
    os.close(theirs)
    assert said == (1, "")
