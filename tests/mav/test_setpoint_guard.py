"""The choke point: what may not leave, raises."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.autopilots.interface import VehicleFacts
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.autopilots.targets import Addressee
from circnav_mav.mav.frames import YawRate, quaternion_from_euler
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.setpoint_guard import Limits, SetpointGuard, Steer, UnsafeSetpointError

LIMITS = Limits(max_yaw_rate=0.35, max_speed=15.0)
SLEWED = replace(LIMITS, max_yaw_acceleration=0.5)
FOR = Addressee(1, 1, Motion(airspeed=15.0), None)
FLOATS = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")


def steer(yaw_rate=0.1, speed=15.0):
    return Steer(YawRate(yaw_rate), speed)


@pytest.fixture
def message(copter):
    return copter.setpoint(steer(), FOR, 1.0)


@given(yaw_rate=st.floats(-0.35, 0.35), speed=st.floats(0, 15))
def test_what_is_within_the_limits_passes_unchanged(yaw_rate, speed):
    assert SetpointGuard(LIMITS).admit(steer(yaw_rate, speed), 0.0) == steer(yaw_rate, speed)


NO_NUMBERS = (math.nan, math.inf, -math.inf)


@pytest.mark.parametrize(
    ("yaw_rate", "speed", "why"),
    [
        *((number, 15.0, "not finite") for number in NO_NUMBERS),
        *((0.1, number, "not finite") for number in NO_NUMBERS),
        *((rate, 15.0, "outside the limits") for rate in (0.351, -0.351, 1e9)),
        *((0.0, speed, "outside the limits") for speed in (15.01, -0.01)),
    ],
)
def test_a_number_that_is_none_or_beyond_the_limits_is_stopped(yaw_rate, speed, why):
    with pytest.raises(UnsafeSetpointError, match=why):
        SetpointGuard(LIMITS).admit(steer(yaw_rate, speed), 0.0)


@pytest.mark.parametrize("mask", [0, 0x5C7, 0xFFFF])
def test_a_message_that_is_not_in_the_vehicles_table_is_stopped(copter, message, mask):
    assert SetpointGuard(LIMITS).check_message(message, copter.shapes) is message
    message.type_mask = mask
    stranger = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0x407, 0, 0, 0.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1
    )
    for other in (message, stranger):
        with pytest.raises(UnsafeSetpointError, match="not in the adapter's table"):
            SetpointGuard(LIMITS).check_message(other, copter.shapes)


@pytest.mark.parametrize("number", NO_NUMBERS)
@pytest.mark.parametrize("field", FLOATS)
def test_no_field_of_a_message_may_be_no_number(copter, message, field, number):
    setattr(message, field, number)
    with pytest.raises(UnsafeSetpointError, match="not finite"):
        SetpointGuard(LIMITS).check_message(message, copter.shapes)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_changes_no_faster_than_the_mission_allows(sign):
    """0.5 rad/s^2 over 0.1 s: 0.05 rad/s a step, both ways, and the goal is met exactly."""
    guard = SetpointGuard(SLEWED)
    assert guard.admit(steer(0.0), 0.0).yaw_rate == 0.0
    rates = [guard.admit(steer(sign * 0.12), 0.1 * i).yaw_rate for i in range(1, 5)]
    assert rates == pytest.approx([sign * 0.05, sign * 0.10, sign * 0.12, sign * 0.12])


def test_the_first_setpoint_of_a_stream_is_not_held_back_nor_any_without_a_mission_limit():
    guard = SetpointGuard(SLEWED)
    assert guard.admit(steer(0.3), 0.0).yaw_rate == 0.3
    guard.reset()
    assert guard.admit(steer(-0.3), 0.1).yaw_rate == -0.3
    guard = SetpointGuard(LIMITS)
    guard.admit(steer(-0.35), 0.0)
    assert guard.admit(steer(0.35), 0.001).yaw_rate == 0.35


def test_time_that_stands_still_or_steps_back_allows_no_change():
    guard = SetpointGuard(SLEWED)
    guard.admit(steer(0.1), 5.0)
    assert [guard.admit(steer(0.3), now).yaw_rate for now in (5.0, 4.0)] == [0.1, 0.1]


@given(st.lists(st.tuples(st.floats(-0.35, 0.35), st.floats(0, 1)), max_size=30))
def test_no_sequence_leaves_the_limits_or_the_slew(wanted):
    guard, now, before = SetpointGuard(SLEWED), 0.0, None
    for rate, wait in wanted:
        now += wait
        out = guard.admit(steer(rate), now).yaw_rate
        assert abs(out) <= 0.35
        assert before is None or abs(out - before) <= 0.5 * wait + 1e-9
        before = out


# --- what each kind of message may ask for ---

ALL = Limits(max_yaw_rate=0.35, max_speed=15.0, max_bank=0.7, max_pitch=0.26, max_climb=1.0)
VELOCITY = [("ardupilot", "copter"), ("ardupilot", "rover"), ("px4", "copter")]
ATTITUDE = [("ardupilot", "plane"), ("px4", "plane attitude")]
STICK = [("px4", "plane")]


def passes(key, **fields):
    """Whether an adapter's own message passes with some fields changed; only the limits may stop it."""
    adapter = AUTOPILOTS[key](VehicleFacts(speed=15.0))
    message = adapter.setpoint(steer(), FOR, 1.0)
    for name, value in fields.items():
        setattr(message, name, value)
    try:
        return SetpointGuard(ALL).check_message(message, adapter.shapes) is message
    except UnsafeSetpointError as error:
        assert "outside the limits" in str(error)
        return False


def test_the_messages_of_every_vehicle_are_judged_here():
    assert {*VELOCITY, *ATTITUDE, *STICK} == {*AUTOPILOTS}
    assert all(passes(key) for key in AUTOPILOTS)


BOUNDS = (
    (VELOCITY, "vx", [15.0, -15.0, 0.0], [15.001, -15.001]),
    (VELOCITY, "vy", [0.0, -0.0], [0.001, -0.001]),
    (VELOCITY, "afx", [0.0, 5.0], [8.26, -0.001]),  # half of g, and 1.25 V w across: together 8.25
    (VELOCITY, "vz", [1.0, -1.0, 0.0], [1.001, -1.001]),
    (VELOCITY, "yaw_rate", [0.35, -0.35, 0.0], [0.3501, -0.3501]),
    (VELOCITY, "afy", [6.0, -6.0, 0.0], [8.26, -8.26]),
    (VELOCITY, "afz", [6.0, -6.0, 0.0], [8.26, -8.26]),
    (VELOCITY, "coordinate_frame", [8], [1, 7, 9, 12]),  # in LOCAL_NED the same numbers fly straight on
    (VELOCITY + ATTITUDE, "target_system", [1], [0]),  # 0 is every vehicle behind the endpoint
    (ATTITUDE, "thrust", [0.0, 1.0], [-0.001, 1.001]),
    (ATTITUDE, "q", [(1.0, 0.0, 0.0, 0.0)], [(0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.5)]),
    (STICK, "x", [0], [1, -1]),  # height is the autopilot's business
    (STICK, "y", [1000, -1000], [1001, -1001]),
    (STICK, "z", [0, 1000], [-1, 1001]),
    (STICK, "r", [0], [1, -1]),
    (STICK, "buttons", [0], [1, 0x8000]),
    (STICK, "enabled_extensions", [0], [1]),
    (STICK, "target", [1], [0]),
)


@pytest.mark.parametrize(("keys", "field", "inside", "outside"), BOUNDS)
def test_each_field_of_a_setpoint_has_its_own_bound(keys, field, inside, outside):
    for key in keys:
        assert [passes(key, **{field: value}) for value in inside] == [True] * len(inside)
        assert [passes(key, **{field: value}) for value in outside] == [False] * len(outside)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("angle", "most"), [("roll", 0.7), ("pitch", 0.26)])
@pytest.mark.parametrize("key", ATTITUDE)
def test_bank_and_pitch_of_a_setpoint_have_a_bound_each(key, angle, most, sign):
    def tilted(by):
        angles = {"roll": 0.0, "pitch": 0.0, angle: sign * by}
        return passes(key, q=quaternion_from_euler(**angles, yaw=0.5))

    assert tilted(most)
    assert not tilted(most + 1e-4)


def test_the_stick_goes_no_farther_than_the_missions_bank():
    adapter = AUTOPILOTS["px4", "plane"](VehicleFacts(speed=15.0))
    message, guard = adapter.setpoint(steer(), FOR, 1.0), SetpointGuard(replace(ALL, max_stick=800))
    for y in (800, -800):
        message.y = y
        assert guard.check_message(message, adapter.shapes) is message
    for y in (801, -801):
        message.y = y
        with pytest.raises(UnsafeSetpointError, match="outside the limits"):
            guard.check_message(message, adapter.shapes)
