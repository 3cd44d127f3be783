"""The setpoint of every adapter for left, right, straight and hold, against frames built by hand
from the MAVLink definitions. Rules: wire order by field size, trailing zeros cut, CRC-16/MCRF4XX
with the message's extra byte."""

import struct
from math import acos, atan, cos, inf, nan, radians, sin, sqrt, tan

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import Direction, TurnRate
from circnav_mav.mav.autopilots.interface import SetpointContext, VehicleFacts, tilt, turn_in
from circnav_mav.mav.autopilots.parameters import Context
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.check_result import Grade
from circnav_mav.mav.codec import Encoder
from circnav_mav.mav.frames import euler_from_quaternion, yaw_rate_from_turn_rate
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.setpoint_guard import Steer
from tests.rig import Rig, Voice, decode, heartbeat, x25

US = (7, 191)
VEHICLE_IDS = (7, 1)
# airspeed, m/s; turn rate, rad/s, positive to the left
SPEED = 10.0
TURN = 0.2
FACTS = VehicleFacts(speed=SPEED, max_bank=0.7, drag=0.08)
"""With a drag coefficient of 0.08/s, 10 m/s require a thrust acceleration of 1.8 m/s^2."""
FULL_STICK = radians(50)
AT = 12.345
LEVEL = Motion(roll=0.0, pitch=0.0, yaw=1.0, airspeed=SPEED, altitude=0.0, climb=0.5)
STATE = SetpointContext(*VEHICLE_IDS, motion=LEVEL, height=-1.0)
BANK = atan(0.2 * 10.0 / 9.80665)  # bank of the coordinated turn, rad
# turn rate (rad/s, positive to the left), and sign of the turn in MAVLink
SIDES = {"left": (TURN, -1), "right": (-TURN, 1), "straight": (0.0, 0)}


def test_crc_matches_its_published_check_value() -> None:
    """Check value of CRC-16/MCRF4XX for "123456789"."""
    assert x25(b"123456789") == 0x6F91


def frame(message_id: int, crc_extra: int, payload: bytes) -> bytes:
    cut = payload.rstrip(b"\x00") or b"\x00"
    body = bytes((len(cut), 0, 0, 0, *US, message_id, 0, 0)) + cut
    return b"\xfd" + body + struct.pack("<H", x25(body + bytes((crc_extra,))))


def velocity_frame(
    mask: int,
    *,
    forward: float,
    down: float,
    yaw_rate: float,
    ahead: float = 0.0,
    right: float = 0.0,
) -> bytes:
    """SET_POSITION_TARGET_LOCAL_NED (84, extra 143) in MAV_FRAME_BODY_NED (8)."""
    floats = (0.0, 0.0, 0.0, forward, 0.0, down, ahead, right, 0.0, 0.0, yaw_rate)
    return frame(84, 143, struct.pack("<I11fH3B", 12345, *floats, mask, *VEHICLE_IDS, 8))


def attitude_frame(mask: int, *, roll: float, pitch: float = 0.0, thrust: float = 0.0) -> bytes:
    """SET_ATTITUDE_TARGET (82, extra 49): q = yaw 0, then pitch, then roll."""
    q = (
        cos(roll / 2) * cos(pitch / 2),
        sin(roll / 2) * cos(pitch / 2),
        cos(roll / 2) * sin(pitch / 2),
        0.0 - sin(roll / 2) * sin(pitch / 2),
    )
    return frame(
        82, 49, struct.pack("<I8f3B", 12345, *q, 0.0, 0.0, 0.0, thrust, *VEHICLE_IDS, mask)
    )


def assert_alike(got: bytes, expected: bytes) -> None:
    """Compare two SET_ATTITUDE_TARGET frames, except for the rounding of q, rates and thrust."""
    assert struct.unpack_from("<8f", got, 14) == pytest.approx(
        struct.unpack_from("<8f", expected, 14), abs=1e-6
    )
    assert got[46:49] == expected[46:49] == bytes((*VEHICLE_IDS, expected[48]))


def stick_frame(y: int) -> bytes:
    """MANUAL_CONTROL (69, extra 243): x, y, z, r, buttons, target."""
    return frame(69, 243, struct.pack("<4hHB", 0, y, 500, 0, 0, 7))


def sent(key: tuple[str, str], turn_rate: float | None, state: SetpointContext = STATE) -> bytes:
    """Return the bytes of an adapter's setpoint for a turn rate in the paper's frame (rad/s, left
    positive). None: the safe setpoint."""
    adapter = AUTOPILOTS[key](FACTS)
    if turn_rate is None:
        return Encoder(*US).encode(adapter.safe_setpoint(state, AT))
    steer = Steer(yaw_rate_from_turn_rate(TurnRate(turn_rate)), SPEED)
    return Encoder(*US).encode(adapter.setpoint(steer, state, AT))


def at_airspeed(airspeed: float | None) -> SetpointContext:
    return STATE._replace(motion=LEVEL._replace(airspeed=airspeed))


@pytest.mark.parametrize("side", SIDES)
def test_copter_and_rover_setpoints_match_frames_built_by_hand(side: str) -> None:
    """The masks ignore position (bits 0 to 2) and yaw (bit 10), for the rover also acceleration
    (bits 6 to 8). The acceleration V w is 2 m/s^2 to the right. PX4 is 1 m too high and descends at
    0.5/s times 1 m. PX4 gets 1.2 V w to the right and, for a drag of 0.18/s at 10 m/s, 1.8 m/s^2
    forward."""
    turn_rate, sense = SIDES[side]
    rate = 0.2 * sense if sense else -0.0
    turn = {"forward": 10.0, "yaw_rate": rate}
    copter = velocity_frame(0x407, **turn, down=0.0, right=10.0 * rate)
    assert sent(("ardupilot", "copter"), turn_rate) == copter
    assert sent(("ardupilot", "rover"), turn_rate) == velocity_frame(0x5C7, **turn, down=0.0)
    px4 = velocity_frame(0x407, **turn, down=0.5, ahead=1.8, right=1.2 * 10.0 * 0.2 * sense)
    assert sent(("px4", "copter"), turn_rate) == px4


def test_leaning_px4_copter_gets_level_acceleration() -> None:
    """PX4 rotates the acceleration setpoint by roll and pitch, then by yaw. The sent acceleration
    must be level after this rotation."""
    roll = 0.2
    pitch = -0.45
    leaning = STATE._replace(motion=STATE.motion._replace(roll=roll, pitch=pitch))
    fed = struct.unpack_from("<3f", sent(("px4", "copter"), -0.2, leaning), 10 + 4 + 6 * 4)
    by_roll = np.array([[1, 0, 0], [0, cos(roll), -sin(roll)], [0, sin(roll), cos(roll)]])
    by_pitch = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    assert by_pitch @ by_roll @ fed == pytest.approx([1.8, 2.4, 0.0], abs=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_plane_setpoints_bank_for_the_coordinated_turn(side: str) -> None:
    turn_rate, sense = SIDES[side]
    assert_alike(sent(("ardupilot", "plane"), turn_rate), attitude_frame(0xC6, roll=BANK * sense))
    assert sent(("px4", "plane"), turn_rate) == stick_frame(round(1000 * BANK / FULL_STICK) * sense)


def yawed_frame(*, roll: float, pitch: float, yaw: float) -> bytes:
    """SET_ATTITUDE_TARGET (82, extra 49), mask 7, thrust 0.5. q: product of the rotations about z,
    y and x."""
    about_z = np.array([[cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)]])
    q = about_z[0]
    for angle, axis in ((pitch, 2), (roll, 1)):
        turn = np.zeros(4)
        turn[0], turn[axis] = cos(angle / 2), sin(angle / 2)
        w, x, y, z = q
        a, b, c, d = turn
        q = np.array(
            [
                w * a - x * b - y * c - z * d,
                w * b + x * a + y * d - z * c,
                w * c - x * d + y * a + z * b,
                w * d + x * c - y * b + z * a,
            ]
        )
    return frame(82, 49, struct.pack("<I4f4f3B", 12345, *q, 0.0, 0.0, 0.0, 0.5, *VEHICLE_IDS, 0x07))


@pytest.mark.parametrize("side", SIDES)
def test_copter_attitude_leans_forward_and_into_its_turn(side: str) -> None:
    """A thrust acceleration of 1.8 m/s^2 forward gives a pitch of -atan(1.8/g). In a turn to the
    right, roll and yaw rate are positive in MAVLink. The first yaw target is the reported yaw, 1
    rad; 0.1 s later the target is the yaw rate times 0.1 s farther."""
    turn_rate, sense = SIDES[side]
    adapter = AUTOPILOTS["ardupilot", "copter attitude"](FACTS)
    steer = Steer(yaw_rate_from_turn_rate(TurnRate(turn_rate)), SPEED)
    pitch = -atan(1.8 / 9.80665)
    # The thrust balances the weight: roll = atan(a cos(pitch)/g).
    lean = {"roll": atan(tan(BANK) * cos(pitch)) * sense, "pitch": pitch}
    encoder = Encoder(*US)
    assert_alike(encoder.encode(adapter.setpoint(steer, STATE, AT)), yawed_frame(**lean, yaw=1.0))
    later = adapter.setpoint(steer, STATE, AT + 0.1)
    later.time_boot_ms = 12345
    assert_alike(Encoder(*US).encode(later), yawed_frame(**lean, yaw=1.0 + 0.1 * TURN * sense))


@pytest.mark.parametrize("thrust_acceleration", [9.0, 6 - 9j, -9 - 9j])
def test_copter_attitude_limits_total_tilt(thrust_acceleration: complex) -> None:
    """Roll and pitch of 25 deg each are a tilt of 34.8 deg, at which a copter sinks."""
    steer = Steer(yaw_rate_from_turn_rate(TurnRate(-0.3)), SPEED)
    roll, pitch = tilt(steer, thrust_acceleration, FACTS.max_bank)
    # The product is the cosine between body and world z axes.
    assert acos(cos(roll) * cos(pitch)) == pytest.approx(FACTS.max_bank, abs=1e-6)


def test_copter_attitude_limits_lead_of_yaw_target() -> None:
    """The vehicle does not turn, so the yaw target stops 20 deg ahead of its yaw."""
    adapter = AUTOPILOTS["ardupilot", "copter attitude"](FACTS)
    for tick in range(200):
        message = adapter.setpoint(
            Steer(yaw_rate_from_turn_rate(TurnRate(-0.5)), SPEED), STATE, AT + tick / 20
        )
    assert euler_from_quaternion(message.q)[2] == pytest.approx(1.0 + radians(20), abs=0.02)


def test_copter_attitude_safe_setpoint_is_level() -> None:
    adapter = AUTOPILOTS["ardupilot", "copter attitude"](FACTS)
    level = adapter.safe_setpoint(STATE, AT)
    assert_alike(Encoder(*US).encode(level), yawed_frame(roll=0.0, pitch=0.0, yaw=1.0))


@pytest.mark.parametrize("side", SIDES)
def test_px4_copter_stick_deflections_match_calculation(side: str) -> None:
    """Full pitch and roll sticks command g tan(35 deg) = 6.867 m/s^2. The full yaw stick commands
    150 deg/s, after a dead zone of 0.1 and the curve 0.4 x + 0.6 x^3. A yaw rate of 0.2 rad/s
    (0.0764 of full) requires x = 0.1820, so a deflection of 0.2638."""
    turn_rate, sense = SIDES[side]
    adapter = AUTOPILOTS["px4", "copter stick"](FACTS)
    steer = Steer(yaw_rate_from_turn_rate(TurnRate(turn_rate)), SPEED)
    sent_sticks = adapter.setpoint(steer, STATE, AT)
    expected = (262, 291 * sense, 500, 264 * sense)
    assert (sent_sticks.x, sent_sticks.y, sent_sticks.z, sent_sticks.r) == expected


def test_safe_setpoints_hover_or_level_the_wings() -> None:
    """time_boot_ms of a setpoint wraps at 2^32 ms."""
    assert sent(("ardupilot", "copter"), None) == velocity_frame(
        0x407, forward=0.0, down=0.0, yaw_rate=0.0
    )
    assert sent(("ardupilot", "rover"), None) == velocity_frame(
        0x5C7, forward=0.0, down=0.0, yaw_rate=0.0
    )
    assert sent(("px4", "copter"), None) == velocity_frame(
        0x407, forward=0.0, down=0.5, yaw_rate=0.0
    )
    assert sent(("ardupilot", "plane"), None) == attitude_frame(0xC6, roll=0.0)
    assert sent(("px4", "plane"), None) == stick_frame(0)
    for key in (("ardupilot", "copter"), ("ardupilot", "plane")):
        assert (
            AUTOPILOTS[key](FACTS).safe_setpoint(STATE, now=2**32 / 1000 + 1.0).time_boot_ms == 1000
        )


def test_mode_request_contains_mode_numbers() -> None:
    """DO_SET_MODE (176): param1 = 1 (custom mode enabled), then ArduPilot's mode number, or PX4's
    main and sub mode."""
    for key, numbers in (
        (("ardupilot", "copter"), (4,)),
        (("ardupilot", "plane"), (15,)),
        (("px4", "plane"), (2, 0)),
    ):
        vehicle = AUTOPILOTS[key](FACTS)
        command = vehicle.request_mode(vehicle.guided_mode)
        assert (command.number, command.params) == (176, (1, *numbers))


@pytest.mark.parametrize(
    ("key", "mode", "wanted"),
    [
        (("ardupilot", "copter"), 5, False),
        (("px4", "copter"), 4 << 16 | 3 << 24, True),
        (("px4", "copter"), None, True),
        (("px4", "plane"), 4 << 16 | 3 << 24, True),  # AUTO.LOITER
        # POSCTL obeys sticks, and circnav steers a PX4 plane by stick: the vehicle would move
        (("px4", "plane"), 3 << 16, False),
        (("px4", "plane"), None, False),
    ],
)
def test_setpoints_before_engagement_are_sent_only_in_harmless_modes(key, mode, wanted):
    assert AUTOPILOTS[key](FACTS).wants_setpoints_in(mode) == wanted


@pytest.mark.parametrize(
    ("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)]
)
def test_engaged_pilot_sends_frame_built_by_hand(direction: Direction, sign: int) -> None:
    """Without ranges the pilot holds the turn rate V/r_d = 15/100 rad/s. Clockwise is positive in
    MAVLink."""
    rig = Rig(f"orbit.direction={direction.value}")
    rig.vehicle = Voice(*VEHICLE_IDS)
    rig.engage()
    rig.ranges = False
    rig.run(1.0)
    (message,) = [
        message
        for message in decode(rig.raw[-1])
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    ]
    assert (message.vx, message.afy, message.yaw_rate) == pytest.approx(
        (15.0, sign * 2.25, sign * 0.15)
    )
    assert (message.type_mask, message.coordinate_frame, message.time_boot_ms) == (
        0x407,
        8,
        round(rig.now * 1000),
    )


@pytest.mark.parametrize("key", AUTOPILOTS)
def test_bank_and_stick_stay_within_mission_limit(key: tuple[str, str]) -> None:
    hard = sent(key, 3.0)
    assert hard != sent(key, TURN)
    if hard[7] == 82:
        w, x = struct.unpack_from("<2f", hard, 14)
        assert 2 * atan(abs(x) / w) <= 0.7 + 1e-6
    if hard[7] == 69:
        full = 1000 if key[1] == "copter stick" else round(1000 * 0.7 / FULL_STICK)
        assert abs(struct.unpack_from("<h", hard, 12)[0]) == full


@pytest.mark.parametrize("airspeed", [None, 0.1, 1.0, 4.99, 16.01, 150.0, nan])
@pytest.mark.parametrize("key", [("ardupilot", "plane"), ("px4", "plane")])
def test_implausible_airspeed_is_ignored(key: tuple[str, str], airspeed: float | None) -> None:
    """The commanded 10 m/s replaces the reported airspeed in bank and thrust."""
    assert sent(key, TURN, at_airspeed(airspeed)) == sent(key, TURN)
    assert sent(key, None, at_airspeed(airspeed)) == sent(key, None)


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("vehicle", AUTOPILOTS.values(), ids=lambda one: one.__name__)
def test_parameter_without_a_number_fails_its_check(vehicle, value) -> None:
    names = {name for rule in vehicle.parameters for name in rule.requested}
    context = Context(15.0, 20.0, 30.0, 0.05, 1, dict.fromkeys(names, value))
    for check in (rule.check(context) for rule in vehicle.parameters):
        assert check.grade is Grade.FAIL and check.text.endswith(
            f"= {value:g}: is not a number: set it again"
        )


@pytest.mark.parametrize("airspeed", [5.01, 9.0, 12.0, 15.99])
def test_plausible_airspeed_sets_the_bank(airspeed: float) -> None:
    bank = atan(TURN * airspeed / 9.80665)
    state = at_airspeed(airspeed)
    assert_alike(sent(("ardupilot", "plane"), TURN, state), attitude_frame(0xC6, roll=-bank))
    assert sent(("px4", "plane"), TURN, state) == stick_frame(-round(1000 * bank / FULL_STICK))


def test_thin_air_increases_the_bank() -> None:
    """At 3000 m above the sea the air density is 0.909 kg/m^3. The bank is computed from the true
    airspeed, which no message reports."""
    thin = STATE._replace(motion=LEVEL._replace(altitude=3000.0))
    bank = atan(TURN * SPEED * sqrt(1.225 / 0.90925) / 9.80665)
    assert sent(("px4", "plane"), TURN, thin) == stick_frame(-round(1000 * bank / FULL_STICK))


@pytest.mark.parametrize(("bound", "again"), [(16.0, 15.0), (5.0, 6.0)])
def test_airspeed_plausibility_has_hysteresis(bound: float, again: float) -> None:
    """An airspeed above 1.6 V or below 0.5 V is rejected. It is used again only between 0.6 V and
    1.5 V."""
    adapter = AUTOPILOTS["ardupilot", "plane"](FACTS)
    outside = bound + (0.01 if bound > SPEED else -0.01)
    beside = again + (0.01 if bound > SPEED else -0.01)
    used = [adapter.airspeed(speed) for speed in (bound, outside, bound, beside, again, bound)]
    assert used == [bound, SPEED, SPEED, SPEED, again, bound]


@pytest.mark.parametrize("kind", [35, 43], ids=["decarotor", "generic multirotor"])
def test_hexarotor_and_other_multirotor_types_are_copters(kind: int) -> None:
    rig = Rig()
    rig.receive(heartbeat(kind=kind))
    assert (rig.pilot.session.up, rig.pilot.session.adapter.name) == (True, "ardupilot copter")


# --- turn rate in the vehicle's report of its setpoint, used to detect another controller


def copter_report(
    course: float, speed: float, turn: float, *, ignored: int = 0
) -> mavlink.MAVLink_message:
    """Return ArduCopter's POSITION_TARGET_LOCAL_NED for a course (rad from north) and a turn
    (rad/s, right positive). It contains the velocity and the acceleration to the right of the
    velocity. Position, yaw and yaw rate are ignored."""
    north, east = cos(course), sin(course)
    velocity = (speed * north, speed * east, 0.5)
    across = (-speed * turn * east, speed * turn * north, 0.0)
    mask = 0x07 | 0x400 | 0x800 | ignored
    return mavlink.MAVLink_position_target_local_ned_message(
        0, 1, mask, 0, 0, 0, *velocity, *across, 0, 0
    )


@pytest.mark.parametrize("turn", [TURN, -TURN, 0.0])
@pytest.mark.parametrize("course", [0.0, 0.7, 2.5, -2.0])
def test_turn_in_copter_report_is_positive_to_right(course: float, turn: float) -> None:
    assert turn_in(copter_report(course, 5.0, turn)) == pytest.approx(turn, abs=1e-6)
    assert turn_in(copter_report(course, 0.2, 3.0)) == 0.0
    assert [turn_in(copter_report(course, 5.0, turn, ignored=bit)) for bit in (0x08, 0x40)] == [
        None,
        None,
    ]


@pytest.mark.parametrize(
    "key", sorted(set(AUTOPILOTS) - {("px4", "plane"), ("px4", "copter stick")})
)
def test_turn_in_setpoint_equals_commanded_turn(key: tuple[str, str]) -> None:
    adapter = AUTOPILOTS[key](FACTS)
    for turn in (TURN, -TURN, 0.0):
        steer = Steer(yaw_rate_from_turn_rate(TurnRate(turn)), SPEED)
        setpoint = adapter.setpoint(steer, STATE, AT)
        kind = setpoint.get_msgId()
        bank = -turn * SPEED / 9.80665
        if key == ("ardupilot", "copter attitude"):
            bank *= cos(atan(1.8 / 9.80665))  # the pitch reduces the lift, too
        expected = atan(bank) if kind == 82 else -turn
        assert turn_in(setpoint) == pytest.approx(expected, abs=1e-6)
