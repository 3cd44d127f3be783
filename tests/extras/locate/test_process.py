"""The survey beside a flight of the command line, and its run folder read back."""

import json
from math import hypot
from pathlib import Path

from circnav_sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG
from pymavlink import mavutil

from circnav_mav.extras.locate.place import Plane
from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from circnav_mav.runlog.run_folder import open_run
from tests.process import PATIENCE, QUICKSTART, circnav


def test_flight_with_survey_locates_target_and_replays(tmp_path: Path) -> None:
    """By default the emulator's target is at the home position."""
    run = tmp_path / "run"
    survey = ("--set", "locate.enabled=true")
    printed, errors = circnav(
        "fly", QUICKSTART, "--duration", "50", "--out", run, *survey
    ).communicate(timeout=PATIENCE)
    assert errors == ""
    summary = json.loads((run / "summary.json").read_text())
    place = Plane(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG).to_metres(
        summary["place"]["latitude_deg"], summary["place"]["longitude_deg"]
    )
    assert hypot(*place) < 4 * summary["place"]["sigma_m"] and summary["place"]["sigma_m"] < 5
    assert "  target  " in printed
    assert {"target.geojson", "target.kml", "target.png"} <= {path.name for path in run.iterdir()}
    located = circnav("locate", run).communicate(timeout=PATIENCE)[0]
    assert "sensor 0 of 1/192: " in located
    log = mavutil.mavlink_connection(str(run / "flight.tlog"))
    circle = log.recv_match(type="ORBIT_EXECUTION_STATUS")
    assert circle.get_srcComponent() == 194 and circle.radius == 100.0
    again = replay(
        Pilot(parse_mission(open_run(run).mission_text, "mission.toml").pilot_settings()),
        recorded_steps(run),
    )
    assert again.identical
