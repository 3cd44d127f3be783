"""The horizontal radius does not depend on the vehicle's height: the slant correction follows the
altitude."""

import re

import pytest
from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Vehicle

from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import Ending, Pilot
from tests.flight.ground_station import Operator
from tests.flight.lockstep import CONFIG, Flight, flight, last_third, mean_radius, tangent

HOME_AMSL = 584.0
HOME_POSITION = b"\xf2\x00\x00"


def flight_with_height(mission: str, key: str, *overrides: str) -> Flight:
    """Return a flight of a file in config/ whose mission gives the height by another key."""
    text, count = re.subn(
        r"(?m)^height_above_target_m = .*$", key, (CONFIG / f"{mission}.toml").read_text()
    )
    assert count == 1
    loaded = parse_mission(text, mission, (*overrides, 'guidance.law="smooth"'))
    assert loaded.file.sim is not None
    return Flight(Pilot(loaded), Vehicle(parse_vehicle(loaded.file.sim, mission)))


def test_horizontal_radius_is_constant_while_plane_climbs() -> None:
    """With the constant height of 60 m, the plane would fly a radius of 140.4 m instead of 150 m
    after its climb."""
    flown = flight("arduplane", *tangent(180.0), law="auto").fly(25)
    Operator(flown.vehicle).change_altitude(80.0)
    flown.fly(75)
    assert -flown.vehicle.truth.down == pytest.approx(80.0, abs=0.5)
    assert mean_radius(last_third(flown)) == pytest.approx(150.0, abs=0.3)
    assert flown.ticks[0].height == 60.0
    assert flown.ticks[-20].height == pytest.approx(80.0, abs=0.5)


@pytest.mark.parametrize(
    ("mission", "radius", "flies", "key"),
    [
        ("arducopter", 30.0, 25.0, f"target_altitude_m = {HOME_AMSL + 5}"),
        ("px4_copter", 50.0, 30.0, "target_above_home_m = 5.0"),
    ],
)
def test_slant_correction_uses_height_from_home_or_sea_level(
    mission: str, radius: float, flies: float, key: str
) -> None:
    placed = (
        "sim.target.altitude_m=5.0",
        f"sim.start.altitude_m={flies}",
        *tangent(radius + 5.0),
        "limits.duration_s=50.0",
    )
    flown = flight_with_height(mission, key, *placed).fly(200)
    assert flown.outcome.ending is Ending.COMPLETED
    assert mean_radius(last_third(flown)) == pytest.approx(radius, abs=0.015 * radius)
    assert flown.ticks[-20].height == pytest.approx(flies - 5.0, abs=1.0)


def test_height_above_home_needs_a_home_position() -> None:
    flown = flight_with_height("arducopter", "target_above_home_m = 0.0", "link.wait_s=5.0")
    flown.hears = lambda frame, now: frame[7:10] != HOME_POSITION
    flown.fly(30)
    assert flown.setpoint_times == []
    assert flown.outcome.ending is Ending.NOTHING_RECEIVED
    assert flown.outcome.reason.startswith("no home altitude (HOME_POSITION)")
    assert set(flown.pilot.tracker.ranging.rejected) == {"no_height"}
