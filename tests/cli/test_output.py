"""Standard output that cannot be written is named as such, and a reader that goes away is nobody's error."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.flight.recorded import recorded_flight

ROOT = Path(__file__).parents[2]
CAMPAIGN = f"""mission = "{ROOT / "config" / "campaign_mission.toml"}"
runs = 4
[vary]
"guidance.law" = ["smooth"]
"limits.duration_s" = [5.0]
"""
COMMANDS = ["replay run", "report run", "campaign c.toml --processes 1", "paper --starts 1",
            "bench --law pd --situation calm --flights 2"]  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("place")
    recorded_flight(folder / "run", "quickstart", "limits.duration_s=5").fly(10).recorder.close()
    (folder / "c.toml").write_text(CAMPAIGN)
    return folder


def told(place, command, stdout):
    ran = subprocess.run(
        [sys.executable, "-m", "circnav_mav", *command.split()], cwd=place, stdout=stdout, stderr=subprocess.PIPE,
        text=True, check=False, env={"PYTHONPATH": str(ROOT), "PATH": "/bin"},
    )  # fmt: skip
    return ran.returncode, ran.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("command", COMMANDS)
def test_an_output_that_is_full_is_one_line_that_names_it(place, command):
    with Path("/dev/full").open("w") as full:
        said = told(place, command, full)
    assert said == (2, "circnav: standard output cannot be written: No space left on device\n")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_reader_that_went_away_ends_the_command_without_a_word(place, command):
    """As in `| head -1`."""
    ours, theirs = os.pipe()
    os.close(ours)
    said = told(place, command, theirs)
    os.close(theirs)
    assert said == (1, "")
