"""The locator beside a flight of the command line, and its run folder read back."""

import json
from math import hypot

import pytest
from circnav_sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG
from pymavlink import mavutil

from circnav_mav.extras.locate.place import Plane
from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from circnav_mav.runlog.run_folder import open_run
from tests.process import QUICKSTART


@pytest.mark.usefixtures("undrawn", "no_pictures")
def test_recorded_flight_with_locator_replays_with_located_target(circnav, tmp_path):
    """By default the emulator's target is at the home position."""
    run = tmp_path / "run"
    keys = ("locate.enabled=true", "sim.start.north_m=130", "sim.start.east_m=-30")
    changes = [word for key in keys for word in ("--set", key)]
    printed = circnav("fly", QUICKSTART, "--duration", "40", "--out", run, *changes).done
    summary = json.loads((run / "summary.json").read_text())
    place = Plane(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG).to_metres(
        summary["place"]["latitude_deg"], summary["place"]["longitude_deg"]
    )
    assert hypot(*place) < 4 * summary["place"]["sigma_m"] and summary["place"]["sigma_m"] < 5
    assert "  target  " in printed
    assert circnav("report", run).done
    assert {"target.geojson", "target.kml", "target.png"} <= {path.name for path in run.iterdir()}
    assert "sensor 0 of 1/192: " in circnav("locate", run).done
    log = mavutil.mavlink_connection(str(run / "flight.tlog"))
    circle = log.recv_match(type="ORBIT_EXECUTION_STATUS")
    assert circle.get_srcComponent() == 194 and circle.radius == 100.0
    again = replay(
        Pilot(parse_mission(open_run(run).mission_text, "mission.toml")),
        recorded_steps(run),
    )
    assert again.identical
