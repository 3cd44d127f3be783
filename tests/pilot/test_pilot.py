"""When a pilot steers and what it sends: fresh ranges, holding, outages, the end. No I/O, no clock."""

from dataclasses import replace
from itertools import pairwise
from math import nan

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import Direction, TurnCommand, TurnRate
from circnav_mav.pilot import Ending, Phase

STEADY = 15.0 / 100.0
"""V/r_d of the bench's mission, rad/s."""


def test_the_four_numbers_to_plot_come_at_four_hertz_or_less(rig):
    rig.engage()
    since = rig.now
    rig.run(5.0)
    values = rig.of("NAMED_VALUE_FLOAT", since)
    assert {message.name for message in values} == {"CN_RNG", "CN_RRATE", "CN_ERR", "CN_YRATE"}
    assert 60 <= len(values) <= 80
    newest = {message.name: message.value for message in values}
    assert newest["CN_RNG"] == pytest.approx(150.0, abs=0.5)
    assert newest["CN_ERR"] == pytest.approx(50.0, abs=0.5)
    assert newest["CN_YRATE"] == pytest.approx(rig.setpoints()[-1].yaw_rate, abs=1e-3)


def test_our_heartbeat_stops_with_the_loop_that_feeds_it(rig):
    """It is sent by the healthy tick and by nothing else."""
    rig.engage()
    for _ in range(100):
        rig.now = round(rig.now + 0.05, 6)
        rig.heartbeat()
    before = len(rig.of("HEARTBEAT"))
    rig.step()
    assert len(rig.of("HEARTBEAT")) == before + 1


def test_every_frame_that_came_in_is_kept_for_the_recorder(rig, voice):
    junk_free = voice(9, 9).say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    rig.pilot.receive(junk_free + b"\x00" + junk_free, 0.0, "x")
    assert rig.pilot.take_frames() == [junk_free, junk_free]
    assert rig.pilot.take_frames() == []


def test_every_step_that_acted_leaves_one_record(rig):
    rig.engage()
    rig.pilot.take_records()
    rig.run(1.0)
    records = rig.pilot.take_records()
    assert [record.phase for record in records] == [Phase.ENGAGED] * len(records)
    assert len(records) >= 20
    assert all(record.yaw_rate_sent == pytest.approx(-record.turn_rate) for record in records if record.yaw_rate_sent)
    assert records[-1].link_age == pytest.approx(rig.now % 0.25, abs=1e-6)
    assert records[-1].mode == "GUIDED"
    assert records[-1].measured == 150.0


def test_a_vehicle_that_does_not_turn_as_told_teaches_the_estimator_no_motion(make_rig):
    """A copter that no longer hears us stands still: at the speed it was told, it would be somewhere else."""
    rig = make_rig().engage()
    heard = []
    rig.pilot.tracker.estimator.move = heard.append
    heading = 0.0
    for turns in (True, False):
        heard.clear()
        for _ in range(200):
            heading += 0.05 * rig.setpoints()[-1].yaw_rate if turns else 0.0
            rig.hear(mavlink.MAVLink_attitude_message(round(1000 * rig.now), 0.0, 0.0, heading, 0.0, 0.0, 0.0))
            rig.run(0.05)
        late = [own for own in heard if own.time > rig.now - 5.0]
        assert len(late) == (99 if turns else 0)


def test_a_mission_waits_for_link_ranging_and_mode_in_this_order(rig):
    rig.speaks = rig.ranges = False
    rig.mode = 5
    assert rig.run(1.0).pilot.phase is Phase.WAIT_LINK
    rig.speaks = True
    assert rig.run(1.0).pilot.phase is Phase.WAIT_RANGING
    rig.ranges = True
    assert rig.run(1.0).pilot.phase is Phase.READY
    assert rig.setpoints() == [] and rig.pilot.setpoints_sent == 0
    rig.mode = 4
    assert rig.run(1.0).pilot.phase is Phase.ENGAGED
    assert rig.setpoints()


def test_the_first_setpoint_waits_for_five_ranges(rig):
    rig.ranges = False
    rig.run(1.0)
    for count in range(1, 6):
        rig.range()
        rig.run(0.1)
        assert bool(rig.setpoints()) == (count == 5)


def test_a_fresh_range_is_answered_by_the_very_next_step(rig):
    rig.engage()
    rig.now += 0.031
    assert rig.step() == [], "nothing new and no tick due"
    rig.range()
    (setpoint,) = [message for message in rig.step() if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert setpoint.time_boot_ms == round(rig.now * 1000)
    assert rig.step() == [], "one range, one answer"


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


def test_the_safe_setpoints_of_the_end_are_a_tick_apart_however_many_ranges_come(rig):
    rig.engage()
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    for _ in range(40):
        rig.now = round(rig.now + 0.005, 6)
        rig.range()
        rig.step()
    times = [then for then, message in rig.sent if then > since and getattr(message, "vx", None) == 0.0]
    assert len(times) == 3
    assert all(b - a >= 0.05 - 1e-9 for a, b in pairwise(times))
    assert "circnav: ended, SIGINT" in rig.texts(since)


def test_an_interrupt_is_answered_by_the_very_next_step(rig):
    """However lately a setpoint has left."""
    rig.engage()
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.now += 0.001
    rig.step()
    assert [message.vx for message in rig.setpoints(since)] == [0.0]


def test_at_the_end_the_vehicle_gets_its_stream_rates_back(rig):
    rig.engage()
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    given = {message.param1 for message in rig.commands(511, since) if message.param2 == 0}
    assert given == set(rig.pilot.session.streams.rates)


def test_a_law_that_fails_is_held_back_and_ends_the_flight_safely(rig, monkeypatch):
    rig.engage()
    nonsense = TurnCommand(TurnRate(nan), TurnRate(nan), saturated=False)
    monkeypatch.setattr(rig.pilot.controller._circles, "steer", lambda *arguments: nonsense)
    since = rig.now
    rig.run(1.0)
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert "unsafe setpoint held back" in rig.pilot.outcome.reason
    assert [(m.vx, m.yaw_rate) for m in rig.setpoints(since)] == [(0.0, 0.0)] * 3


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
