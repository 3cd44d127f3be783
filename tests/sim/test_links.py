"""Streams, requests and routing, link by link."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, build

QUIET = {"truth": {"rate_hz": 0}, "ranging": {"rate_hz": 0.0}}


def test_a_heartbeat_a_second_says_who_flies_and_how() -> None:
    companion = Station(build(**QUIET, start={"mode": "GUIDED"}))
    companion.heartbeat()
    companion.vehicle.advance(9.5)
    beats = companion.listen(source=(1, 1))  # and no streams until somebody asks
    assert len(beats) == 10 and {b.get_type() for b in beats} == {"HEARTBEAT"}
    assert {(b.type, b.autopilot, b.custom_mode, b.base_mode & 0x89, b.system_status) for b in beats} == {
        (2, 3, 4, 0x89, 4)
    }


def test_requested_intervals_are_kept_per_link() -> None:
    vehicle = build(**QUIET)
    companion, other = Station(vehicle), Station(vehicle, 255, 190, link="gcs")
    assert companion.command(511, 30, 100_000) == [0]
    assert other.command(511, 30, 500_000) == [0]
    vehicle.advance(2.0)
    assert [m.time_boot_ms for m in companion.listen("ATTITUDE")] == [*range(100, 2001, 100)]
    assert len(other.listen("ATTITUDE")) == 4
    assert companion.command(511, 30, -1) == [0]
    companion.forget()
    vehicle.advance(3.0)
    assert companion.listen("ATTITUDE") == []
    assert len(other.listen("ATTITUDE")) == 6


@pytest.mark.parametrize("number", [8, 513, 9999, 253])
def test_an_interval_for_a_message_it_does_not_stream_is_denied(number: int) -> None:
    companion = Station(build(**QUIET))
    assert companion.command(511, number, 100_000) == [2]
    assert companion.texts() == [f"No ap_message for mavlink id ({number})"]


def test_an_interval_too_short_is_denied_and_a_default_is_silence() -> None:
    companion = Station(build(**QUIET))
    assert companion.command(511, 30, 500) == [2]
    assert companion.command(511, 30, 100_000) == [0]
    assert companion.command(511, 30, 0) == [0]
    companion.vehicle.advance(1.0)
    assert companion.listen("ATTITUDE") == []


def test_the_heartbeat_can_be_hurried() -> None:
    companion = Station(build(**QUIET))
    assert companion.command(511, 0, 100_000) == [0]
    companion.vehicle.advance(2.0)
    assert len(companion.listen("HEARTBEAT", source=(1, 1))) == 21


def test_the_old_stream_request_works_for_mavproxy() -> None:
    companion = Station(build(**QUIET), 255, 230)
    companion.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    companion.vehicle.advance(1.0)
    kinds = {m.get_type() for m in companion.listen(source=(1, 1))}
    assert {"ATTITUDE", "VFR_HUD", "GLOBAL_POSITION_INT", "SYS_STATUS", "GPS_RAW_INT"} <= kinds
    assert len(companion.listen("ATTITUDE")) == 4


def test_the_version_is_told_on_request() -> None:
    companion = Station(build(**QUIET))
    assert companion.command(512, 148) == [0]
    assert companion.command(520, 1) == [0]
    version = companion.listen("AUTOPILOT_VERSION")[0]
    assert version.flight_sw_version == 0x040603FF
    wanted = (
        mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    assert version.capabilities & wanted == wanted


def test_commands_in_either_form_are_acknowledged_to_their_sender() -> None:
    companion = Station(build(**QUIET))
    companion.send(mavlink.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1, 4, 0, 0, 0, 0, 0))
    ack = companion.listen("COMMAND_ACK")[-1]
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (176, 0, 1, 191)
    assert companion.command(31_999) == [3]


def test_timesync_is_answered_with_boot_time() -> None:
    companion = Station(build(**QUIET))
    companion.vehicle.advance(1.5)
    companion.send(mavlink.MAVLink_timesync_message(0, 12345))
    answer = companion.listen("TIMESYNC")[-1]
    assert (answer.tc1, answer.ts1) == (1_500_000_000, 12345)


def test_parameters_are_listed_read_and_set_by_name() -> None:
    companion = Station(build(**QUIET))
    companion.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = companion.listen("PARAM_VALUE")
    assert len(values) == values[0].param_count and [v.param_index for v in values] == [*range(len(values))]
    table = {v.param_id: v.param_value for v in values}
    assert (table["GUID_TIMEOUT"], table["SYSID_MYGCS"], table["FS_GCS_ENABLE"]) == (3.0, 255.0, 0.0)
    companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"GUID_OPTIONS", -1))
    assert companion.listen("PARAM_VALUE")[-1].param_id == "GUID_OPTIONS"
    companion.forget()
    companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    assert companion.listen("PARAM_VALUE") == []


def test_there_are_no_missions() -> None:
    companion = Station(build(**QUIET))
    companion.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert companion.listen("MISSION_COUNT")[-1].count == 0


def test_truth_is_sent_unasked_and_names_its_numbers() -> None:
    vehicle = build(start={"mode": "GUIDED", "heading_deg": 90.0, "speed_mps": 12.0}, target={"east_m": 7.0})
    observer = Station(vehicle)
    vehicle.advance(1.0)
    arrays, states = observer.listen("DEBUG_FLOAT_ARRAY"), observer.listen("SIM_STATE")
    assert len(arrays) == len(states) == 11
    truth, last = vehicle.truth, arrays[-1]
    assert last.name == "SIM_TRUTH" and last.time_usec == 1_000_000
    wanted = [truth.north, truth.east, truth.down, truth.heading, truth.course, truth.ground_speed, truth.airspeed]
    wanted += [truth.turn_rate, truth.roll, truth.target_north, truth.target_east, truth.target_down, truth.range]
    assert last.data[:16] == pytest.approx([*wanted, truth.wind_north, truth.wind_east, 1.0], rel=1e-6)
    assert states[-1].yaw == pytest.approx(truth.heading) and states[-1].ve == pytest.approx(12.0)


def test_false_telemetry_of_others_is_forwarded_unchanged_but_not_obeyed() -> None:
    vehicle = build(**QUIET)
    companion, radio = Station(vehicle), Station(vehicle, 42, 1, link="telem2")
    companion.heartbeat()
    radio.send(mavlink.MAVLink_distance_sensor_message(5, 1, 60000, 4321, 3, 9, 24, 255))
    heard = companion.listen("DISTANCE_SENSOR", source=(42, 1))
    assert [m.current_distance for m in heard] == [4321] and radio.listen("DISTANCE_SENSOR") == []


def test_a_ranging_beacon_is_not_forwarded() -> None:
    vehicle = build(**QUIET)
    companion, radio = Station(vehicle), Station(vehicle, 1, 192, link="telem2")
    companion.heartbeat()
    radio.send(mavlink.MAVLink_ranging_beacon_message(0, 0, 0, 1, 5000, 0, 0, 0.0, 0, 0, 0, 0, 0, 1, 0))
    assert companion.listen("RANGING_BEACON") == []


def test_directed_messages_go_to_whom_they_are_directed() -> None:
    vehicle = build(**QUIET)
    companion, other = Station(vehicle), Station(vehicle, 255, 190, link="gcs")
    companion.heartbeat()
    for target, arrives in (((1, 191), True), ((1, 1), False), ((1, 77), False), ((99, 1), False), ((0, 0), True)):
        companion.forget()
        other.send(mavlink.MAVLink_tunnel_message(*target, 40000, 3, [1, 2, 3] + [0] * 125))
        assert bool(companion.listen("TUNNEL")) == arrives, target


def test_a_mavlink_1_autopilot_neither_hears_nor_speaks_mavlink_2() -> None:
    vehicle = build(vehicle={"mavlink_version": 1}, ranging={"rate_hz": 0.0})
    companion = Station(vehicle)
    assert companion.command(176, 1, 4) == []
    vehicle.advance(1.0)
    frames = vehicle.outgoing()
    assert frames and {frame[0] for frame in frames} == {0xFE}


def test_one_stray_byte_does_not_eat_the_next_datagram() -> None:
    companion = Station(build(**QUIET))
    companion.vehicle.receive(b"\xfd")
    assert companion.command(176, 1, 4) == [0]


def test_next_event_lets_a_driver_jump() -> None:
    vehicle = build(**QUIET)
    vehicle.advance(0.0)
    times = []
    while vehicle.next_event < 3.5:
        times.append(vehicle.next_event)
        vehicle.advance(vehicle.next_event)
    assert times == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]  # the autopilot's heartbeats and the radio's
