"""A quickstart flight over real sockets, replayed: the same bytes; and a run whose process was killed."""

import json
import signal
import subprocess
import sys
from pathlib import Path

from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from circnav_mav.runlog.run_folder import open_run
from tests.process import PATIENCE, QUICKSTART, circnav


def again(folder: Path):
    run = open_run(folder)
    return replay(Pilot(parse_mission(run.mission_text, "mission.toml").pilot_settings()), recorded_steps(folder))


def test_a_flight_of_the_command_is_replayed_byte_for_byte(tmp_path: Path) -> None:
    process = circnav("fly", QUICKSTART, "--duration", "20", "--out", str(tmp_path))
    process.communicate(timeout=PATIENCE)
    done = again(tmp_path)
    assert done.identical
    assert len(done.was_setpoints) > 100
    assert done.frames > 1000
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["exit"] == process.returncode == 0
    assert manifest["autopilot"] == {"system": 1, "component": 1, "name": "ardupilot copter", "firmware": "4.6.3"}
    assert set(manifest["versions"]) == {"circnav", "python", "pymavlink", "numpy", "filterpy"}
    assert (manifest["seeds"], manifest["voice"]) == ({"sim": 7}, "fly")


def test_a_killed_flight_loses_at_most_its_last_second_and_still_opens(tmp_path: Path) -> None:
    process = circnav("fly", QUICKSTART, "--speed", "1", "--out", str(tmp_path))
    assert process.stdout is not None
    shown = 0.0
    for line in process.stdout:
        if " s  " in line and "link age" in line:
            shown = float(line.split()[0])
        if shown >= 6:
            break
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=PATIENCE)
    run = open_run(tmp_path)
    assert (run.summary, run.manifest["exit"]) == ({}, None)
    assert run.ticks.time[-1] > shown - 1.0
    done = again(tmp_path)
    assert done.identical
    assert done.until > shown - 1.0
    replayed = subprocess.run(
        [sys.executable, "-m", "circnav_mav", "replay", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert (replayed.returncode, replayed.stderr) == (0, "")
    assert "byte for byte the same" in replayed.stdout
