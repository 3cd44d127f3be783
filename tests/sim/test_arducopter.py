"""Commands that the emulated ArduCopter obeys or refuses, and its timeouts. Figures are from
flights of ArduCopter 4.6.3."""

import math
import struct

import pytest
from circnav_sim.autopilots.modes import PROFILES
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from tests.rig import x25
from tests.sim.station import Station, aboard, build


def guided(**tables):
    return aboard(mode="GUIDED", vehicle={"turn_lag_s": 0.0}, **tables)


def setpoint_by_hand(vx: float, yaw_rate: float) -> bytes:
    """Return SET_POSITION_TARGET_LOCAL_NED (84, CRC extra 143), packed from its definition."""
    floats = [0.0, 0.0, 0.0, vx, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw_rate]
    payload = struct.pack("<I11fHBBB", 0, *floats, 0x5C7, 1, 1, 8)
    header = bytes([len(payload), 0, 0, 7, 1, 191, 84, 0, 0])
    return b"\xfd" + header + payload + struct.pack("<H", x25(header + payload + bytes([143])))


def test_copter_with_positive_yaw_rate_turns_clockwise():
    vehicle = guided().vehicle
    vehicle.receive(setpoint_by_hand(10.0, 0.5))
    vehicle.advance(1.0)
    truth = vehicle.truth
    assert truth.heading == pytest.approx(0.5)  # the heading changes from north towards east
    assert truth.east > 0 and truth.turn_rate == 0.5
    assert (truth.north + 200.0, truth.east) == pytest.approx(
        (20 * math.sin(0.5), 20 * (1 - math.cos(0.5)))
    )
    assert vehicle.setpoint_log == [(0.0, "SET_POSITION_TARGET_LOCAL_NED")]


def test_body_velocity_flies_circle_and_local_velocity_flies_straight():
    companion = guided()
    companion.fly(math.pi / 0.3, 6.0, 0.3, mask=0x407)
    assert companion.truth.east == pytest.approx(40.0, abs=0.1)
    companion = guided()
    companion.fly(2.0, 5.0, 0.3, frame=1)
    truth = companion.truth
    assert (truth.north, truth.east, truth.heading) == pytest.approx((-190.0, 0.0, 0.6))


def test_copter_brakes_after_setpoint_timeout():
    companion = guided()
    companion.velocity(5.0, 0.2)
    companion.wait(2.999)
    assert (companion.truth.ground_speed, companion.truth.turn_rate) == pytest.approx((5.0, 0.2))
    companion.wait(0.101)
    assert companion.truth.turn_rate == 0.0 and companion.truth.ground_speed == pytest.approx(4.8)
    companion.wait(2.5)  # the copter brakes from 5 m/s to 0 in 2.5 s
    assert (
        companion.truth.ground_speed == 0.0
        and companion.truth.mode == 4
        and companion.truth.down == -50.0
    )
    assert companion.texts() == []
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"GUID_TIMEOUT", 1.0, 9))
    assert companion.listen("PARAM_VALUE")[-1].param_value == 1.0
    companion.velocity(5.0, 0.2)
    companion.wait(1.05)
    assert companion.truth.turn_rate == 0.0


@pytest.mark.parametrize(
    "start", [{"mode": "LOITER"}, {"mode": "GUIDED", "armed": False, "altitude_m": 0.0}]
)
def test_copter_obeys_setpoints_only_when_armed_in_guided(start):
    companion = aboard(start=start)
    companion.velocity(5.0, 0.2)
    companion.wait(1.0)
    assert companion.truth.ground_speed == 0.0 and companion.vehicle.setpoint_log == []


def test_copter_acknowledges_or_refuses_mode_changes():
    companion = aboard(mode="LOITER")
    assert companion.set_mode(4) == [0] and companion.truth.mode == 4
    assert companion.set_mode(99) == [4] and companion.texts() == ["No such mode 99"]
    assert companion.command(176, 0, 5) == [2]
    assert companion.command(176, 1, 5, target=(7, 1)) == []
    assert companion.truth.mode == 4
    companion.forget()
    # SET_MODE is obeyed without an acknowledgement
    companion.send(mavlink.MAVLink_set_mode_message(1, 1, 5))
    assert companion.truth.mode == 5 and companion.listen("COMMAND_ACK") == []
    lost = aboard(mode="ALT_HOLD", vehicle={"gps": False})
    assert lost.set_mode(4) == [4]
    assert lost.texts() == ["Mode change to GUIDED failed: requires position"]


def test_copter_takes_off_lands_and_returns_home():
    companion = aboard(mode="GUIDED", start={"armed": False, "altitude_m": 0.0, "north_m": 0.0})
    take_off = (22, 0, 0, 0, 0, 0, 0, 20)
    assert companion.command(*take_off) == [4]
    assert companion.command(400, 1) == [0] and companion.truth.armed
    assert companion.command(*take_off) == [0]
    companion.wait(20.0)
    assert companion.truth.down == pytest.approx(-20.0, abs=0.3)
    assert companion.command(400, 0) == [4]  # disarming in the air is refused
    assert companion.set_mode(9) == [0]
    companion.wait(70.0)
    assert companion.truth.down == 0.0 and not companion.truth.armed
    companion = aboard()
    assert companion.set_mode(6) == [0]
    companion.wait(150.0)
    assert (
        math.hypot(companion.truth.north, companion.truth.east) < 2.5 and not companion.truth.armed
    )


HANDLED = [0, 11, 20, 21, 23, 43, 44, 66, 69, 70, 75, 76, 82, 84, 86, 110, 111, 132, 251, 253]
GUIDED = {"px4_copter": "OFFBOARD", "px4_plane": "OFFBOARD", "arducopter_nogps": "GUIDED_NOGPS"}


@given(
    st.sampled_from(HANDLED),
    st.binary(min_size=60, max_size=255),
    st.booleans(),
    st.sampled_from(PROFILES),
)
def test_emulator_accepts_malformed_frames_without_exception(number, noise, addressed, profile):
    kind = mavlink.mavlink_map[number]
    payload = bytearray((noise * 5)[: kind.unpacker.size])
    if addressed and "target_system" in kind.fieldnames:
        names = list(kind.ordered_fieldnames)
        format_before = "<" + "".join(
            kind.native_format.decode()[1 : 1 + names.index("target_system")]
        )
        payload[min(struct.calcsize(format_before), len(payload) - 1)] = 1
    header = bytes([len(payload), 0, 0, 0, 1, 191]) + number.to_bytes(3, "little")
    checksum = x25(header + bytes(payload) + bytes([kind.crc_extra]))
    airframe = {"profile": profile, "dynamics": "realistic"}
    vehicle = build(vehicle=airframe, start={"mode": GUIDED.get(profile, "GUIDED")})
    vehicle.receive(noise)
    vehicle.receive(b"\xfd" + header + bytes(payload) + struct.pack("<H", checksum))
    vehicle.advance(0.5)
    assert math.isfinite(vehicle.truth.heading)


@given(st.sampled_from(PROFILES), st.data())
def test_emulator_accepts_any_parameter_value_without_exception(profile, data):
    companion = Station(build(vehicle={"profile": profile, "default_streams": False}))
    names = [m.param_id for m in companion.vehicle._flight.autopilot.params.all_values()]
    for _ in range(4):
        value = data.draw(st.floats(width=32))
        name = data.draw(st.sampled_from(names)).encode()
        companion.send(mavlink.MAVLink_param_set_message(1, 1, name, value, 9))
    companion.command(20)  # MAV_CMD_NAV_RETURN_TO_LAUNCH
    for _ in range(4):
        companion.wait(2.0)
    assert math.isfinite(companion.truth.north)


def test_copter_reports_its_setpoint_in_earth_frame():
    companion = aboard(mode="GUIDED", start={"heading_deg": 90.0})
    companion.stream(85, 100_000)
    companion.wait(0.5)
    assert companion.listen("POSITION_TARGET_LOCAL_NED") == []
    companion.velocity(5.0, 0.0)
    companion.wait(0.5)
    echo = companion.listen("POSITION_TARGET_LOCAL_NED")[-1]
    assert (echo.vx, echo.vy, echo.type_mask) == (
        pytest.approx(0.0, abs=1e-6),
        pytest.approx(5.0),
        3079,
    )
