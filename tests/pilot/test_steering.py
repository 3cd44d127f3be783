"""When a pilot steers and when it must not: fresh ranges, phases, holding, stalls, outages. No I/O, no clock."""

from dataclasses import replace
from itertools import pairwise
from math import nan

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import Direction, TurnCommand, TurnRate
from circnav_mav.pilot import RANGING, Ending, OutputMode
from circnav_mav.pilot.mission_state import Phase

LOITER = 5
STEADY = 15.0 / 100.0
"""V/r_d of the bench's mission, rad/s."""


# --- the way to the first setpoint ---


def test_a_mission_waits_for_link_ranging_and_mode_in_this_order(rig):
    rig.speaks = rig.ranges = False
    rig.mode = 5
    assert rig.run(1.0).pilot.phase is Phase.WAIT_LINK
    rig.speaks = True
    assert rig.run(1.0).pilot.phase is Phase.WAIT_RANGING
    rig.ranges = True
    assert rig.run(1.0).pilot.phase is Phase.READY
    rig.mode = 4
    assert rig.run(1.0).pilot.phase is Phase.ENGAGED
    assert rig.setpoints()


def test_no_setpoint_leaves_in_any_waiting_phase(rig):
    rig.speaks = rig.ranges = False
    rig.mode = 5
    rig.run(1.0)
    rig.speaks = True
    rig.run(1.0)
    rig.ranges = True
    rig.run(3.0)
    assert rig.setpoints() == []
    assert rig.pilot.setpoints_sent == 0


@pytest.mark.parametrize("state", [{"mode": 5}, {"mode": 20}, {"mode": 0}, {"armed": False}], ids=str)
def test_no_setpoint_leaves_when_disarmed_or_in_another_mode(rig, state):
    for name, value in state.items():
        setattr(rig, name, value)
    rig.run(5.0)
    assert rig.pilot.phase is Phase.READY
    assert rig.setpoints() == []


def test_ranging_alone_never_starts_a_flight(rig):
    rig.speaks = False
    rig.run(5.0)
    assert rig.pilot.phase is Phase.WAIT_LINK
    assert rig.setpoints() == []


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


def test_a_link_that_gets_slower_in_flight_than_ranges_may_be_old_is_a_lost_range(make_rig):
    """Stamps cannot show a constant delay; answers to TIMESYNC do."""
    rig = make_rig(exit="rtl").engage()
    rig.round_trip = 2.0
    rig.run(6.0)
    assert rig.pilot.session.round_trip.typical == pytest.approx(2.0)
    assert rig.pilot.phase is Phase.HOLDING
    rig.run(10.0)
    assert rig.pilot.outcome.reason.startswith("no range for")


def test_a_link_that_gets_slow_within_what_ranges_may_be_old_is_no_reason_to_let_the_vehicle_go(make_rig, say):
    ranging = replace(say.mission.ranging, max_age=1.5)
    rig = make_rig(ranging=ranging, timing=replace(say.mission.timing, stale=1.5)).engage()
    rig.round_trip = 2.0
    rig.run(20.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_the_delay_of_the_vehicles_link_is_not_that_of_a_radio_with_a_link_of_its_own(make_rig, say):
    rig = make_rig(ranging_apart=True)
    rig.ranges = False
    for _ in range(400):
        rig.run(0.05)
        if rig.tick % 2 == 0:
            rig.hear(say.distance(15000, 1_000_000 + round(rig.now * 1000)), link=RANGING)
        rig.round_trip = 2.0 if rig.pilot.engaged_at is not None else 0.0
    assert rig.pilot.session.round_trip.typical == pytest.approx(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_a_vehicle_that_does_not_answer_is_engaged_after_a_while(rig):
    rig.round_trip = None
    rig.run(9.0)
    assert rig.pilot.phase is Phase.READY
    assert "TIMESYNC" in rig.pilot.waits_for(rig.now)
    rig.run(3.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_the_first_setpoint_waits_for_five_ranges(rig):
    rig.ranges = False
    rig.run(1.0)
    for count in range(1, 6):
        rig.range()
        rig.run(0.1)
        assert bool(rig.setpoints()) == (count == 5)


# --- the answer to a range ---


def test_a_fresh_range_is_answered_by_the_very_next_step(rig):
    rig.engage()
    rig.now += 0.031
    assert rig.step() == [], "nothing new and no tick due"
    rig.range()
    (setpoint,) = [message for message in rig.step() if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert setpoint.time_boot_ms == round(rig.now * 1000)
    assert rig.step() == [], "one range, one answer"


def test_between_ranges_the_prediction_is_flown_at_the_tick(rig):
    rig.engage()
    before = rig.now
    rig.run(1.0)
    assert len(rig.setpoints(before)) == 20


@pytest.mark.parametrize(("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)])
def test_outside_the_circle_at_a_constant_range_the_vehicle_turns_towards_the_circle(make_rig, say, direction, sign):
    """A constant range outside means flying across: clockwise is to the right, positive in MAVLink."""
    rig = make_rig(orbit=replace(say.orbit, direction=direction)).engage()
    setpoint = rig.setpoints()[-1]
    assert setpoint.yaw_rate * sign > 0
    assert setpoint.vx == 15.0
    assert (setpoint.vy, setpoint.vz) == (0.0, 0.0)


def test_inside_the_circle_the_vehicle_flies_straight(rig):
    rig.range_cm = 5000
    rig.engage()
    assert {message.yaw_rate for message in rig.setpoints()} == {0.0}


def test_no_setpoint_asks_for_more_than_the_vehicles_limit(rig):
    """Law 1 is unsaturated: at 600 m and closing it asks for much more than 0.35 rad/s."""
    rig.range_cm = 59000
    rig.engage()
    assert max(abs(message.yaw_rate) for message in rig.setpoints()) == pytest.approx(0.35)
    assert rig.pilot.take_records()[-1].saturated


def test_the_missions_slew_limit_holds_for_what_is_sent(make_rig):
    rig = make_rig(max_yaw_acceleration=0.1).engage()
    rig.ranges = False
    rig.run(2.0)
    rates = [(then, m.yaw_rate) for then, m in rig.sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    steps = [(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(rates)]
    assert all(abs(change) <= 0.1 * wait + 1e-6 for change, wait in steps)
    assert any(abs(change) > 0.09 * wait > 0 for change, wait in steps), "the limit was never met: nothing was tested"


@pytest.mark.parametrize(
    ("message", "count"),
    [
        (mavlink.MAVLink_global_position_int_message(1, 473_000_000, 85_000_000, 0, 0, 1500, 0, 0, 0), 3),
        (mavlink.MAVLink_gps_raw_int_message(1, 3, 473_000_000, 85_000_000, 0, 1, 1, 1500, 0, 9), 3),
        (mavlink.MAVLink_local_position_ned_message(1, 1e4, -1e4, -30, 15, 0, 0), 3),
        (mavlink.MAVLink_gps_global_origin_message(473_000_000, 85_000_000, 0), 1),
        (mavlink.MAVLink_home_position_message(473_000_000, 85_000_000, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0), 1),
        (mavlink.MAVLink_position_target_local_ned_message(1, 8, 0x407, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 1), 3),
        (
            mavlink.MAVLink_odometry_message(
                1, 1, 8, 1e4, 1e4, -30, [1, 0, 0, 0], 15, 0, 0, 0, 0, 0.3, [0.0] * 21, [0.0] * 21
            ),
            3,
        ),
        (mavlink.MAVLink_gps2_raw_message(1, 3, 473_000_000, 85_000_000, 0, 1, 1, 1500, 0, 9, 0, 0), 3),
        (mavlink.MAVLink_sim_state_message(1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 47.3, 8.5, 500, 0, 0, 15, 0, 0), 3),
    ],
    ids=lambda value: value.get_type() if hasattr(value, "get_type") else "",
)
def test_false_positions_change_no_byte_of_the_output(make_rig, message, count):
    """The UAV is GPS-denied: nothing about position may reach the guidance."""
    honest, lied_to = make_rig(), make_rig()
    for _ in range(60):
        honest.run(0.05)
        lied_to.run(0.05)
        for _ in range(count):
            lied_to.pilot.receive(lied_to.vehicle.say(message), lied_to.now, lied_to.source)
    assert honest.pilot.phase is Phase.ENGAGED
    assert lied_to.raw == honest.raw


# --- ranges stop ---


def test_without_fresh_ranges_the_prediction_is_flown_for_half_a_second_and_then_the_steady_turn(rig):
    rig.engage()
    rig.ranges = False
    last = rig.now
    rig.run(0.45)
    assert rig.pilot.phase is Phase.ENGAGED
    rig.run(0.15)
    assert rig.pilot.phase is Phase.HOLDING
    since = rig.now
    rig.run(2.0)
    assert rig.setpoints(since)
    assert {round(message.yaw_rate, 6) for message in rig.setpoints(since)} == {STEADY}
    assert "circnav: range lost, holding" in rig.texts(last)


@pytest.mark.parametrize(("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)])
def test_holding_turns_in_the_missions_sense(make_rig, say, direction, sign):
    rig = make_rig(orbit=replace(say.orbit, direction=direction)).engage()
    rig.ranges = False
    rig.run(1.0)
    assert rig.setpoints()[-1].yaw_rate == pytest.approx(sign * STEADY)


def test_holding_is_given_up_with_the_safe_setpoint_three_times_and_then_silence(rig):
    rig.engage()
    rig.ranges = False
    rig.run(10.3)
    assert rig.pilot.phase is Phase.HOLDING
    since = rig.now
    rig.run(1.0)
    assert rig.pilot.done
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert rig.pilot.outcome.reason.startswith("no range for 10")
    last = rig.setpoints(since)[-3:]
    assert [(message.vx, message.yaw_rate) for message in last] == [(0.0, 0.0)] * 3
    quiet = len(rig.sent)
    rig.run(5.0)
    assert len(rig.sent) == quiet


def test_a_range_that_comes_back_is_flown_again_and_told(rig):
    rig.engage()
    rig.ranges = False
    rig.run(3.0)
    rig.ranges = True
    before = rig.now
    rig.run(3.0)
    assert rig.pilot.phase is Phase.ENGAGED
    assert "circnav: range regained" in rig.texts(before)


def test_a_repeated_range_is_not_a_fresh_one(rig):
    """The same stamp again and again: stale after half a second."""
    rig.engage()
    rig.ranges = False
    for _ in range(20):
        rig.run(0.05)
        rig.hear(rig_range(rig, 15000, stamp_ms=1_003_000))
    assert rig.pilot.phase is Phase.HOLDING


def rig_range(rig, cm, stamp_ms):
    return mavlink.MAVLink_distance_sensor_message(stamp_ms, 20, 60000, cm, 4, 0, 24, 0)


@pytest.mark.parametrize("cm", [0, 65535, 60000])
def test_a_range_that_is_none_is_not_a_fresh_one(rig, cm):
    rig.engage()
    rig.ranges = False
    for _ in range(20):
        rig.run(0.05)
        rig.hear(rig_range(rig, cm, stamp_ms=1_000_000 + round(rig.now * 1000)))
    assert rig.pilot.phase is Phase.HOLDING
    assert rig.pilot.tracker.ranging.rejected["no_range"] == 20


def test_an_outlier_is_counted_and_moves_nothing(make_rig):
    steady, disturbed = make_rig().engage(), make_rig().engage()
    steady.ranges = disturbed.ranges = False
    disturbed.now = steady.now = round(steady.now + 0.02, 6)
    disturbed.hear(rig_range(disturbed, 40000, stamp_ms=1_000_000 + round(disturbed.now * 1000)))
    steady.run(0.3)
    disturbed.run(0.3)
    assert disturbed.pilot.tracker.ranging.rejected["gated"] == 1
    assert disturbed.pilot.tracker.accepted == steady.pilot.tracker.accepted
    rates = [[m.yaw_rate for m in rig.setpoints(3.02)] for rig in (steady, disturbed)]
    assert rates[0] == pytest.approx(rates[1], abs=2e-3)


def test_a_jump_of_the_sensors_clock_starts_the_estimate_anew(rig):
    rig.engage()
    rig.ranges = False
    for i in range(30):
        rig.run(0.1)
        rig.hear(rig_range(rig, 15000, stamp_ms=5_000 + 100 * i))
    assert rig.pilot.tracker.ranging.rejected["stamp_jump"] == 2
    assert rig.pilot.phase is Phase.ENGAGED


# --- the loop stalls ---


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


def test_a_takeover_that_waited_in_the_buffers_through_a_stall_is_obeyed_first(rig):
    rig.engage()
    rig.pass_time(2.0)
    rig.mode = 5
    rig.heartbeat()
    before = rig.now - 0.01
    rig.step()
    rig.run(3.0)
    assert rig.setpoints(before) == []
    assert rig.pilot.outcome.ending is Ending.ABORTED


# --- the vehicle's link ---


def test_a_lost_link_is_silence_and_a_found_one_resumes(rig):
    """Three seconds without a heartbeat; the ranges go on."""
    rig.engage()
    rig.speaks = False
    lost = rig.now
    rig.run(3.3)
    assert rig.pilot.phase is Phase.WAIT_LINK
    quiet = rig.now
    rig.run(5.0)
    assert rig.setpoints(quiet) == []
    assert rig.setpoints(lost), "until then the vehicle was flown on"
    rig.speaks = True
    rig.run(1.0)
    assert rig.pilot.phase is Phase.ENGAGED
    assert rig.setpoints(quiet)


def test_a_link_that_stays_away_ends_the_mission_after_a_minute(rig):
    rig.engage()
    rig.speaks = False
    rig.run(62.9)
    assert not rig.pilot.done
    rig.run(1.0)
    assert rig.pilot.done
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert rig.pilot.outcome.reason == "no vehicle or no ranging for 60 s"


@pytest.mark.parametrize(("comes_back", "what"), [(False, "heartbeat"), (True, "range")])
def test_time_that_runs_out_in_a_silence_says_in_which_and_for_how_long(make_rig, say, comes_back, what):
    rig = make_rig(timing=replace(say.mission.timing, duration=10.0)).engage()
    silent_since = rig.now
    rig.speaks = rig.ranges = False
    rig.run(4.0)
    rig.speaks = comes_back
    while not rig.pilot.done:
        rig.run(0.05)
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert rig.pilot.outcome.reason.endswith(f", no {what} for {rig.now - silent_since:.0f} s")


# --- the end ---


def test_a_dry_run_is_not_flown_to_its_end(make_rig, say):
    rig = make_rig(timing=replace(say.mission.timing, duration=2.0), output_mode=OutputMode.DRY_RUN).run(5.0)
    assert (rig.pilot.outcome.ending, rig.pilot.outcome.reason) == (Ending.COMPLETED, "dry run to its end")
    assert rig.setpoints() == []


def test_a_mission_ends_after_its_duration_with_the_safe_setpoint_three_times(make_rig, say):
    rig = make_rig(timing=replace(say.mission.timing, duration=5.0)).engage()
    started = rig.pilot.engaged_at
    rig.run(4.0)
    assert rig.pilot.outcome.ending is Ending.COMPLETED
    assert rig.pilot.done
    ends = [(then, m) for then, m in rig.sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and m.vx == 0]
    assert len(ends) == 3
    assert ends[0][0] == pytest.approx(started + 5.0, abs=0.051)


def test_an_interrupt_sends_the_safe_setpoint_three_times_and_then_nothing(rig):
    rig.engage()
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    assert [(m.vx, m.yaw_rate) for m in rig.setpoints(since)] == [(0.0, 0.0)] * 3
    assert rig.sent[-1][0] < since + 0.2
    assert rig.pilot.done
    assert (rig.pilot.outcome.ending, rig.pilot.outcome.reason) == (Ending.INTERRUPTED, "SIGINT")
    assert rig.pilot.step(rig.now + 1) == b""


def test_an_interrupt_is_answered_by_the_very_next_step(rig):
    """However lately a setpoint has left."""
    rig.engage()
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.now += 0.001
    rig.step()
    assert [message.vx for message in rig.setpoints(since)] == [0.0]


def test_an_interrupt_before_the_flight_sends_no_setpoint(rig):
    rig.mode = 5
    rig.run(3.0)
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(1.0)
    assert rig.pilot.done
    assert rig.setpoints() == []


def test_an_interrupt_leaves_a_vehicle_alone_that_is_no_longer_ours(rig):
    rig.engage()
    since = rig.now
    rig.mode = 5
    rig.heartbeat()
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    assert rig.setpoints(since) == []
    assert rig.pilot.done


def test_at_the_end_the_vehicle_gets_its_stream_rates_back(rig):
    rig.engage()
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    given = {message.param1 for message in rig.commands(511, since) if message.param2 == 0}
    assert given == set(rig.pilot.session.streams.rates)


def test_the_last_words_are_one_safe_setpoint_and_only_while_it_is_ours_to_fly(rig, say):
    rig.run(0.3)
    assert rig.pilot.last_words(rig.now) == b""
    rig.engage()
    (message,) = say.decode(rig.pilot.last_words(rig.now))
    assert (message.vx, message.yaw_rate, message.type_mask) == (0.0, 0.0, 0x407)


# --- what may never leave ---


def test_a_law_that_fails_is_held_back_and_ends_the_flight_safely(rig, monkeypatch):
    rig.engage()
    nonsense = TurnCommand(TurnRate(nan), TurnRate(nan), saturated=False)
    monkeypatch.setattr(rig.pilot.controller, "_steer", lambda *arguments: nonsense)
    since = rig.now
    rig.run(1.0)
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert "unsafe setpoint held back" in rig.pilot.outcome.reason
    assert [(m.vx, m.yaw_rate) for m in rig.setpoints(since)] == [(0.0, 0.0)] * 3


# --- ranging on a link of its own ---


def test_ranging_of_another_link_is_taken_from_there_and_from_nowhere_else(make_rig):
    rig = make_rig(ranging_apart=True)
    rig.run(3.0)
    assert rig.pilot.tracker.accepted == 0, "ranges on the vehicle's link are not the mission's"
    rig.ranges = False
    for _ in range(30):
        rig.run(0.1)
        rig.hear(rig_range(rig, 15000, 1_000_000 + round(rig.now * 1000)), link="ranging", source="radio")
    assert rig.pilot.phase is Phase.ENGAGED


def test_a_vehicle_on_the_ranging_link_moves_nothing(make_rig, say):
    rig = make_rig(ranging_apart=True)
    rig.speaks = rig.ranges = False
    for _ in range(20):
        rig.run(0.1)
        rig.hear(say.heartbeat(4), link="ranging", source="radio")
    assert rig.pilot.phase is Phase.WAIT_LINK


def test_a_ranging_link_is_greeted_once_a_second(make_rig, say):
    rig = make_rig(ranging_apart=True)
    hellos = [message for i in range(61) for message in say.decode(rig.pilot.hello(i / 20))]
    assert [message.get_type() for message in hellos] == ["HEARTBEAT"] * 4


# --- nothing heard ---


def test_without_a_vehicle_the_mission_ends_and_says_what_was_heard(make_rig, say):
    rig = make_rig(timing=replace(say.mission.timing, wait_link=2.0))
    rig.speaks = rig.ranges = False
    rig.run(1.0)
    rig.pilot.receive(b"junk", rig.now, "somebody")
    rig.run(1.5)
    assert rig.pilot.outcome.ending is Ending.NOTHING_HEARD
    assert rig.pilot.outcome.reason == (
        "no vehicle: no autopilot heartbeat, heard 4 bytes, 0 frames, 1 CRC or framing errors, "
        "system/component ids: none, MAVLink version: none"
    )


def test_without_ranging_the_mission_ends_and_says_what_was_refused(make_rig, say):
    rig = make_rig(timing=replace(say.mission.timing, wait_ranging=2.0))
    rig.range_cm = 65535
    rig.run(3.0)
    assert rig.pilot.outcome.ending is Ending.NOTHING_HEARD
    assert rig.pilot.outcome.reason.startswith("no ranging: no usable DISTANCE_SENSOR, rejected: ")
    assert " no_range; heard " in rig.pilot.outcome.reason


def test_a_vehicle_that_does_not_fit_is_the_reason_given(make_rig, say):
    rig = make_rig(timing=replace(say.mission.timing, wait_link=2.0))
    rig.speaks = False
    rig.hear(say.heartbeat(autopilot=12))
    rig.run(3.0)
    assert rig.pilot.outcome.reason == ("no vehicle: system 1 is px4 quadrotor, the mission is for ardupilot copter")


# --- a new engagement is a new stream ---


def test_the_first_setpoint_after_a_takeover_is_not_slewed_from_the_last_one_before_it(make_rig):
    """0.05 rad/s^2 over the 2 s that the operator had it would leave 0.25 rad/s of the turn that was flown before."""
    rig = make_rig(end_on_takeover=False, max_yaw_acceleration=0.05)
    rig.range_cm = 59000
    rig.engage()
    assert rig.setpoints()[-1].yaw_rate == pytest.approx(0.35)
    rig.mode, rig.range_cm = LOITER, 5000
    rig.run(1.0)
    since = rig.now
    rig.mode = 4
    rig.run(2.0)
    assert rig.setpoints(since)[0].yaw_rate == 0.0, "inside the circle it is straight on"
