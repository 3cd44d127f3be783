"""PX4's multicopter as flown: OFFBOARD, its watchdog, its droop and crab, its ways with acks and texts."""

import math
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sim.autopilots.modes import PX4
from tests.sim.station import Station, build

OFFBOARD = (1, 6, 0)


def px4(gcs: bool = False, **tables: Any) -> Any:
    tables["vehicle"] = {"profile": "px4_copter", "default_streams": False, **tables.get("vehicle", {})}
    tables["sensors"] = {"attitude_error_deg": 0.0, "gyro_noise_deg_s": 0.0}
    companion = Station(build(**{"truth": {"rate_hz": 0}, "ranging": {"rate_hz": 0.0}, **tables}))
    companion.heartbeat(6 if gcs else 18)
    return companion


def offboard(companion: Any, vx: float = 0.0, rate: float = 0.0) -> None:
    companion.fly(0.5, vx, rate)
    assert companion.command(176, *OFFBOARD) == [0, 0]


def test_offboard_without_setpoints_is_accepted_then_rejected() -> None:
    companion = px4()
    assert companion.command(176, *OFFBOARD) == [0, 1]
    assert companion.vehicle.truth.mode == PX4["LOITER"]
    companion.velocity(0.0, 0.0)
    companion.wait(1.2)
    assert companion.command(176, *OFFBOARD) == [0, 1]  # too old
    companion.velocity(0.0, 0.0)
    assert companion.command(176, *OFFBOARD) == [0, 0]
    assert companion.vehicle.truth.mode == 6 << 16


def test_the_base_mode_must_say_custom() -> None:
    companion = px4()
    companion.velocity(0.0, 0.0)
    assert companion.command(176, 0, 6) == [0, 1] and companion.command(176, 128, 6) == [0, 1]
    assert companion.command(176, 209, 6) == [0, 0]
    assert px4(start={"armed": False}).command(176, *OFFBOARD) == [0, 0]  # disarmed, without setpoints


@pytest.mark.parametrize(
    ("speed", "rate", "flown", "turned", "crab"),
    [
        (3.0, 0.1, 2.80, 0.099, -13.0),
        (3.0, 0.3, 2.26, 0.298, -18.0),
        (5.0, 0.1, 4.55, 0.100, -11.0),
        (5.0, 0.3, 3.76, 0.300, -17.0),
        (5.0, -0.3, 3.77, -0.297, 18.0),
        (5.0, 0.6, 3.41, 0.596, -23.0),
        (8.0, 0.3, 6.04, 0.298, -18.0),
        (3.0, 1.0, 1.9, 0.994, -28.0),
    ],
)
def test_the_turn_rate_is_true_and_the_speed_droops(
    speed: float, rate: float, flown: float, turned: float, crab: float
) -> None:
    companion = px4()
    offboard(companion)
    companion.fly(40.0, speed, rate)
    truth = companion.vehicle.truth
    assert truth.turn_rate == pytest.approx(turned, rel=0.015)
    assert truth.ground_speed == pytest.approx(flown, rel=0.04)
    assert math.degrees(math.remainder(truth.course - truth.heading, math.tau)) == pytest.approx(crab, abs=4.0)


def test_less_drag_droops_less() -> None:
    companion = px4(vehicle={"drag_per_s": 0.1})
    offboard(companion)
    companion.fly(40.0, 5.0, 0.3)
    assert companion.vehicle.truth.ground_speed == pytest.approx(5.27, rel=0.03)


def test_no_vertical_speed_does_not_hold_the_height_but_a_loop_on_it_does() -> None:
    companion = px4()
    offboard(companion)
    companion.fly(60.0, 3.0, 0.1)
    sunk = companion.vehicle.truth.down + 50.0
    assert 2.0 < sunk < 8.0

    def hold() -> None:
        companion.velocity(3.0, 0.1, vz=0.5 * (-50.0 - companion.vehicle.truth.down))

    companion.repeat(30.0, hold)
    assert companion.vehicle.truth.down == pytest.approx(-50.0, abs=0.3)


def test_the_loss_of_setpoints_is_a_failsafe_after_a_second_and_it_comes_back_by_itself() -> None:
    companion = px4(gcs=True)
    offboard(companion)
    companion.fly(5.0, 3.0, 0.1)
    companion.wait(0.95)
    assert companion.vehicle.truth.mode == PX4["OFFBOARD"]
    companion.wait(0.05)
    assert companion.vehicle.truth.mode == PX4["RTL"] and "Failsafe activated" in companion.texts()
    companion.command(511, 436, 100_000)
    companion.wait(0.2)
    mode = companion.listen("CURRENT_MODE")[-1]
    assert (mode.custom_mode, mode.intended_custom_mode) == (PX4["RTL"], PX4["OFFBOARD"])
    companion.velocity(3.0, 0.1)
    assert companion.vehicle.truth.mode == PX4["OFFBOARD"]
    assert companion.command(176, 1, 4, 3) == [0, 0]  # an end is another mode commanded
    companion.fly(2.0, 3.0, 0.1)
    assert companion.vehicle.truth.mode == PX4["LOITER"]


@pytest.mark.parametrize(("action", "mode"), [(0, "RTL"), (3, "RTL"), (4, "LAND"), (5, "LOITER")])
def test_the_failsafe_is_a_parameter_sent_byte_by_byte(action: int, mode: str) -> None:
    companion = px4()
    value = struct.unpack("<f", struct.pack("<i", action))[0]
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", value, 6))
    assert companion.listen("PARAM_VALUE")[-1].param_value == value
    offboard(companion)
    companion.wait(1.1)
    assert companion.vehicle.truth.mode == PX4[mode]


@pytest.mark.parametrize("frame", [7, 9, 12, 20])
def test_other_frames_are_dropped_with_a_text(frame: int) -> None:
    companion = px4(gcs=True)
    companion.velocity(3.0, 0.1, frame=frame)
    chunks = companion.listen("STATUSTEXT")
    assert "".join(c.text for c in chunks) == f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported"
    assert [c.chunk_seq for c in chunks] == [0, 1] and chunks[0].id == chunks[1].id != 0
    assert companion.command(176, *OFFBOARD) == [0, 1]


def test_texts_go_only_where_a_ground_station_was_seen() -> None:
    companion = px4()
    companion.velocity(3.0, 0.1, frame=12)
    assert companion.texts() == []


@pytest.mark.parametrize("mask", [0x5C7 | 0x08, 0x5C7 | 0x20, 0x5FF])
def test_a_body_velocity_counts_whole_or_not_at_all(mask: int) -> None:
    companion = px4()
    companion.velocity(3.0, 0.1, mask=mask)
    assert companion.vehicle.setpoint_log == []


def test_local_ned_without_vertical_speed_is_taken_and_stands_still() -> None:
    companion = px4()
    offboard(companion)
    companion.fly(5.0, 3.0, 0.1, mask=0x5C7 | 0x20, frame=1)
    assert companion.vehicle.truth.mode == PX4["OFFBOARD"] and companion.vehicle.truth.ground_speed < 0.05


def test_what_is_not_a_number_is_a_free_axis() -> None:
    companion = px4()
    offboard(companion)
    companion.fly(5.0, math.nan, 0.3)
    assert companion.vehicle.truth.mode == PX4["OFFBOARD"]
    assert companion.vehicle.truth.ground_speed < 0.05 and abs(companion.vehicle.truth.turn_rate) < 0.01
    companion.fly(25.0, 3.0, math.nan)
    assert companion.vehicle.truth.ground_speed == pytest.approx(3.0, abs=0.1)
    assert abs(companion.vehicle.truth.turn_rate) < 0.01


def test_too_much_is_limited() -> None:
    companion = px4(vehicle={"max_turn_rate_deg_s": 300.0})
    offboard(companion)
    companion.fly(5.0, 0.0, 100.0)
    assert companion.vehicle.truth.turn_rate == pytest.approx(2.25, abs=0.01)
    companion.fly(20.0, 1e6, 0.0)
    assert companion.vehicle.truth.ground_speed < 13.0


@pytest.mark.parametrize(
    ("target", "obeyed"),
    [((1, 1), True), ((1, 0), True), ((0, 0), True), ((0, 1), True), ((1, 191), False), ((2, 1), False)],
)
def test_addresses(target: tuple[int, int], obeyed: bool) -> None:
    companion = px4()
    companion.velocity(1.0, 0.0, target=target)
    assert bool(companion.vehicle.setpoint_log) == obeyed
    if target != (0, 1):
        assert bool(companion.command(400, 1, target=target)) == obeyed


def test_without_gps_velocities_fail_after_five_seconds_and_attitudes_stay() -> None:
    events = [{"at_s": 5.0, "action": "gps_off"}, {"at_s": 20.0, "action": "gps_on"}]
    companion = px4(events=events)
    offboard(companion)
    companion.fly(9.4, 3.0, 0.1)
    assert companion.vehicle.truth.mode == PX4["OFFBOARD"]
    companion.fly(5.0, 3.0, 0.1)
    assert companion.vehicle.truth.mode == PX4["ALTCTL"] and companion.vehicle.truth.down > -48.0  # sinks
    companion.fly(6.0, 3.0, 0.1)
    assert companion.vehicle.truth.mode == PX4["OFFBOARD"]

    companion = px4(events=events[:1])
    companion.attitude(7, thrust=0.485)
    assert companion.command(176, *OFFBOARD) == [0, 0]
    companion.repeat(15.0, lambda: companion.attitude(7, thrust=0.485))
    assert companion.vehicle.truth.mode == PX4["OFFBOARD"]


def test_the_heartbeat_cannot_be_hurried() -> None:
    companion = px4()
    assert companion.command(511, 0, 100_000) == [4] and companion.command(511, 9999, 100_000) == [4]
    assert companion.command(511, 30, 20_000) == [0]


def test_it_streams_unasked_at_the_onboard_rates() -> None:
    companion = Station(build(vehicle={"profile": "px4_copter"}, truth={"rate_hz": 0}, ranging={"rate_hz": 0.0}))
    companion.wait(2.0)
    rates = {
        kind: len(companion.listen(kind)) / 2 for kind in ("ATTITUDE", "LOCAL_POSITION_NED", "VFR_HUD", "TIMESYNC")
    }
    assert rates == pytest.approx({"ATTITUDE": 100, "LOCAL_POSITION_NED": 30, "VFR_HUD": 10, "TIMESYNC": 10}, abs=1)
    assert math.isnan(companion.listen("VFR_HUD")[0].airspeed)


def test_a_forwarded_range_arrives_twice_and_the_second_only_on_update() -> None:
    companion = Station(build(vehicle={"profile": "px4_copter"}, ranging={"rate_hz": 5.0, "noise_m": 0.0}))
    companion.heartbeat()
    companion.wait(2.05)
    raw = companion.listen("DISTANCE_SENSOR", source=(1, 192))
    again = companion.listen("DISTANCE_SENSOR", source=(1, 1))
    assert len(raw) == len(again) == 11
    assert {m.id for m in again} == {1} and again[0].current_distance == raw[0].current_distance


def test_it_takes_off_and_lands() -> None:
    companion = px4(start={"armed": False, "north_m": 0.0})
    assert companion.command(22, 0, 0, 0, math.nan, math.nan, math.nan, 584.0 + 10.0) == [0]
    assert companion.command(400, 1) == [0]
    companion.wait(25.0)
    assert companion.vehicle.truth.down == pytest.approx(-10.0, abs=0.5)
    assert companion.vehicle.truth.mode == PX4["LOITER"]
    assert companion.command(400, 0) == [1]  # not in the air
    assert companion.command(21) == [0]
    companion.wait(40.0)
    assert not companion.vehicle.truth.armed and companion.vehicle.truth.down == pytest.approx(0.0, abs=0.1)


def test_stick_modes_need_sticks() -> None:
    companion = px4()
    assert companion.command(176, 1, 3) == [0, 1]
    companion.sticks(0.0)
    assert companion.command(176, 1, 3) == [0, 0]


def test_attitude_setpoints_turn_only_with_the_yaw_led_round() -> None:
    companion = px4()
    companion.attitude(7, thrust=0.485)
    assert companion.command(176, *OFFBOARD) == [0, 0]
    companion.repeat(5.0, lambda: companion.attitude(3, rates=(0.0, 0.0, 0.3), thrust=0.485))
    assert companion.vehicle.truth.turn_rate == pytest.approx(0.0, abs=0.005)
    heading = [companion.vehicle.truth.heading]

    def lead() -> None:
        heading[0] += 0.3 / 20
        companion.attitude(7, 0.1, 0.0, heading[0], thrust=0.485)

    companion.repeat(8.0, lead)
    assert companion.vehicle.truth.turn_rate == pytest.approx(0.3, abs=0.005)


def test_a_reposition_is_flown_to_and_refused_without_a_position() -> None:
    """100 m north of home at 20 m above it, at the speed asked for."""
    companion = px4()
    assert companion.command(178, 1, 4.0, -1) == [0]
    north = -35.3632621 + math.degrees(100 / 6_378_137)
    assert companion.command(192, -1, 1, 0, math.nan, north, 149.1652374, 584.0 + 20.0) == [0]
    companion.wait(20.0)
    assert companion.vehicle.truth.ground_speed == pytest.approx(4.0, abs=0.1)
    companion.wait(100.0)
    truth = companion.vehicle.truth
    assert (truth.north, truth.east, truth.down) == (
        pytest.approx(100, abs=0.5),
        pytest.approx(0, abs=0.5),
        pytest.approx(-20, abs=0.5),
    )
    denied = px4(vehicle={"gps": False}, start={"mode": "ALTCTL"})
    assert denied.command(192, -1, 1, 0, math.nan, north, 149.1652374, 604.0) == [1]
