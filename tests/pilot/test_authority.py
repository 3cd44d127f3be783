"""What may be sent to a vehicle that nobody took: on the ground, over a slow link, after a stall, in a dry run."""

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.bounds import Bounds
from circnav_mav.pilot import Ending, OutputMode, Phase

GUIDED, LOITER = 4, 5
SET_MODE, SET_INTERVAL = 176, 511


# --- before the engagement ---


@pytest.mark.parametrize("state", [{"mode": 5}, {"mode": 20}, {"mode": 0}, {"armed": False}], ids=str)
def test_no_setpoint_leaves_when_disarmed_or_in_another_mode(rig, state):
    for name, value in state.items():
        setattr(rig, name, value)
    rig.run(5.0)
    assert rig.pilot.phase is Phase.READY
    assert rig.setpoints() == []


@pytest.mark.parametrize("request_mode", [True, False])
@pytest.mark.parametrize("landed_state", [1, 3, 4], ids=["on ground", "taking off", "landing"])
def test_a_vehicle_that_does_not_fly_yet_is_neither_steered_nor_asked(make_rig, landed_state, request_mode):
    """An armed copter in GUIDED on the ground would fight its own take-off."""
    rig = make_rig(request_mode=request_mode)
    rig.landed_state, rig.mode = landed_state, LOITER if request_mode else GUIDED
    rig.run(4.0)
    assert (rig.setpoints(), rig.commands(SET_MODE)) == ([], [])
    rig.landed_state = 2
    rig.run(1.0)
    assert rig.commands(SET_MODE) if request_mode else rig.setpoints()


@pytest.mark.parametrize("landed_state", [None, 0], ids=["never tells", "does not know yet"])
def test_a_vehicle_that_does_not_tell_whether_it_flies_is_given_a_moment_and_then_believed(make_rig, landed_state):
    """MAV_LANDED_STATE_UNDEFINED, which PX4 says until its land detector runs, is as good as nothing."""
    rig = make_rig()
    rig.landed_state = landed_state
    rig.run(1.5)
    assert rig.setpoints() == []
    rig.run(0.5)
    assert rig.setpoints() != []


def test_after_a_lost_link_a_vehicle_that_does_not_say_whether_it_flies_is_flown_on_at_once(make_rig):
    rig = make_rig().engage()
    rig.speaks = False
    rig.run(5.0)
    assert rig.pilot.phase is Phase.WAIT_LINK
    rig.speaks, rig.landed_state = True, None
    rig.run(1.0)
    assert rig.pilot.phase is Phase.ENGAGED


@pytest.mark.parametrize("request_mode", [False, True])
def test_a_vehicle_at_the_end_of_a_slow_link_is_not_engaged_until_it_is_quick(make_rig, request_mode):
    rig = make_rig(request_mode=request_mode)
    rig.round_trip, rig.mode = 0.8, LOITER if request_mode else rig.mode
    rig.run(10.0)
    assert rig.pilot.phase is Phase.READY
    assert rig.setpoints() == [] and rig.commands(176) == []
    words = rig.pilot.waits_for(rig.now)
    assert words == "link too slow: round trip 0.80 s (limits.round_trip_s = 0.6 s)"
    rig.round_trip = 0.1
    rig.run(10.0)
    assert (rig.commands(176) if request_mode else rig.setpoints()) != []


@pytest.mark.parametrize("trip", [3.5, 9.0])
def test_a_very_slow_link_is_not_taken_for_one_without_answers(rig, trip):
    rig.round_trip = trip
    rig.run(40.0)
    assert rig.pilot.phase is Phase.READY and rig.setpoints() == []


def test_a_vehicle_that_does_not_answer_is_engaged_after_a_while(rig):
    rig.round_trip = None
    rig.run(9.0)
    assert rig.pilot.phase is Phase.READY
    assert "TIMESYNC" in rig.pilot.waits_for(rig.now)
    rig.run(3.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_a_stream_that_was_denied_is_named_when_the_flight_cannot_begin(make_rig):
    rig = make_rig()
    rig.ranges = False
    for _ in range(1000):
        rig.run(0.05)
        for number in list(rig.pilot.session.commands._pending):
            rig.acknowledge(number, 2)  # MAV_RESULT_DENIED
    assert rig.pilot.outcome.ending is Ending.NOTHING_HEARD
    assert "streams denied by the vehicle" in rig.pilot.outcome.reason
    assert "VFR_HUD" in rig.pilot.outcome.reason
    assert rig.setpoints() == []


def test_streams_that_the_vehicle_denies_are_asked_for_once(rig):
    """Also when no mode is ever requested, and for the whole flight."""
    deny_commands(rig, 5.0)
    since = rig.now
    deny_commands(rig, 30.0)
    assert rig.commands(SET_INTERVAL, since) == []


def deny_commands(rig, seconds):
    for _ in range(round(seconds / 0.05)):
        rig.run(0.05)
        for number in {message.command for message in rig.of("COMMAND_LONG", rig.now - 0.01)}:
            rig.acknowledge(number, result=2)


# --- after a stall ---


def test_after_a_stall_nothing_is_commanded_until_the_vehicle_is_heard_anew(rig):
    """Stopped for two seconds: what waited in the buffers is stale, the operator may have taken over meanwhile."""
    rig.engage()
    rig.pass_time(2.0)
    rig.heartbeat()
    rig.range()
    before = rig.now - 0.01
    rig.step()
    assert rig.setpoints(before) == []
    assert rig.pilot.tracker.ranging.rejected["stalled"] == 1
    rig.speaks = False
    rig.run(0.5)
    assert rig.setpoints(before) == []
    rig.heartbeat()
    rig.run(0.1)
    assert rig.setpoints(before)


def test_a_gap_of_less_than_half_a_second_is_no_stall(rig):
    rig.engage()
    rig.pass_time(0.45)
    before = rig.now - 0.01
    rig.range()
    rig.step()
    assert rig.setpoints(before)


# --- a dry run ---


def test_a_dry_run_computes_everything_and_commands_nothing(make_rig):
    rig = make_rig(output_mode=OutputMode.DRY_RUN, request_mode=True)
    rig.mode, rig.armed = LOITER, False
    rig.run(5.0)
    assert rig.pilot.phase is Phase.ENGAGED
    records = rig.pilot.take_records()
    assert records[-1].turn_rate is not None
    assert records[-1].yaw_rate_sent is None
    assert rig.setpoints() == []
    assert rig.commands(SET_MODE) == []
    assert rig.pilot.setpoints_sent == 0


def test_a_shadow_says_nothing_but_its_heartbeat_and_the_plot_values(make_rig):
    rig = make_rig(output_mode=OutputMode.SHADOW, request_mode=True)
    rig.run(10.0)
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    assert {message.get_type() for _, message in rig.sent} == {"HEARTBEAT", "NAMED_VALUE_FLOAT"}
    assert rig.pilot.done


def test_a_dry_run_is_not_flown_to_its_end(make_rig, say):
    rig = make_rig(timing=replace(say.mission.timing, duration=2.0), output_mode=OutputMode.DRY_RUN).run(5.0)
    assert (rig.pilot.outcome.ending, rig.pilot.outcome.reason) == (Ending.COMPLETED, "dry run to its end")
    assert rig.setpoints() == []


# --- the mission's own bounds, and another companion ---


def test_an_echo_of_our_own_frames_is_no_twin(rig):
    """Some routers send back what they get."""
    rig.engage()
    for _ in range(100):
        rig.run(0.05)
        rig.pilot.receive(rig.raw[-1], rig.now, rig.source)
    assert rig.pilot.phase is Phase.ENGAGED


def test_our_own_hello_heard_back_is_no_other_companion(make_rig):
    rig = make_rig(ranging_apart=True)
    for _ in range(400):
        rig.run(0.05)
        hello = rig.pilot.hello(rig.now)
        if hello:
            rig.pilot.receive(hello, rig.now, rig.source)
    assert rig.pilot.session.ignored["twin"] == 0
    assert rig.pilot.session.ignored["echo"] >= 15


@pytest.mark.parametrize(
    ("bounds", "cm", "reason"),
    [
        ({"farthest": 200.0}, 25000, "range 250.0 m is farther than 200.0 m"),
        ({"closest": 80.0}, 5000, "range 50.0 m is nearer than 80.0 m"),
        ({"farthest": 200.0}, 19000, None),
        ({"closest": 80.0}, 8500, None),
    ],
)
def test_a_range_beyond_the_missions_bounds_ends_the_flight(make_rig, bounds, cm, reason):
    rig = make_rig(bounds=Bounds(**bounds))
    rig.range_cm = cm
    rig.run(3.0)
    assert (rig.pilot.outcome and rig.pilot.outcome.reason) == reason


@pytest.mark.parametrize(("percent", "reason"), [(19, "battery 19 % is below 20 %"), (20, None), (-1, None)])
def test_an_empty_battery_ends_the_flight_and_an_unknown_one_does_not(make_rig, percent, reason):
    rig = make_rig(bounds=Bounds(battery=20.0)).engage()
    rig.hear(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 100, percent, 0, 0, 0, 0, 0, 0))
    rig.run(1.0)
    assert (rig.pilot.outcome and rig.pilot.outcome.reason) == reason


@pytest.mark.parametrize(("altitude", "reason"), [(121.0, "altitude 121.0 m is above 120.0 m"), (119.0, None)])
def test_a_height_beyond_the_missions_bounds_ends_the_flight(make_rig, altitude, reason):
    rig = make_rig(bounds=Bounds(highest=120.0)).engage()
    rig.hear(mavlink.MAVLink_vfr_hud_message(15, 15, 0, 50, altitude, 0))
    rig.run(1.0)
    assert (rig.pilot.outcome and rig.pilot.outcome.reason) == reason


def test_a_dry_run_that_is_interrupted_sends_no_setpoint_either(make_rig):
    rig = make_rig(output_mode=OutputMode.DRY_RUN)
    rig.run(5.0)
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    assert rig.pilot.done
    assert rig.setpoints() == []
    assert rig.pilot.last_words(rig.now) == b""


def test_an_interrupt_before_the_flight_sends_no_setpoint(rig):
    rig.mode = 5
    rig.run(3.0)
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(1.0)
    assert rig.pilot.done
    assert rig.setpoints() == []
