"""A disk that takes no more: the process may write no file beyond a size, which the kernel answers like a full disk."""

import json
import subprocess
import sys

from tests.process import PATIENCE, ROOT


def limited(place, kilobytes, *command):
    """`circnav COMMAND` in a process whose files end at a size; bytecode would be cut off, too."""
    words = [sys.executable, "-B", "-m", "circnav_mav", *command]
    return subprocess.run(
        ["bash", "-c", f'ulimit -f {kilobytes}; exec "$@"', "bash", *words], cwd=place, capture_output=True, text=True,
        check=False, env={"PYTHONPATH": str(ROOT), "PATH": "/bin"}, timeout=PATIENCE,
    )  # fmt: skip


def test_a_flight_that_went_well_and_was_not_recorded_to_its_end_has_an_exit_code_of_its_own(tmp_path):
    ran = limited(tmp_path, 60, "fly", "quickstart", "--duration", "10", "--out", "run")
    assert (ran.returncode, ran.stderr) == (5, "")
    assert "COMPLETED: flown to its end" in ran.stdout
    assert "WARNING    run: recording stopped: File too large" in ran.stdout
    assert json.loads((tmp_path / "run" / "manifest.json").read_text())["exit"] == 5
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["outcome"] == "completed"


def test_a_flight_that_did_not_end_well_keeps_its_own_exit_code(tmp_path):
    ends = ("--set", "bounds.max_range_m=340", "--set", "orbit.direction=counterclockwise")
    ran = limited(tmp_path, 8, "fly", "quickstart", *ends, "--out", "run")
    assert (ran.returncode, ran.stderr) == (4, "")
    assert "WARNING    run: recording stopped: File too large" in ran.stdout


def test_a_picture_that_finds_no_room_leaves_the_older_one_as_it_is(tmp_path):
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "example_1_track.png").write_text("older")
    ran = limited(tmp_path, 10, "paper", "--starts", "1", "--out", "p")
    assert (ran.returncode, ran.stderr) == (2, "circnav: p/example_1_track.png: File too large\n")
    assert [(path.name, path.read_text()) for path in (tmp_path / "p").iterdir()] == [("example_1_track.png", "older")]
