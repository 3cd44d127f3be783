"""What may be sent to a vehicle that nobody took: on the ground, over a slow link, after a stall, in a dry run."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.bounds import Bounds
from circnav_mav.pilot import Ending, OutputMode, Phase
from tests.rig import Rig, timing

GUIDED, LOITER = 4, 5
SET_MODE, SET_INTERVAL = 176, 511
IN_AIR = 2


def commanded(rig: Rig, since: float = -1.0) -> list:
    """Setpoints and mode requests."""
    return rig.setpoints(since) + rig.commands(SET_MODE, since)


# --- before the engagement ---

SLOW = "link too slow: round trip {} s (limits.round_trip_s = 0.6 s)"
ON_GROUND, UNTOLD = "the vehicle is on the ground", "the vehicle has not reported that it flies"
MEASURING = "measuring the round trip to the vehicle (TIMESYNC)"


@pytest.mark.parametrize("mode", [LOITER, 20, 0])
def test_no_setpoint_leaves_in_another_mode(rig, mode):
    assert rig.run(5.0, mode=mode).pilot.phase is Phase.READY
    assert rig.setpoints() == []
    assert rig.pilot.waits_for(rig.now) == "mode GUIDED: the operator must enter it"


@pytest.mark.parametrize(
    ("state", "seconds", "waits_for", "then"),
    [
        ({"armed": False}, 5.0, "the vehicle is not armed", {"armed": True}),
        # an armed copter in GUIDED on the ground would fight its own take-off: on ground, taking off, landing
        ({"landed_state": 1}, 4.0, ON_GROUND, {"landed_state": IN_AIR}),
        ({"landed_state": 3}, 4.0, ON_GROUND, {"landed_state": IN_AIR}),
        ({"landed_state": 4}, 4.0, ON_GROUND, {"landed_state": IN_AIR}),
        # one that never tells is given a moment and then believed; so is one that says MAV_LANDED_STATE_UNDEFINED, as
        # PX4 does until its land detector runs
        ({"landed_state": None}, 1.5, UNTOLD, {}),
        ({"landed_state": 0}, 1.5, UNTOLD, {}),
        ({"round_trip": None}, 9.0, MEASURING, {}),
        # a very slow link is not taken for one without answers
        ({"round_trip": 0.8}, 10.0, SLOW.format("0.80"), {"round_trip": 0.1}),
        ({"round_trip": 3.5}, 25.0, SLOW.format("3.50"), {"round_trip": 0.1}),
        ({"round_trip": 9.0}, 25.0, SLOW.format("9.00"), {"round_trip": 0.1}),
    ],
    ids=str,
)
@pytest.mark.parametrize("request_mode", [False, True], ids=["waits for the mode", "asks for the mode"])
def test_nothing_is_commanded_before_all_is_well_and_then_it_is(state, seconds, waits_for, then, request_mode):
    rig = Rig(request_mode=request_mode).run(seconds, mode=LOITER if request_mode else GUIDED, **state)
    assert (rig.pilot.phase, commanded(rig)) == (Phase.READY, [])
    assert rig.pilot.waits_for(rig.now) == waits_for
    assert commanded(rig.run(25.0 if seconds == 25.0 else 5.0, **then))


def test_after_a_lost_link_a_vehicle_that_does_not_say_whether_it_flies_is_flown_on_at_once(rig):
    assert rig.engage().run(5.0, speaks=False).pilot.phase is Phase.WAIT_LINK
    assert rig.run(1.0, speaks=True, landed_state=None).pilot.phase is Phase.ENGAGED


def denies(rig: Rig) -> None:
    """The vehicle answers every command of the newest step with MAV_RESULT_DENIED."""
    for number in {message.command for message in rig.of("COMMAND_LONG", rig.now - 0.01)}:
        rig.acknowledge(number, result=2)


def test_a_stream_that_was_denied_is_named_when_the_flight_cannot_begin():
    rig = Rig(timing=timing(wait_ranging=5.0))
    rig.run(8.0, lambda: denies(rig), ranges=False)
    assert rig.pilot.outcome.ending is Ending.NOTHING_HEARD
    assert "streams denied by the vehicle" in rig.pilot.outcome.reason
    assert "VFR_HUD" in rig.pilot.outcome.reason
    assert rig.setpoints() == []


def test_streams_that_the_vehicle_denies_are_asked_for_once(rig):
    """Also when no mode is ever requested, and for the whole flight."""
    since = rig.run(5.0, lambda: denies(rig)).now
    assert rig.run(20.0, lambda: denies(rig)).commands(SET_INTERVAL, since) == []


# --- after a stall ---


def test_after_a_stall_nothing_is_commanded_until_the_vehicle_is_heard_anew(rig):
    """Stopped for two seconds: what waited in the buffers is stale, the operator may have taken over meanwhile."""
    rig.engage().pass_time(2.0)
    rig.heartbeat()
    rig.range()
    before = rig.now - 0.01
    rig.step()
    assert rig.setpoints(before) == []
    assert rig.pilot.tracker.ranging.rejected["stalled"] == 1
    assert rig.run(0.5, speaks=False).setpoints(before) == []
    rig.heartbeat()
    assert rig.run(0.1).setpoints(before)


def test_a_gap_of_less_than_half_a_second_is_no_stall(rig):
    rig.engage().pass_time(0.45)
    before = rig.now - 0.01
    rig.range()
    rig.step()
    assert rig.setpoints(before)


# --- a dry run, and an end before the flight ---


def test_a_dry_run_computes_everything_and_commands_nothing():
    rig = Rig(output_mode=OutputMode.DRY_RUN, request_mode=True).run(5.0, mode=LOITER, armed=False)
    assert rig.pilot.phase is Phase.ENGAGED
    newest = rig.pilot.take_records()[-1]
    assert newest.turn_rate is not None and newest.yaw_rate_sent is None
    assert commanded(rig) == [] and rig.pilot.setpoints_sent == 0


def test_a_shadow_says_nothing_but_its_heartbeat_and_the_plot_values():
    rig = Rig(output_mode=OutputMode.SHADOW, request_mode=True).run(10.0)
    rig.pilot.interrupt(rig.now, "SIGINT")
    assert rig.run(1.0).pilot.done
    assert {message.get_type() for _, message in rig.sent} == {"HEARTBEAT", "NAMED_VALUE_FLOAT"}


def test_a_dry_run_is_not_flown_to_its_end():
    rig = Rig(timing=timing(duration=2.0), output_mode=OutputMode.DRY_RUN).run(5.0)
    assert (rig.pilot.outcome.ending, rig.pilot.outcome.reason) == (Ending.COMPLETED, "dry run to its end")
    assert rig.setpoints() == []


@pytest.mark.parametrize(
    ("output_mode", "mode"),
    [(OutputMode.DRY_RUN, GUIDED), (OutputMode.FLY, LOITER)],
    ids=["in a dry run", "before the flight"],
)
def test_an_interrupt_sends_no_setpoint_to_a_vehicle_that_was_not_engaged(output_mode, mode):
    rig = Rig(output_mode=output_mode).run(5.0, mode=mode)
    rig.pilot.interrupt(rig.now, "SIGINT")
    assert rig.run(1.0).pilot.done
    assert rig.setpoints() == [] and rig.pilot.last_words(rig.now) == b""


# --- the mission's own bounds, and another companion ---


def test_an_echo_of_our_own_frames_is_no_twin(rig):
    """Some routers send back what they get."""
    rig.engage().run(5.0, lambda: rig.pilot.receive(rig.raw[-1], rig.now, rig.source))
    assert rig.pilot.phase is Phase.ENGAGED


def test_our_own_hello_heard_back_is_no_other_companion():
    rig = Rig(ranging_apart=True)
    rig.run(20.0, lambda: rig.pilot.receive(rig.pilot.hello(rig.now), rig.now, rig.source))
    assert rig.pilot.session.ignored["twin"] == 0
    assert rig.pilot.session.ignored["echo"] >= 15


def battery(percent):
    return mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 100, percent, 0, 0, 0, 0, 0, 0)


def altitude(metres):
    return mavlink.MAVLink_vfr_hud_message(15, 15, 0, 50, metres, 0)


@pytest.mark.parametrize(
    ("bounds", "cm", "message", "reason"),
    [
        (Bounds(farthest=200.0), 25000, None, "range 250.0 m is farther than 200.0 m"),
        (Bounds(closest=80.0), 5000, None, "range 50.0 m is nearer than 80.0 m"),
        (Bounds(farthest=200.0), 19000, None, None),
        (Bounds(closest=80.0), 8500, None, None),
        (Bounds(battery=20.0), 15000, battery(19), "battery 19 % is below 20 %"),
        (Bounds(battery=20.0), 15000, battery(20), None),
        (Bounds(battery=20.0), 15000, battery(-1), None),  # not known
        (Bounds(highest=120.0), 15000, altitude(121.0), "altitude 121.0 m is above 120.0 m"),
        (Bounds(highest=120.0), 15000, altitude(119.0), None),
    ],
)
def test_what_lies_beyond_the_missions_bounds_ends_the_flight(bounds, cm, message, reason):
    rig = Rig(bounds=bounds).run(3.0, range_cm=cm)
    if message is not None:
        rig.hear(message)
    rig.run(1.0)
    assert (rig.pilot.outcome and rig.pilot.outcome.reason) == reason
