"""Edges of a flight: modes that an operator or a failsafe has chosen, a moved home, a missing
landed state, quadplanes, a landing during an outage."""

import pytest

from circnav_mav.pilot import Phase
from circnav_mav.pilot.status_text import waits_for
from tests.flight.lockstep import Flight, decode, flight, message_ids
from tests.flight.test_from_ground import STICK, from_ground

LATE_RANGES = '{at_s=0.0,action="mute_ranging"}', '{at_s=12.0,action="unmute_ranging"}'
LANDING_ITEM = '{at_s=1.0,action="waypoint",value=5}'
SET_MODE = 176
LANDED_STATE = 245


def events(*lines: str) -> str:
    return f"sim.events=[{','.join(lines)}]"


def mode_requests(flown: Flight) -> list[float]:
    """Return the times at which circnav requested a mode."""
    sent = [(time, message) for time, data in flown.sent for message in decode(data)]
    return [time for time, one in sent if getattr(one, "command", None) == SET_MODE]


def engaged(flown: Flight, until: float = 40.0) -> Flight:
    """Fly until circnav steers the vehicle."""
    while not flown.pilot.mission.begun:
        flown.fly(flown.now + 0.1)
        assert flown.now < until, waits_for(flown.pilot, flown.now)
    return flown


def scripted(flown: Flight, action: str, value: float | None = None) -> None:
    """Run an event of the emulator now."""
    config = flown.vehicle.config
    event = type(config).model_validate({"events": [{"action": action, "value": value}]}).events[0]
    flown.vehicle._run_event(event)


@pytest.mark.parametrize(
    ("mission", "mode"),
    [
        ("arducopter", "RTL"),
        ("arducopter", "AVOID_ADSB"),
        ("arduplane", "RTL"),
        ("arduplane", "AUTO"),
        ("ardurover", "RTL"),
        ("px4_copter", "RTL"),
    ],
)
def test_mode_chosen_by_failsafe_is_not_replaced(mission: str, mode: str) -> None:
    """The mode begins while circnav waits for ranges. In AUTO, the plane is on its landing
    approach."""
    enter = f'{{at_s=8.0,action="mode",mode="{mode}"}}'
    high = () if mission == "ardurover" else ("sim.start.altitude_m=60.0",)
    flown = flight(mission, events(*LATE_RANGES, LANDING_ITEM, enter), *high, law="auto").fly(18.0)
    assert flown.pilot.mission.phase is Phase.READY
    assert waits_for(flown.pilot, flown.now).startswith("circnav does not end the mode")
    assert mode in waits_for(flown.pilot, flown.now)
    assert (mode_requests(flown), flown.setpoint_times) == ([], [])


@pytest.mark.parametrize(("mission", "rise"), [("arducopter", None), ("arduplane", 50.0)])
def test_home_moved_in_flight_keeps_circle_and_bounds(mission: str, rise: float | None) -> None:
    flown = flight(mission, law="auto")
    altitude = flown.vehicle._flight._altitude
    flown = flight(
        mission,
        f"bounds.min_altitude_m={altitude - 8}",
        f"bounds.max_altitude_m={altitude + 8}",
        law="auto",
    )
    engaged(flown).fly(25.0)
    scripted(flown, "set_home", rise)
    flown.fly(32.0)
    assert flown.pilot.mission.phase is Phase.ENGAGED
    assert not flown.pilot.conditions.alarms


def test_lowered_home_does_not_permit_engagement_of_low_copter() -> None:
    low = '{at_s=7.2,action="throttle",value=0.5}', '{at_s=9.0,action="set_home",value=-100.0}'
    flown = from_ground("arducopter", "LOITER", (*STICK[:2], *low)).fly(25.0)
    assert 3.0 < -flown.vehicle.truth.down < 4.0
    assert (mode_requests(flown), flown.setpoint_times) == ([], [])


@pytest.mark.parametrize("state", [1, 2, 3])
def test_quadplane_is_engaged_only_in_forward_flight(state: int) -> None:
    """The quadplane is in a transition or in hover (MAV_VTOL_STATE), then flies on its wing."""
    script = f'{{at_s=0.0,action="vtol",value={state}}}', '{at_s=12.0,action="vtol",value=4}'
    flown = flight("arduplane", events(*script), law="auto").fly(11.5)
    assert (mode_requests(flown), flown.setpoint_times) == ([], [])
    assert "quadplane" in waits_for(flown.pilot, flown.now)
    assert engaged(flown).now < 16.0


def test_old_landed_state_does_not_prevent_engagement() -> None:
    """The newest landed state says that the copter is on the ground. Then the stream of this state
    stops, and the copter takes off."""
    later = '{at_s=8.0,action="arm"}', '{at_s=9.0,action="throttle",value=0.9}', STICK[2]
    flown = from_ground("arducopter", "LOITER", later)
    flown.hears = lambda frame, now: now < 6.0 or message_ids(frame) != [LANDED_STATE]
    assert engaged(flown).now < 26.0
    assert -flown.vehicle.truth.down > 4.8


def test_copter_without_evidence_of_flight_gets_no_setpoint() -> None:
    """The copter stands armed on the ground, reports no landed state, and no height is required."""
    flown = from_ground("arducopter_nogps", "ALT_HOLD", STICK[:1], "engage.min_height_m=0.0")
    flown.hears = lambda frame, now: message_ids(frame) != [LANDED_STATE]
    flown.fly(20.0)
    assert (mode_requests(flown), flown.setpoint_times) == ([], [])
    assert "no landed state" in waits_for(flown.pilot, flown.now)


def test_copter_that_landed_during_lost_link_stays_unsteered() -> None:
    """Meanwhile the operator has armed it again, in GUIDED_NOGPS."""
    flown = engaged(flight("arducopter_nogps", law="auto")).fly(25.0)
    autopilot = flown.vehicle._flight.autopilot
    scripted(flown, "mute_autopilot")
    flown.fly(30.0)
    autopilot.body = autopilot.body._replace(down=0.0, velocity_north=0.0, velocity_east=0.0)
    scripted(flown, "disarm")
    flown.fly(35.0)
    scripted(flown, "arm")
    scripted(flown, "unmute_autopilot")
    flown.fly(45.0)
    assert autopilot.armed and autopilot.mode == 20
    assert [time for time in flown.setpoint_times if time > 35.0] == []
    assert [time for time in mode_requests(flown) if time > 35.0] == []


def test_flight_ends_as_disarmed_when_motors_are_stopped() -> None:
    """ArduCopter reports ON_GROUND before the heartbeat reports that it is disarmed."""
    flown = engaged(flight("arducopter", law="auto")).fly(20.0)
    scripted(flown, "disarm")
    flown.fly(25.0)
    assert "vehicle disarmed" in flown.outcome.reason
    assert [time for time in mode_requests(flown) if time > 20.0] == []
