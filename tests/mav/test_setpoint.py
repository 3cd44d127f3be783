"""The sign, and the bytes: setpoint frames against frames built by hand from the MAVLink definition."""

import struct
from dataclasses import replace
from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.types import Direction, TurnRate
from circnav_mav.mav.autopilots.targets import Addressee
from circnav_mav.mav.codec import Encoder
from circnav_mav.mav.frames import (
    YawRate,
    compass_from_vector,
    course_from_yaw,
    turn_rate_from_yaw_rate,
    yaw_rate_from_turn_rate,
)
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.setpoint_guard import Steer

US = (7, 191)
VEHICLE = Addressee(target_system=7, target_component=1, motion=Motion(), height=None)


def x25(data):
    """CRC-16/MCRF4XX, as the MAVLink guide defines it for its frames."""
    crc = 0xFFFF
    for byte in data:
        mixed = byte ^ (crc & 0xFF)
        mixed = (mixed ^ (mixed << 4)) & 0xFF
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    return crc & 0xFFFF


def by_hand(*, time_ms, vx, sideways, yaw_rate, sequence=0):
    """SET_POSITION_TARGET_LOCAL_NED (84, CRC_EXTRA 143), fields in wire order (4-byte ones first), trailing zeros cut.

    Frame MAV_FRAME_BODY_NED = 8. Mask: ignore position (bits 0..2) and yaw (bit 10), so 1 + 2 + 4 + 1024.
    """
    payload = struct.pack(
        "<I 11f H 3B",
        time_ms,
        *(0.0, 0.0, 0.0),
        *(vx, 0.0, 0.0),
        *(0.0, sideways, 0.0),
        *(0.0, yaw_rate),
        1 + 2 + 4 + 1024,
        *(7, 1, 8),
    )
    payload = payload.rstrip(b"\x00") or b"\x00"
    body = bytes((len(payload), 0, 0, sequence, *US, 84, 0, 0)) + payload
    return b"\xfd" + body + struct.pack("<H", x25(body + b"\x8f"))


def test_the_check_sum_of_this_file_is_the_standard_one():
    """Check value of CRC-16/MCRF4XX for "123456789"."""
    assert x25(b"123456789") == 0x6F91


@pytest.mark.parametrize(
    ("turn_rate", "yaw_rate"), [(0.15, -0.15), (-0.15, 0.15), (0.0, -0.0)], ids=["left", "right", "straight"]
)
def test_the_setpoint_is_the_frame_built_by_hand(copter, turn_rate, yaw_rate):
    """Left is counter-clockwise: a positive turn rate in the paper's frame, a negative yaw rate in MAVLink's. The
    acceleration that a turn at 15 m/s needs points the way it turns: right positive, V w = 2.25 m/s^2."""
    steer = Steer(yaw_rate_from_turn_rate(TurnRate(turn_rate)), 15.0)
    frame = Encoder(*US).encode(copter.setpoint(steer, VEHICLE, now=12.345))
    assert frame == by_hand(time_ms=12345, vx=15.0, sideways=15 * yaw_rate, yaw_rate=yaw_rate)


def test_the_safe_setpoint_is_the_frame_built_by_hand(copter):
    frame = Encoder(*US).encode(copter.safe_setpoint(VEHICLE, now=12.345))
    assert frame == by_hand(time_ms=12345, vx=0.0, sideways=0.0, yaw_rate=0.0)


def test_a_setpoint_ends_with_its_frame_byte_and_nothing_is_cut(copter):
    frame = Encoder(*US).encode(copter.safe_setpoint(VEHICLE, now=0.0))
    assert len(frame) == 10 + 53 + 2
    assert frame[10 + 52] == 8


def test_our_clock_in_a_setpoint_wraps_like_a_boot_time(copter):
    wrapped = copter.safe_setpoint(VEHICLE, now=2**32 / 1000 + 1.0)
    assert wrapped.time_boot_ms == 1000


@given(rate=st.floats(-10, 10))
def test_the_sign_changes_once_and_back(rate):
    assert yaw_rate_from_turn_rate(TurnRate(rate)) == -rate
    assert turn_rate_from_yaw_rate(YawRate(rate)) == -rate
    assert turn_rate_from_yaw_rate(yaw_rate_from_turn_rate(TurnRate(rate))) == rate


@pytest.mark.parametrize(
    ("yaw", "course"), [(0.0, pi / 2), (pi / 2, 0.0), (-pi / 2, pi), (pi, -pi / 2), (pi / 4, pi / 4)]
)
def test_north_is_up_and_east_is_right(yaw, course):
    """Heading clockwise from north, course counter-clockwise from east."""
    assert course_from_yaw(yaw) == pytest.approx(course)


@pytest.mark.parametrize(("x", "y", "bearing"), [(0, 1, 0.0), (1, 0, pi / 2), (0, -1, pi), (-1, 0, 3 * pi / 2)])
def test_a_vector_to_the_north_is_bearing_zero_and_to_the_east_a_quarter_turn(x, y, bearing):
    assert compass_from_vector(x, y) == pytest.approx(bearing)


@given(yaw=st.floats(-10, 10), turn=st.floats(-0.5, 0.5))
def test_a_course_lies_within_half_a_turn_and_falls_as_the_yaw_rises(yaw, turn):
    course, turned = course_from_yaw(yaw), course_from_yaw(yaw + turn)
    assert -pi < course <= pi
    assert (turned - course + turn + pi) % (2 * pi) - pi == pytest.approx(0, abs=1e-9)


def test_guided_is_asked_for_by_its_number(copter):
    """DO_SET_MODE (176): p1 = 1, custom mode enabled; p2 = 4, ArduCopter's GUIDED."""
    command = copter.request_mode(copter.guided_mode)
    assert (command.number, command.params) == (176, (1, 4))


def test_every_setpoint_of_the_adapter_is_in_its_own_table_and_addressed(copter):
    for message in (copter.setpoint(Steer(YawRate(0.1), 10.0), VEHICLE, 1.0), copter.safe_setpoint(VEHICLE, 1.0)):
        assert (message.get_type(), message.type_mask) in copter.shapes
        assert (message.target_system, message.target_component) == (7, 1)


@pytest.mark.parametrize(("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)])
def test_a_whole_flight_ends_in_the_frame_built_by_hand(make_rig, say, direction, sign):
    """Holding without ranges turns at V/r_d = 15/100 rad/s: clockwise is positive in MAVLink."""
    rig = make_rig(orbit=replace(say.orbit, direction=direction))
    rig.vehicle = type(rig.vehicle)(7, 1)
    rig.engage()
    rig.ranges = False
    rig.run(1.0)
    (frame,) = [frame for frame in split(rig.raw[-1]) if frame[7] == 84]
    expected = by_hand(
        time_ms=round(rig.now * 1000), vx=15.0, sideways=sign * 2.25, yaw_rate=sign * 0.15, sequence=frame[4]
    )
    assert frame == expected


def split(data):
    """Our output cut at the lengths that its MAVLink 2 headers name."""
    frames = []
    while data:
        frames.append(data[: data[1] + 12])
        data = data[data[1] + 12 :]
    return frames
