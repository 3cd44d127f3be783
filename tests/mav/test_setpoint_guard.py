"""The last check before sending: a forbidden message raises an exception."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.autopilots.interface import SetpointContext, VehicleFacts
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.frames import YawRate, quaternion_from_euler
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.setpoint_guard import Limits, SetpointGuard, Steer, UnsafeSetpointError

LIMITS = Limits(max_yaw_rate=0.35, max_speed=15.0)
FOR = SetpointContext(1, 1, Motion(airspeed=15.0), None)
FLOATS = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")


def steer(yaw_rate=0.1, speed=15.0):
    return Steer(YawRate(yaw_rate), speed)


@pytest.fixture
def message(copter):
    return copter.setpoint(steer(), FOR, 1.0)


NOT_FINITE = (math.nan, math.inf, -math.inf)


@pytest.mark.parametrize(
    ("yaw_rate", "speed", "why"),
    [
        *((number, 15.0, "not finite") for number in NOT_FINITE),
        *((0.1, number, "not finite") for number in NOT_FINITE),
        *((rate, 15.0, "outside the limits") for rate in (0.351, -0.351, 1e9)),
        *((0.0, speed, "outside the limits") for speed in (15.01, -0.01)),
    ],
)
def test_guard_stops_steering_beyond_its_limits(yaw_rate, speed, why):
    with pytest.raises(UnsafeSetpointError, match=why):
        SetpointGuard(LIMITS).admit(steer(yaw_rate, speed), 0.0)


@pytest.mark.parametrize("mask", [0, 0x5C7, 0xFFFF])
def test_guard_stops_messages_outside_adapter_table(copter, message, mask):
    assert SetpointGuard(LIMITS).check_message(message, copter.shapes) is message
    message.type_mask = mask
    stranger = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0x407, 0, 0, *[0.0] * 9
    )
    for other in (message, stranger):
        with pytest.raises(UnsafeSetpointError, match="not in the adapter's table"):
            SetpointGuard(LIMITS).check_message(other, copter.shapes)


@pytest.mark.parametrize("number", NOT_FINITE)
@pytest.mark.parametrize("field", FLOATS)
def test_guard_stops_fields_that_are_not_finite(copter, message, field, number):
    setattr(message, field, number)
    with pytest.raises(UnsafeSetpointError, match="not finite"):
        SetpointGuard(LIMITS).check_message(message, copter.shapes)


def test_guard_passes_turns_within_limits():
    guard = SetpointGuard(LIMITS)
    wanted = [steer(-0.35), steer(0.35, 0.0), steer(0.1, 7.5)]
    assert [guard.admit(one, 0.001 * i) for i, one in enumerate(wanted)] == wanted


# --- limits of each kind of message

ALL = Limits(max_yaw_rate=0.35, max_speed=15.0, max_bank=0.7)
VELOCITY = [("ardupilot", "copter"), ("ardupilot", "rover"), ("px4", "copter")]
ATTITUDE = [("ardupilot", "plane"), ("ardupilot", "copter attitude")]
STICK = [("px4", "plane")]
STICKS = [("px4", "copter stick")]


def passes(key, limits=ALL, **fields):
    """Return True if the guard passes an adapter's message with some changed fields. Fails if the
    guard blocks it for a reason other than the limits."""
    adapter = AUTOPILOTS[key](VehicleFacts(speed=15.0, max_bank=0.7, drag=0.05))
    message = adapter.setpoint(steer(), FOR, 1.0)
    for name, value in fields.items():
        setattr(message, name, value)
    try:
        return SetpointGuard(limits).check_message(message, adapter.shapes) is message
    except UnsafeSetpointError as error:
        assert "outside the limits" in str(error)
        return False


BOUNDS = (
    (VELOCITY, "vx", [15.0, -15.0, 0.0], [15.001, -15.001]),
    (VELOCITY, "vy", [0.0, -0.0], [0.001, -0.001]),
    # limit of the acceleration, m/s^2: half of g along the nose and 1.25 V w across, together 8.25
    (VELOCITY, "afx", [0.0, 5.0], [8.26, -0.001]),
    (VELOCITY, "vz", [1.0, -1.0, 0.0], [1.001, -1.001]),
    (VELOCITY, "yaw_rate", [0.35, -0.35, 0.0], [0.3501, -0.3501]),
    (VELOCITY, "afy", [6.0, -6.0, 0.0], [8.26, -8.26]),
    (VELOCITY, "afz", [6.0, -6.0, 0.0], [8.26, -8.26]),
    # in LOCAL_NED the same velocity would be a constant direction over ground
    (VELOCITY, "coordinate_frame", [8], [1, 7, 9, 12]),
    # target system 0 addresses every vehicle behind the endpoint
    (VELOCITY + ATTITUDE, "target_system", [1], [0]),
    (ATTITUDE, "thrust", [0.0, 1.0], [-0.001, 1.001]),
    (
        ATTITUDE,
        "q",
        [(1.0, 0.0, 0.0, 0.0)],
        [(0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0, 0.5)],
    ),
    # the autopilot controls the height, so the pitch stick stays at 0
    (STICK, "x", [0], [1, -1]),
    (STICK, "y", [1000, -1000], [1001, -1001]),
    (STICK, "z", [0, 1000], [-1, 1001]),
    (STICK, "r", [0], [1, -1]),
    (STICK, "buttons", [0], [1, 0x8000]),
    (STICK, "enabled_extensions", [0], [1]),
    (STICK, "target", [1], [0]),
)


@pytest.mark.parametrize(("keys", "field", "inside", "outside"), BOUNDS)
def test_every_setpoint_field_has_its_bound(keys, field, inside, outside):
    for key in keys:
        assert all(passes(key, **{field: value}) for value in inside)
        assert not any(passes(key, **{field: value}) for value in outside)


def test_guard_limits_sticks_of_every_adapter():
    assert {*VELOCITY, *ATTITUDE, *STICK, *STICKS} == {*AUTOPILOTS}
    sticks = replace(ALL, max_pitch_stick=700, max_yaw_stick=1000)
    assert all(passes(key, sticks) for key in AUTOPILOTS)
    assert not passes(*STICKS, sticks, x=701)
    assert not passes(*STICKS, sticks, x=-701)
    assert not passes(*STICKS, sticks, r=1001)
    tight = replace(ALL, max_stick=800)
    assert [passes(*STICK, tight, y=y) for y in (800, -800, 801, -801)] == [
        True,
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(
    ("angle", "most", "limits"),
    [
        ("roll", 0.7, ALL),
        ("roll", -0.7, ALL),
        ("pitch", 0.7, ALL),
        ("pitch", -0.7, ALL),
        ("roll", 0.0, LIMITS),
    ],
)
@pytest.mark.parametrize("key", ATTITUDE)
def test_bank_and_pitch_of_setpoints_are_bounded(key, angle, most, limits):
    q, beyond = (
        quaternion_from_euler(**{"roll": 0.0, "pitch": 0.0, angle: by}, yaw=0.5)
        for by in (most, most * 1.001 or 1e-3)
    )
    assert passes(key, limits, q=q)
    assert not passes(key, limits, q=beyond)
