"""`circnav fly`: its run folder, read and replayed, and the end of its process by Ctrl-C and a
kill."""

import csv
import json
import signal
from pathlib import Path

from pymavlink import mavutil

from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import ReplayResult, replay
from circnav_mav.runlog.run_folder import open_run
from tests.command_line import circnav
from tests.process import PATIENCE, QUICKSTART, read_until
from tests.process import circnav as start

__all__ = ["circnav"]


def again(folder: Path) -> ReplayResult:
    run = open_run(folder)
    return replay(
        Pilot(parse_mission(run.mission_text, "mission.toml")),
        recorded_steps(folder),
    )


def test_settled_flight_leaves_complete_run_folder(circnav, tmp_path):
    folder = tmp_path / "run"
    printed = circnav("fly", QUICKSTART, "--duration", "45", "--out", folder).done
    assert "COMPLETED" in printed
    assert "rotation clockwise (as desired)" in printed
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert summary["truth"]["direction"] == summary["direction"] == "clockwise"
    assert summary["truth"]["radius_rms_error_m"] < 2.0
    assert 10 < summary["settled_s"] < 45
    names = {path.name for path in folder.iterdir()}
    assert names >= {"summary.json", "ticks.csv", "flight.tlog", "mission.toml", "flight.png"}
    assert "duration_s = 45" in (folder / "mission.toml").read_text()
    manifest = json.loads((folder / "manifest.json").read_text())
    assert (manifest["exit"], manifest["seeds"], manifest["output_mode"]) == (0, {"sim": 7}, "fly")
    vehicle = {"system": 1, "component": 1, "name": "ardupilot copter", "firmware": "4.6.3"}
    assert manifest["autopilot"] == vehicle
    assert set(manifest["versions"]) == {"circnav", "python", "pymavlink", "numpy", "filterpy"}
    done = again(folder)
    assert done.identical
    assert len(done.was_setpoints) == summary["setpoints_sent"] > 800


def test_interrupt_sends_safe_setpoint_and_exits_130(tmp_path: Path) -> None:
    """tests/cli/test_fly.py and test_boot.py send SIGTERM."""
    folder = tmp_path / "run"
    process = start("fly", QUICKSTART, "--speed", "5", "--out", str(folder), drawn=False)
    read_until(process, "engaged")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    with (folder / "steps.csv").open() as file:
        turns = list(csv.DictReader(file))
    received_at = next(int(turn["time_us"]) for turn in turns if turn["interrupt"] == "SIGINT")
    assert int(turns[-1]["time_us"]) - received_at < 15e6
    assert json.loads((folder / "summary.json").read_text())["outcome"] == "interrupted"
    log = mavutil.mavlink_connection(str(folder / "flight.tlog"))
    setpoints = []
    while (message := log.recv_match(type="SET_POSITION_TARGET_LOCAL_NED")) is not None:
        setpoints.append((message.vx, message.yaw_rate))
    assert setpoints[-3:] == [(0.0, 0.0)] * 3
    assert setpoints[-4][0] == 15.0


def test_killed_flight_loses_at_most_one_second(tmp_path: Path) -> None:
    process = start("fly", QUICKSTART, "--speed", "4", "--out", str(tmp_path), drawn=False)
    assert process.stdout is not None
    times = (
        float(line.split()[0]) for line in process.stdout if " s  " in line and "link age" in line
    )
    shown = next(time for time in times if time >= 6)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=PATIENCE)
    run = open_run(tmp_path)
    done = again(tmp_path)
    assert (run.summary, run.manifest["exit"], done.identical) == ({}, None, True)
    assert min(run.ticks.time[-1], done.until) > shown - 1.0
