"""Flights that begin on the ground: circnav waits for an established flight, and ends a flight that
comes near the ground."""

import pytest

from circnav_mav.pilot import Ending, Phase
from circnav_mav.pilot.status_text import waits_for
from tests.flight.lockstep import Flight, flight

GROUND = "sim.start.armed=false", "sim.start.altitude_m=0.0", "sim.start.speed_mps=0.0"
STICK = (
    '{at_s=3.0,action="arm"}',
    '{at_s=4.0,action="throttle",value=0.9}',
    '{at_s=14.0,action="throttle",value=0.5}',
)
VEHICLES = {
    "ArduCopter, ALT_HOLD": ("arducopter_nogps", "ALT_HOLD", STICK, 5.0),
    "ArduCopter, LOITER": ("arducopter", "LOITER", STICK, 5.0),
    "ArduPlane, TAKEOFF": (
        "arduplane",
        "TAKEOFF",
        ('{at_s=3.0,action="arm"}', '{at_s=45.0,action="mode",mode="LOITER"}'),
        30.0,
    ),
    "PX4 copter, TAKEOFF": (
        "px4_copter",
        "TAKEOFF",
        ('{at_s=3.0,action="arm"}',),
        2.0,  # MIS_TAKEOFF_ALT of PX4: 2.5 m
    ),
}


def from_ground(mission: str, mode: str, events: tuple[str, ...], *overrides: str) -> Flight:
    """Return a flight whose vehicle stands on the ground in a mode."""
    return flight(
        mission,
        *GROUND,
        f'sim.start.mode="{mode}"',
        f"sim.events=[{','.join(events)}]",
        *overrides,
        law="auto",
    )


@pytest.mark.parametrize("name", VEHICLES)
def test_guidance_waits_for_established_flight(name: str) -> None:
    mission, mode, events, floor = VEHICLES[name]
    flown = from_ground(mission, mode, events, f"engage.min_height_m={floor}")
    in_air = 0.0
    while not flown.pilot.mission.begun:
        flown.fly(flown.now + 0.1)
        in_air = in_air + 0.1 if flown.vehicle.truth.down < 0 else 0.0
        assert flown.now < 90.0, waits_for(flown.pilot, flown.now)
    assert in_air >= 4.9
    assert -flown.vehicle.truth.down >= floor - 0.2
    if "plane" in mission:
        assert flown.now >= 45.0, "circnav must not end the mode TAKEOFF"
    flown.fly(flown.now + 20.0)
    assert flown.pilot.mission.phase is Phase.ENGAGED
    assert min(-truth.down for truth in flown.truths[-190:]) > floor / 2
    assert not flown.vehicle.truth.crashed


def test_guided_mode_entered_by_operator_obeys_least_height() -> None:
    """The operator enters GUIDED_NOGPS 1 s after lift-off. circnav sends no setpoint, and sends the
    reason as STATUSTEXT."""
    events = (
        '{at_s=3.0,action="arm"}',
        '{at_s=4.0,action="throttle",value=0.9}',
        '{at_s=6.5,action="mode",mode="GUIDED_NOGPS"}',
    )
    flown = from_ground("arducopter_nogps", "ALT_HOLD", events, "engage.request_mode=false")
    flown.fly(30.0)
    assert flown.setpoint_times == []
    texts = flown.texts
    assert "circnav: waits: 5 s in the air" in texts
    assert "circnav: waits: 5 m of height" in texts
    assert "5 m of height above the place of arming" in waits_for(flown.pilot, flown.now)


def test_least_height_of_mission_is_used() -> None:
    flown = from_ground("arducopter", "LOITER", STICK, "engage.min_height_m=12.0")
    while not flown.pilot.mission.begun:
        flown.fly(flown.now + 0.1)
        assert flown.now < 60.0, waits_for(flown.pilot, flown.now)
    assert -flown.vehicle.truth.down >= 11.8


def test_exit_action_below_least_height_is_land() -> None:
    """The copter sinks below half of the least height. RTL would climb, so the copter lands."""
    flown = flight(
        "arducopter", 'exit.action="rtl"', "engage.min_height_m=40.0", "sim.start.altitude_m=45.0"
    ).fly(15.0)
    assert flown.pilot.mission.phase is Phase.ENGAGED
    autopilot = flown.vehicle._flight.autopilot
    autopilot.body = autopilot.body._replace(down=-19.0)
    flown.fly(17.0)
    assert flown.outcome.ending is Ending.ABORTED
    assert "below half of engage.min_height_m" in flown.outcome.reason
    assert flown.vehicle.truth.mode == 9
