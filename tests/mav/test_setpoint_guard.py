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
FLOATS = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")


def steer(yaw_rate=0.1, speed=15.0):
    return Steer(YawRate(yaw_rate), speed)


@pytest.fixture
def message(copter):
    return copter.setpoint(steer(), Addressee(1, 1, Motion(), None), 1.0)


@given(yaw_rate=st.floats(-0.35, 0.35), speed=st.floats(0, 15))
def test_what_is_within_the_limits_passes_unchanged(yaw_rate, speed):
    assert SetpointGuard(LIMITS).admit(steer(yaw_rate, speed), 0.0) == steer(yaw_rate, speed)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["yaw_rate", "speed"])
def test_a_number_that_is_none_is_stopped(field, number):
    with pytest.raises(UnsafeSetpointError, match="not finite"):
        SetpointGuard(LIMITS).admit(steer(**{field: number}), 0.0)


@pytest.mark.parametrize(("yaw_rate", "speed"), [(0.351, 15), (-0.351, 15), (0, 15.01), (0, -0.01), (1e9, 15)])
def test_a_number_beyond_the_limits_is_stopped(yaw_rate, speed):
    with pytest.raises(UnsafeSetpointError, match="outside the limits"):
        SetpointGuard(LIMITS).admit(steer(yaw_rate, speed), 0.0)


@pytest.mark.parametrize("mask", [0, 0x5C7, 0xFFFF])
def test_a_mask_that_is_not_in_the_table_is_stopped(copter, message, mask):
    message.type_mask = mask
    with pytest.raises(UnsafeSetpointError, match="not in the adapter's table"):
        SetpointGuard(LIMITS).check_message(message, copter.shapes)


def test_a_message_of_another_type_is_stopped(copter):
    stranger = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0x407, 0, 0, 0.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1
    )
    with pytest.raises(UnsafeSetpointError, match="not in the adapter's table"):
        SetpointGuard(LIMITS).check_message(stranger, copter.shapes)


def test_a_message_of_the_table_passes_as_it_is(copter, message):
    assert SetpointGuard(LIMITS).check_message(message, copter.shapes) is message


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", FLOATS)
def test_no_field_of_a_message_may_be_no_number(copter, message, field, number):
    setattr(message, field, number)
    with pytest.raises(UnsafeSetpointError, match="not finite"):
        SetpointGuard(LIMITS).check_message(message, copter.shapes)


def test_without_a_mission_limit_a_turn_may_change_at_once():
    gate = SetpointGuard(LIMITS)
    gate.admit(steer(-0.35), 0.0)
    assert gate.admit(steer(0.35), 0.001).yaw_rate == 0.35


@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_changes_no_faster_than_the_mission_allows(sign):
    """0.5 rad/s^2 over 0.1 s: 0.05 rad/s a step, both ways, and the goal is met exactly."""
    gate = SetpointGuard(Limits(0.35, 15.0, max_yaw_acceleration=0.5))
    assert gate.admit(steer(0.0), 0.0).yaw_rate == 0.0
    rates = [gate.admit(steer(sign * 0.12), 0.1 * i).yaw_rate for i in range(1, 5)]
    assert rates == pytest.approx([sign * 0.05, sign * 0.10, sign * 0.12, sign * 0.12])


def test_the_first_setpoint_of_a_stream_is_not_held_back():
    gate = SetpointGuard(Limits(0.35, 15.0, max_yaw_acceleration=0.5))
    assert gate.admit(steer(0.3), 0.0).yaw_rate == 0.3
    gate.reset()
    assert gate.admit(steer(-0.3), 0.1).yaw_rate == -0.3


def test_time_that_stands_still_or_steps_back_allows_no_change():
    gate = SetpointGuard(Limits(0.35, 15.0, max_yaw_acceleration=0.5))
    gate.admit(steer(0.1), 5.0)
    assert gate.admit(steer(0.3), 5.0).yaw_rate == 0.1
    assert gate.admit(steer(0.3), 4.0).yaw_rate == 0.1


@given(st.lists(st.tuples(st.floats(-0.35, 0.35), st.floats(0, 1)), max_size=30))
def test_no_sequence_leaves_the_limits_or_the_slew(wanted):
    gate, now, before = SetpointGuard(Limits(0.35, 15.0, max_yaw_acceleration=0.5)), 0.0, None
    for rate, wait in wanted:
        now += wait
        out = gate.admit(steer(rate), now).yaw_rate
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
    message = adapter.setpoint(steer(), Addressee(1, 1, Motion(airspeed=15.0), None), 1.0)
    for name, value in fields.items():
        setattr(message, name, value)
    try:
        return SetpointGuard(ALL).check_message(message, adapter.shapes) is message
    except UnsafeSetpointError as error:
        assert "outside the limits" in str(error)
        return False


def test_the_messages_of_every_adapter_are_judged_here():
    assert {*VELOCITY, *ATTITUDE, *STICK} == {*AUTOPILOTS}
    assert all(passes(key) for key in AUTOPILOTS)


@pytest.mark.parametrize(
    ("field", "inside", "outside"),
    [
        ("vx", [15.0, -15.0, 0.0], [15.001, -15.001]),
        ("vy", [0.0, -0.0], [0.001, -0.001]),
        ("vz", [1.0, -1.0, 0.0], [1.001, -1.001]),
        ("yaw_rate", [0.35, -0.35, 0.0], [0.3501, -0.3501]),
        ("afx", [0.0, -0.0], [0.001, -0.001]),
        ("afy", [5.25, -5.25, 0.0], [5.251, -5.251]),  # V w
        ("afz", [0.0, -0.0], [0.001, -0.001]),
        ("coordinate_frame", [8], [1, 7, 9, 12]),  # in LOCAL_NED the same numbers fly straight on
    ],
)
@pytest.mark.parametrize("key", VELOCITY)
def test_each_velocity_of_a_setpoint_has_its_own_bound(key, field, inside, outside):
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


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.5)])
@pytest.mark.parametrize("key", ATTITUDE)
def test_an_attitude_is_a_rotation_and_nothing_else(key, q):
    assert not passes(key, q=q)


@pytest.mark.parametrize("key", AUTOPILOTS)
def test_a_setpoint_for_everybody_is_stopped(key):
    """System 0 is every vehicle behind the endpoint."""
    assert not passes(key, **{"target" if key in STICK else "target_system": 0})


@pytest.mark.parametrize(("thrust", "may"), [(0.0, True), (1.0, True), (-0.001, False), (1.001, False)])
@pytest.mark.parametrize("key", ATTITUDE)
def test_thrust_is_a_share(key, thrust, may):
    assert passes(key, thrust=thrust) == may


@pytest.mark.parametrize(
    ("field", "inside", "outside"),
    [
        ("x", [0], [1, -1]),  # height is the autopilot's business
        ("y", [1000, -1000], [1001, -1001]),
        ("z", [0, 1000], [-1, 1001]),
        ("r", [0], [1, -1]),
        ("buttons", [0], [1, 0x8000]),
        ("enabled_extensions", [0], [1]),
    ],
)
@pytest.mark.parametrize("key", STICK)
def test_each_stick_has_its_own_bound(key, field, inside, outside):
    assert [passes(key, **{field: value}) for value in inside] == [True] * len(inside)
    assert [passes(key, **{field: value}) for value in outside] == [False] * len(outside)


@pytest.mark.parametrize(("y", "may"), [(800, True), (-800, True), (801, False), (-801, False)])
def test_the_stick_goes_no_farther_than_the_missions_bank(y, may):
    adapter = AUTOPILOTS["px4", "plane"](VehicleFacts(speed=15.0))
    message = adapter.setpoint(steer(), Addressee(1, 1, Motion(airspeed=15.0), None), 1.0)
    message.y = y
    gate = SetpointGuard(replace(ALL, max_stick=800))
    if may:
        assert gate.check_message(message, adapter.shapes) is message
    else:
        with pytest.raises(UnsafeSetpointError, match="outside the limits"):
            gate.check_message(message, adapter.shapes)
