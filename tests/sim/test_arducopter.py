"""What ArduCopter 4.6.3 obeys, refuses and does when nobody speaks (figures: flown on the real firmware)."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from sim.autopilots.modes import PROFILES
from sim.config import parse_vehicle
from sim.vehicle import Vehicle
from tests.sim.station import Station, build, guided


def crc_x25(data: bytes) -> int:
    """The MAVLink checksum, from its definition (ITU X.25)."""
    crc = 0xFFFF
    for byte in data:
        tmp = (byte ^ crc) & 0xFF
        tmp = (tmp ^ (tmp << 4)) & 0xFF
        crc = (crc >> 8) ^ (tmp << 8) ^ (tmp << 3) ^ (tmp >> 4)
    return crc & 0xFFFF


def setpoint_by_hand(vx: float, yaw_rate: float) -> bytes:
    """SET_POSITION_TARGET_LOCAL_NED (84, CRC extra 143) from the definition."""
    floats = [0.0, 0.0, 0.0, vx, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw_rate]
    payload = struct.pack("<I11fHBBB", 0, *floats, 0x5C7, 1, 1, 8)
    header = bytes([len(payload), 0, 0, 7, 1, 191, 84, 0, 0])
    return b"\xfd" + header + payload + struct.pack("<H", crc_x25(header + payload + bytes([143])))


def test_a_positive_yaw_rate_turns_clockwise_seen_from_above() -> None:
    vehicle = guided().vehicle
    vehicle.receive(setpoint_by_hand(10.0, 0.5))
    vehicle.advance(1.0)
    truth = vehicle.truth
    assert truth.heading == pytest.approx(0.5)  # from north towards east
    assert truth.east > 0 and truth.turn_rate == 0.5
    assert (truth.north + 200.0, truth.east) == pytest.approx((20 * math.sin(0.5), 20 * (1 - math.cos(0.5))))
    assert vehicle.setpoint_log == [(0.0, "SET_POSITION_TARGET_LOCAL_NED")]


@pytest.mark.parametrize("mask", [0x407, 0x5C7])
def test_a_stream_of_setpoints_flies_a_circle_of_v_over_w(mask: int) -> None:
    companion = guided()
    companion.fly(math.tau / 0.3, 6.0, 0.3, mask=mask, rate=20.0)
    assert (companion.vehicle.truth.north, companion.vehicle.truth.east) == pytest.approx((-200, 0), abs=0.4)
    companion.fly(math.pi / 0.3, 6.0, 0.3, mask=mask)
    assert companion.vehicle.truth.east == pytest.approx(40.0, abs=0.1)


def test_local_ned_flies_straight_while_the_body_spins() -> None:
    companion = guided()
    companion.fly(2.0, 5.0, 0.3, frame=1)
    truth = companion.vehicle.truth
    assert (truth.north, truth.east, truth.heading) == pytest.approx((-190.0, 0.0, 0.6))


def test_after_three_seconds_of_silence_it_brakes_and_hovers_in_guided() -> None:
    companion = guided()
    vehicle = companion.vehicle
    companion.velocity(5.0, 0.2)
    vehicle.advance(2.999)
    assert (vehicle.truth.ground_speed, vehicle.truth.turn_rate) == pytest.approx((5.0, 0.2))
    vehicle.advance(3.1)
    assert vehicle.truth.turn_rate == 0.0 and vehicle.truth.ground_speed == pytest.approx(4.8)
    vehicle.advance(5.6)
    assert vehicle.truth.ground_speed == 0.0  # 5 -> 0 m/s in 2.5 s
    assert vehicle.truth.mode == 4 and companion.texts() == [] and vehicle.truth.down == -50.0


def test_the_timeout_is_a_parameter_that_can_be_set() -> None:
    companion = guided()
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"GUID_TIMEOUT", 1.0, 9))
    assert companion.listen("PARAM_VALUE")[-1].param_value == 1.0
    companion.velocity(5.0, 0.2)
    companion.vehicle.advance(1.05)
    assert companion.vehicle.truth.turn_rate == 0.0


@pytest.mark.parametrize(
    ("speed", "mask", "frame"),
    [
        (5.0, 0x5C7 | 0x20, 8),  # vz ignored: any bit of three ignores the group
        (5.0, 0x5C7 | 0x08, 8),
        (5.0, 0x5FF, 8),  # yaw rate alone
        (5.0, 0x207, 8),  # force
        (5.0, 0x5C7, 12),  # BODY_FRD
        (5.0, 0x5C7, 20),  # LOCAL_FRD
        (5.0, 0xFFFF, 1),
        *[(speed, 0x5C7, 8) for speed in (math.nan, math.inf, -math.inf, 1e6)],
    ],
)
def test_a_target_that_is_ill_defined_stops_the_vehicle(speed: float, mask: int, frame: int) -> None:
    companion = guided()
    companion.velocity(5.0, 0.2)
    companion.vehicle.advance(1.0)
    companion.velocity(speed, 0.2, mask=mask, frame=frame)
    companion.vehicle.advance(5.0)
    assert companion.vehicle.truth.ground_speed == 0.0 and companion.vehicle.truth.turn_rate == 0.0
    assert len(companion.vehicle.setpoint_log) == 1


def test_a_yaw_rate_that_is_not_a_number_is_not_checked_and_crashes_the_copter() -> None:
    companion = guided()
    companion.velocity(5.0, math.nan)
    companion.vehicle.advance(10.0)
    assert not companion.vehicle.truth.armed and companion.vehicle.truth.down == 0.0
    assert any(text.startswith("Crash") for text in companion.texts())


def test_setpoints_count_only_in_guided_and_armed() -> None:
    for start in ({"mode": "LOITER"}, {"mode": "GUIDED", "armed": False, "altitude_m": 0.0}):
        companion = Station(build(start=start))
        companion.velocity(5.0, 0.2)
        companion.vehicle.advance(1.0)
        assert companion.vehicle.truth.ground_speed == 0.0 and companion.vehicle.setpoint_log == []


@pytest.mark.parametrize(("target", "obeyed"), [((1, 1), True), ((1, 0), True), ((0, 0), True), ((2, 1), False)])
def test_only_setpoints_addressed_to_this_system_count(target: tuple[int, int], obeyed: bool) -> None:
    companion = guided()
    companion.send(
        mavlink.MAVLink_set_position_target_local_ned_message(0, *target, 8, 0x5C7, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0.1)
    )
    assert bool(companion.vehicle.setpoint_log) == obeyed


def test_modes_are_changed_by_command_and_acknowledged() -> None:
    companion = Station(build(start={"mode": "LOITER"}))
    assert companion.command(176, 1, 4) == [0]
    assert companion.vehicle.truth.mode == 4
    assert companion.command(176, 1, 99) == [4] and companion.texts() == ["No such mode 99"]
    assert companion.command(176, 0, 5) == [2]
    assert companion.command(176, 1, 5, target=(7, 1)) == []
    assert companion.vehicle.truth.mode == 4
    companion.forget()
    companion.send(mavlink.MAVLink_set_mode_message(1, 1, 5))  # obeyed without an ack
    assert companion.vehicle.truth.mode == 5 and companion.listen("COMMAND_ACK") == []


def test_without_gps_guided_is_refused_with_the_reason() -> None:
    companion = Station(build(vehicle={"gps": False}, start={"mode": "ALT_HOLD"}))
    assert companion.command(176, 1, 4) == [4]
    assert companion.texts() == ["Mode change to GUIDED failed: requires position"]


def test_it_arms_takes_off_and_lands() -> None:
    companion = Station(build(start={"mode": "GUIDED", "armed": False, "altitude_m": 0.0, "north_m": 0.0}))
    vehicle = companion.vehicle
    assert companion.command(22, 0, 0, 0, 0, 0, 0, 20) == [4]
    assert companion.command(400, 1) == [0] and vehicle.truth.armed
    assert companion.command(22, 0, 0, 0, 0, 0, 0, 20) == [0]
    vehicle.advance(20.0)
    assert vehicle.truth.down == pytest.approx(-20.0, abs=0.3)
    assert companion.command(400, 0) == [4]  # not in the air
    assert companion.command(176, 1, 9) == [0]
    vehicle.advance(90.0)
    assert vehicle.truth.down == 0.0 and not vehicle.truth.armed


def test_rtl_flies_home_and_lands() -> None:
    companion = Station(build())
    assert companion.command(176, 1, 6) == [0]
    companion.vehicle.advance(150.0)
    truth = companion.vehicle.truth
    assert math.hypot(truth.north, truth.east) < 2.5 and not truth.armed


@given(st.binary(max_size=300))
def test_junk_never_raises(data: bytes) -> None:
    vehicle = Vehicle(parse_vehicle({"truth": {"rate_hz": 0}}, "x"))
    vehicle.receive(data)
    vehicle.advance(0.1)


HANDLED = [0, 11, 20, 21, 23, 43, 44, 66, 69, 70, 75, 76, 82, 84, 86, 110, 111, 132, 251, 253]
GUIDED = {"px4_copter": "OFFBOARD", "px4_plane": "OFFBOARD", "arducopter_nogps": "GUIDED_NOGPS"}


@given(st.sampled_from(HANDLED), st.binary(min_size=60, max_size=255), st.booleans(), st.sampled_from(PROFILES))
def test_correctly_framed_nonsense_never_raises(number: int, noise: bytes, addressed: bool, profile: str) -> None:
    kind = mavlink.mavlink_map[number]
    payload = bytearray((noise * 5)[: kind.unpacker.size])
    if addressed and "target_system" in kind.fieldnames:
        names = list(kind.ordered_fieldnames)
        format_before = "<" + "".join(kind.native_format.decode()[1 : 1 + names.index("target_system")])
        payload[min(struct.calcsize(format_before), len(payload) - 1)] = 1
    header = bytes([len(payload), 0, 0, 0, 1, 191]) + number.to_bytes(3, "little")
    checksum = crc_x25(header + bytes(payload) + bytes([kind.crc_extra]))
    start = {"mode": GUIDED.get(profile, "GUIDED")}
    airframe = {"profile": profile, "dynamics": "realistic"}
    vehicle = Vehicle(parse_vehicle({"vehicle": airframe, "start": start}, "x"))
    vehicle.receive(b"\xfd" + header + bytes(payload) + struct.pack("<H", checksum))
    vehicle.advance(0.5)
    assert math.isfinite(vehicle.truth.heading)


@given(st.sampled_from(PROFILES), st.data())
def test_no_parameter_brings_it_down(profile: str, data: st.DataObject) -> None:
    vehicle = Vehicle(parse_vehicle({"vehicle": {"profile": profile, "default_streams": False}}, "x"))
    names = [m.param_id for m in vehicle._flight.autopilot.params.all_values()]
    mav = mavlink.MAVLink(None, 1, 191)
    for _ in range(4):
        value = data.draw(st.floats(width=32))
        name = data.draw(st.sampled_from(names)).encode()
        vehicle.receive(mavlink.MAVLink_param_set_message(1, 1, name, value, 9).pack(mav))
    vehicle.receive(mavlink.MAVLink_command_long_message(1, 1, 20, 0, 0, 0, 0, 0, 0, 0, 0).pack(mav))
    for i in range(5):
        vehicle.advance(i * 2.0)
    assert math.isfinite(vehicle.truth.north)


def test_what_is_flown_is_echoed_in_the_earth_frame() -> None:
    companion = Station(build(start={"mode": "GUIDED", "heading_deg": 90.0}))
    companion.command(511, 85, 100_000)
    companion.wait(0.5)
    assert companion.listen("POSITION_TARGET_LOCAL_NED") == []
    companion.velocity(5.0, 0.0)
    companion.wait(0.5)
    echo = companion.listen("POSITION_TARGET_LOCAL_NED")[-1]
    assert (echo.vx, echo.vy, echo.type_mask) == (pytest.approx(0.0, abs=1e-6), pytest.approx(5.0), 3079)
