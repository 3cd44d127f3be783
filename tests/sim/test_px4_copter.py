"""The emulated PX4 copter, with figures from flights of PX4: OFFBOARD and its timeout, steady-state
speed error and crab angle, acknowledgements and texts."""

import math
import struct

import pytest
from circnav_sim.autopilots.modes import PX4
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, aboard, build

LOITER = (4, 3)
OFFBOARD = (6, 0)
HOVERING = 0.485  # thrust at which the vehicle keeps its height


def px4(gcs=False, **tables):
    companion = aboard("px4_copter", **tables)
    companion.heartbeat(6 if gcs else 18)
    return companion


def offboard(**tables):
    companion = px4(**tables)
    companion.fly(0.5, 0.0, 0.0)
    assert companion.set_mode(*OFFBOARD) == [0, 0]
    return companion


def test_px4_copter_mode_requires_setpoints_or_sticks():
    companion = px4()
    assert companion.set_mode(3) == [0, 1]
    companion.sticks(0.0)
    assert companion.set_mode(3) == [0, 0]
    companion = px4()
    assert companion.set_mode(*OFFBOARD) == [0, 1] and companion.px4_mode == "LOITER"
    companion.velocity(0.0, 0.0)
    companion.wait(1.2)
    assert companion.set_mode(*OFFBOARD) == [0, 1]  # the setpoints are too old
    companion.velocity(0.0, 0.0)
    assert companion.set_mode(*OFFBOARD) == [0, 0]
    assert companion.truth.mode == 6 << 16
    companion = px4()
    companion.velocity(0.0, 0.0)
    assert companion.command(176, 0, 6) == [0, 1] and companion.command(176, 128, 6) == [0, 1]
    assert companion.command(176, 209, 6) == [0, 0]
    # a disarmed vehicle accepts OFFBOARD without setpoints
    assert px4(start={"armed": False}).set_mode(*OFFBOARD) == [0, 0]


@pytest.mark.parametrize(
    ("speed", "rate", "flown", "turned", "crab", "vehicle"),
    [
        (3.0, 0.1, 2.80, 0.099, -13.0, {}),
        (5.0, 0.1, 4.55, 0.100, -11.0, {}),
        (5.0, -0.3, 3.77, -0.297, 18.0, {}),
        (5.0, 0.6, 3.41, 0.596, -23.0, {}),
        (8.0, 0.3, 6.04, 0.298, -18.0, {}),
        (3.0, 1.0, 1.9, 0.994, -28.0, {}),
        (5.0, 0.3, 5.27, 0.298, -12.0, {"drag_per_s": 0.1}),
    ],
)
def test_drag_reduces_speed_but_not_turn_of_px4_copter(speed, rate, flown, turned, crab, vehicle):
    companion = offboard(vehicle=vehicle)
    companion.fly(30.0, speed, rate)
    truth = companion.truth
    assert truth.turn_rate == pytest.approx(turned, rel=0.015)
    assert truth.ground_speed == pytest.approx(flown, rel=0.04 if vehicle == {} else 0.03)
    assert math.degrees(math.remainder(truth.course - truth.heading, math.tau)) == pytest.approx(
        crab, abs=4.0
    )


def test_px4_copter_keeps_height_only_with_vertical_velocity_loop():
    companion = offboard()
    companion.fly(60.0, 3.0, 0.1)
    assert 2.0 < companion.truth.down + 50.0 < 8.0
    companion.repeat(
        30.0, lambda: companion.velocity(3.0, 0.1, vz=0.5 * (-50.0 - companion.truth.down))
    )
    assert companion.truth.down == pytest.approx(-50.0, abs=0.3)


def test_offboard_failsafe_ends_when_setpoints_return():
    companion = offboard(gcs=True)
    companion.fly(5.0, 3.0, 0.1)
    companion.wait(0.95)
    assert companion.px4_mode == "OFFBOARD"
    companion.wait(0.05)
    assert companion.px4_mode == "RTL" and "Failsafe activated" in companion.texts()
    companion.stream(436, 100_000)
    companion.wait(0.2)
    report = companion.listen("CURRENT_MODE")[-1]
    assert (report.custom_mode, report.intended_custom_mode) == (PX4["RTL"], PX4["OFFBOARD"])
    companion.velocity(3.0, 0.1)
    assert companion.px4_mode == "OFFBOARD"
    # after the failsafe, setpoints return to OFFBOARD until another mode is commanded
    assert companion.set_mode(*LOITER) == [0, 0]
    companion.fly(2.0, 3.0, 0.1)
    assert companion.px4_mode == "LOITER"


@pytest.mark.parametrize(("action", "after"), [(0, "RTL"), (3, "RTL"), (4, "LAND"), (5, "LOITER")])
def test_offboard_failsafe_follows_its_parameter(action, after):
    companion = px4()
    value = struct.unpack("<f", struct.pack("<i", action))[0]
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", value, 6))
    assert companion.listen("PARAM_VALUE")[-1].param_value == value
    companion.velocity(0.0, 0.0)
    companion.set_mode(*OFFBOARD)
    companion.wait(1.1)
    assert companion.px4_mode == after


def test_px4_gps_loss_ends_velocity_control_after_five_seconds():
    companion = offboard(
        events=[{"at_s": 5.0, "action": "gps_off"}, {"at_s": 20.0, "action": "gps_on"}]
    )
    companion.fly(9.4, 3.0, 0.1)
    assert companion.px4_mode == "OFFBOARD"
    companion.fly(5.0, 3.0, 0.1)
    # without position the vehicle sinks
    assert companion.px4_mode == "ALTCTL" and companion.truth.down > -48.0
    companion.fly(6.0, 3.0, 0.1)
    assert companion.px4_mode == "OFFBOARD"
    companion = px4(events=[{"at_s": 1.0, "action": "gps_off"}])
    companion.attitude(7, thrust=HOVERING)
    assert companion.set_mode(*OFFBOARD) == [0, 0]
    companion.repeat(10.0, lambda: companion.attitude(7, thrust=HOVERING))
    assert companion.px4_mode == "OFFBOARD"


def test_px4_streams_at_onboard_rates_by_default():
    companion = aboard("px4_copter", vehicle={"default_streams": True})
    companion.wait(2.0)
    wanted = {
        "ATTITUDE": 100,
        "HIGHRES_IMU": 50,
        "LOCAL_POSITION_NED": 30,
        "VFR_HUD": 10,
        "TIMESYNC": 10,
    }
    assert {kind: len(companion.listen(kind)) / 2 for kind in wanted} == pytest.approx(
        wanted, abs=1
    )
    assert math.isnan(companion.listen("VFR_HUD")[0].airspeed)
    companion = px4()
    assert companion.stream(0, 100_000) == [4] and companion.stream(9999, 100_000) == [4]
    assert companion.stream(30, 20_000) == [0]


def test_px4_copter_sends_each_range_twice():
    companion = Station(
        build(vehicle={"profile": "px4_copter"}, ranging={"rate_hz": 5.0, "noise_m": 0.0})
    )
    companion.heartbeat()
    companion.wait(2.05)
    raw = companion.listen("DISTANCE_SENSOR", source=(1, 192))
    again = companion.listen("DISTANCE_SENSOR", source=(1, 1))
    assert len(raw) == len(again) == 11
    assert {m.id for m in again} == {1} and again[0].current_distance == raw[0].current_distance


def test_px4_copter_takes_off_and_lands():
    companion = px4(start={"armed": False, "north_m": 0.0})
    assert companion.command(22, 0, 0, 0, math.nan, math.nan, math.nan, 584.0 + 10.0) == [0]
    assert companion.command(400, 1) == [0]
    companion.wait(25.0)
    assert companion.truth.down == pytest.approx(-10.0, abs=0.5) and companion.px4_mode == "LOITER"
    assert companion.command(400, 0) == [1]  # disarming in the air is refused
    assert companion.command(21) == [0]
    companion.wait(40.0)
    assert not companion.truth.armed and companion.truth.down == pytest.approx(0.0, abs=0.1)


def test_px4_attitude_setpoints_turn_only_with_leading_yaw():
    companion = px4()
    companion.attitude(7, thrust=HOVERING)
    assert companion.set_mode(*OFFBOARD) == [0, 0]
    companion.repeat(5.0, lambda: companion.attitude(3, rates=(0.0, 0.0, 0.3), thrust=HOVERING))
    assert companion.truth.turn_rate == pytest.approx(0.0, abs=0.005)
    led = companion.truth.heading - 0.3 * companion.truth.time
    companion.repeat(
        8.0,
        lambda: companion.attitude(7, 0.1, 0.0, led + 0.3 * companion.truth.time, thrust=HOVERING),
    )
    assert companion.truth.turn_rate == pytest.approx(0.3, abs=0.005)
