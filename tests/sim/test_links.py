"""Streams, requests and routing on each link."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, aboard, build


def test_heartbeat_shows_vehicle_and_mode_every_second():
    companion = aboard(mode="GUIDED")
    companion.heartbeat()
    companion.wait(9.5)
    beats = companion.listen(source=(1, 1))  # without a request the emulator sends no streams
    assert len(beats) == 10 and {b.get_type() for b in beats} == {"HEARTBEAT"}
    seen = {
        (b.type, b.autopilot, b.custom_mode, b.base_mode & 0x89, b.system_status) for b in beats
    }
    assert seen == {(2, 3, 4, 0x89, 4)}


def test_emulator_keeps_stream_intervals_per_link():
    companion = aboard()
    other = Station(companion.vehicle, 255, 190, link="gcs")
    assert companion.stream(30, 100_000) == [0] and other.stream(30, 500_000) == [0]
    companion.wait(2.0)
    assert [m.time_boot_ms for m in companion.listen("ATTITUDE")] == [*range(100, 2001, 100)]
    assert len(other.listen("ATTITUDE")) == 4
    assert companion.stream(30, -1) == [0]
    companion.forget()
    companion.wait(1.0)
    assert companion.listen("ATTITUDE") == []
    assert len(other.listen("ATTITUDE")) == 6


def test_request_data_stream_is_served():
    companion = aboard()
    companion.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    companion.wait(1.0)
    kinds = {m.get_type() for m in companion.listen(source=(1, 1))}
    assert {"ATTITUDE", "VFR_HUD", "GLOBAL_POSITION_INT", "SYS_STATUS", "GPS_RAW_INT"} <= kinds
    assert len(companion.listen("ATTITUDE")) == 4


def test_emulator_answers_version_timesync_and_mission_requests():
    companion = aboard()
    assert companion.command(512, 148) == [0] and companion.command(520, 1) == [0]
    version = companion.listen("AUTOPILOT_VERSION")[0]
    assert version.flight_sw_version == 0x040603FF
    wanted = 64 | 128 | 8192  # capabilities: attitude targets, local position targets, MAVLink 2
    assert version.capabilities & wanted == wanted
    companion.send(mavlink.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1, 4, 0, 0, 0, 0, 0))
    ack = companion.listen("COMMAND_ACK")[-1]
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (176, 0, 1, 191)
    assert companion.command(31_999) == [3]
    companion.wait(1.5)
    companion.send(mavlink.MAVLink_timesync_message(0, 12345))
    answer = companion.listen("TIMESYNC")[-1]
    assert (answer.tc1, answer.ts1) == (1_500_000_000, 12345)
    companion.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert companion.listen("MISSION_COUNT")[-1].count == 0


@pytest.mark.parametrize(
    ("profile", "gcs_switch"), [("arducopter", "FS_GCS_ENABLE"), ("arduplane", "FS_GCS_ENABL")]
)
def test_emulator_lists_and_reads_parameters_by_name(profile, gcs_switch):
    companion = aboard(profile)
    companion.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = companion.listen("PARAM_VALUE")
    assert len(values) == values[0].param_count and [v.param_index for v in values] == [
        *range(len(values))
    ]
    table = {v.param_id: v.param_value for v in values}
    assert (table["SYSID_MYGCS"], table[gcs_switch], table["FENCE_ENABLE"]) == (255.0, 0.0, 0.0)
    companion.forget()
    for name in (b"FENCE_ENABLE", b"NO_SUCH"):
        companion.send(mavlink.MAVLink_param_request_read_message(1, 1, name, -1))
    assert [value.param_id for value in companion.listen("PARAM_VALUE")] == ["FENCE_ENABLE"]


def test_emulator_sends_truth_without_request():
    vehicle = build(
        start={"mode": "GUIDED", "heading_deg": 90.0, "speed_mps": 12.0}, target={"east_m": 7.0}
    )
    observer = Station(vehicle)
    vehicle.advance(1.0)
    arrays = observer.listen("DEBUG_FLOAT_ARRAY")
    states = observer.listen("SIM_STATE")
    assert len(arrays) == len(states) == 11
    t = vehicle.truth
    last = arrays[-1]
    assert last.name == "SIM_TRUTH" and last.time_usec == 1_000_000
    track = [t.north, t.east, t.down, t.heading, t.course, t.ground_speed, t.airspeed]
    track += [t.turn_rate, t.roll, t.target_north, t.target_east, t.target_down]
    assert last.data[:16] == pytest.approx([*track, t.range, t.wind_north, t.wind_east, 1.0])
    assert (t.east, t.target_east, t.airspeed) == pytest.approx((12.0, 7.0, 12.0))
    assert states[-1].yaw == pytest.approx(t.heading) and states[-1].ve == pytest.approx(12.0)


def test_emulator_forwards_telemetry_of_other_systems():
    companion = aboard()
    radio = Station(companion.vehicle, 42, 1, link="telem2")
    companion.heartbeat()
    radio.send(mavlink.MAVLink_distance_sensor_message(5, 1, 60000, 4321, 3, 9, 24, 255))
    radio.send(
        mavlink.MAVLink_ranging_beacon_message(0, 0, 0, 1, 5000, 0, 0, 0.0, 0, 0, 0, 0, 0, 1, 0)
    )
    received = companion.listen("DISTANCE_SENSOR", source=(42, 1))
    assert [m.current_distance for m in received] == [4321] and radio.listen(
        "DISTANCE_SENSOR"
    ) == []
    assert companion.listen("RANGING_BEACON") == []


def test_emulator_routes_directed_messages_to_their_target():
    companion = aboard()
    companion.heartbeat()
    other = Station(companion.vehicle, 255, 190, link="gcs")
    for target in ((1, 191), (1, 1), (1, 77), (99, 1), (0, 0)):
        other.send(mavlink.MAVLink_tunnel_message(*target, 40000, 3, [1, 2, 3] + [0] * 125))
    received = [
        (message.target_system, message.target_component) for message in companion.listen("TUNNEL")
    ]
    assert received == [(1, 191), (0, 0)]


@pytest.mark.parametrize("profile", ["arducopter", "px4_copter"])
@pytest.mark.parametrize(
    ("target", "obeyed"),
    [
        ((1, 1), True),
        ((1, 0), True),
        ((0, 0), True),
        ((0, 1), True),
        ((1, 191), None),
        ((2, 1), False),
    ],
)
def test_autopilot_obeys_only_its_own_address(profile, target, obeyed):
    """None: the message is addressed to a component of the same system that never sent a message.
    ArduPilot obeys such a message, PX4 does not."""
    companion = aboard(profile, "GUIDED" if profile == "arducopter" else None)
    if obeyed is None:
        companion = Station(companion.vehicle, 255, 190)
        obeyed = profile == "arducopter"
    companion.velocity(1.0, 0.0, target=target)
    assert bool(companion.vehicle.setpoint_log) == obeyed
    assert bool(companion.command(400, 1, target=target)) == obeyed


def test_mavlink_1_autopilot_ignores_mavlink_2():
    companion = Station(build(vehicle={"mavlink_version": 1}, ranging={"rate_hz": 0.0}))
    assert companion.set_mode(4) == []
    companion.wait(1.0)
    frames = companion.vehicle.outgoing()
    assert frames and {frame[0] for frame in frames} == {0xFE}
    of_version_2 = aboard()
    of_version_2.vehicle.receive(b"\xfd")
    assert of_version_2.set_mode(4) == [0]
