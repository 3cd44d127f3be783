"""The emulated ArduPlane, with figures from flights of ArduPlane 4.6.3. It obeys a commanded bank
for 3 s, and holds height and airspeed itself."""

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, aboard

ROLL_ONLY = 0xC6


def plane(mode="GUIDED", **tables):
    return aboard("arduplane", mode, **tables)


IDEAL = {"turn_effectiveness": 1.0, "airspeed_scale": 1.0}


@pytest.mark.parametrize(
    ("rate", "vehicle", "flown"), [(0.1, {}, 0.0692), (-0.3, {}, -0.208), (0.19, IDEAL, 0.19)]
)
def test_plane_turn_rate_is_coordinated_rate_times_effectiveness(rate, vehicle, flown):
    companion = plane(vehicle=vehicle)
    companion.repeat(
        15.0, lambda: companion.attitude(ROLL_ONLY, math.atan(rate * 22 / 9.80665)), 10.0
    )
    assert companion.truth.turn_rate == pytest.approx(flown, rel=0.03 if vehicle == {} else 0.01)
    assert companion.truth.down == pytest.approx(-100.0, abs=0.25)


def test_plane_loiters_with_hard_bank_after_timeout():
    companion = plane()
    companion.repeat(20.0, lambda: companion.attitude(ROLL_ONLY, 0.0))
    companion.wait(2.9)
    assert abs(companion.truth.roll) < 0.01
    companion.wait(3.0)
    assert math.degrees(abs(companion.truth.roll)) > 35.0
    assert companion.texts() == [] and companion.truth.mode == 15
    companion.wait(120.0)
    truth = companion.truth
    # the plane loiters around the place where GUIDED was entered
    assert math.hypot(truth.north + 200.0, truth.east) == pytest.approx(60.0, abs=15.0)


def test_plane_limits_commanded_bank():
    companion = plane(vehicle={"max_bank_deg": 45.0})
    companion.stream(62, 200_000)
    companion.repeat(5.0, lambda: companion.attitude(ROLL_ONLY, 1.2))
    assert math.degrees(companion.truth.roll) == pytest.approx(44.7, abs=0.1)  # HELD
    assert companion.listen("NAV_CONTROLLER_OUTPUT")[-1].nav_roll == pytest.approx(45.0, abs=0.1)


def test_plane_in_loiter_ignores_setpoints():
    companion = plane("LOITER")
    companion.velocity(22.0, 0.2)
    companion.attitude(ROLL_ONLY, 0.2)
    assert companion.vehicle.setpoint_log == []
    companion.command(512, 148)
    assert not companion.listen("AUTOPILOT_VERSION")[0].capabilities & 128


def test_wind_changes_ground_speed_but_not_airspeed_of_plane():
    companion = plane(wind={"speed_mps": 8.0, "from_deg": 270.0})
    companion.stream(74, 500_000)
    speeds = []
    for _ in range(120):
        companion.repeat(0.5, lambda: companion.attitude(ROLL_ONLY, 0.3), 10.0)
        speeds.append(companion.truth.ground_speed)
        assert companion.truth.airspeed == pytest.approx(23.43, abs=0.1)
    # ground speed flown on firmware: 15.7 to 31.1 m/s
    assert (min(speeds), max(speeds)) == pytest.approx((15.4, 31.4), abs=0.5)
    assert companion.listen("VFR_HUD")[-1].airspeed == pytest.approx(22.0, abs=0.1)


def test_plane_keeps_commanded_heading_without_timeout():
    companion = plane()
    assert companion.command(43002, 1, 360.0) == [2] and companion.command(43002, 2, 90.0) == [2]
    assert companion.command(43002, 1, 90.0, 3.0) == [0]
    companion.wait(60.0)
    assert companion.truth.heading == pytest.approx(math.pi / 2, abs=0.02)
    assert companion.command(43000, 0, 26.0) == [0] and companion.command(43000, 1, 26.0) == [2]
    companion.wait(20.0)
    assert companion.truth.airspeed == pytest.approx(26.0 * 1.065, rel=0.01)


def test_plane_accepts_sticks_only_from_ground_station():
    companion = plane("FBWB")
    pilot = Station(companion.vehicle, 255, 190, link="gcs")
    companion.repeat(3.0, lambda: companion.sticks(0.37))
    assert pilot.truth.roll == 0.0
    pilot.repeat(3.0, lambda: pilot.sticks(0.37))
    assert math.degrees(pilot.truth.roll) == pytest.approx(24.05, abs=0.3)
    pilot.wait(6.0)
    assert abs(pilot.truth.roll) < 0.01  # the sticks have ended after RC_OVERRIDE_TIME
    override = mavlink.MAVLink_rc_channels_override_message(1, 1, 1685, *[65535] * 7)
    pilot.repeat(3.0, lambda: pilot.send(override))
    assert math.degrees(pilot.truth.roll) == pytest.approx(24.05, abs=0.3)


def test_plane_sends_streams_once_per_second_by_default():
    companion = plane()
    companion.wait(10.0)
    assert {kind: len(companion.listen(kind)) for kind in ("ATTITUDE", "VFR_HUD", "RAW_IMU")} == {
        "ATTITUDE": 10, "VFR_HUD": 10, "RAW_IMU": 10
    }  # fmt: skip
    # a stream at 100 Hz is refused: the limit is 40 Hz, because the main loop runs at 50 Hz
    assert companion.stream(30, 10_000) == [2]


def test_plane_without_gps_continues_and_changes_speed():
    companion = plane(events=[{"at_s": 1.0, "action": "gps_off"}])
    companion.repeat(15.0, lambda: companion.attitude(ROLL_ONLY, 0.3), 5.0)
    assert companion.truth.mode == 15 and companion.truth.roll == pytest.approx(0.3, abs=0.01)
    assert companion.set_mode(12) == [0]
    assert companion.command(178, 0, 25.0, -1) == [0]
    companion.wait(20.0)
    assert companion.truth.airspeed == pytest.approx(25.0 * 1.065, abs=0.1)
    assert companion.command(178, 0, 60.0, -1) == [4] and companion.command(43000, 0, 20.0) == [4]


def test_stuck_airspeed_sensor_changes_flown_speed():
    """Measured on 4.6.3 with a sensor stuck at 27 m/s for 22: the throttle closes (16.5 m/s of true
    airspeed on average), the sensor is disabled after 13 s (AP_Airspeed_Health.cpp), and the cruise
    throttle then gives 25.5 m/s. VFR_HUD shows 27 m/s throughout."""
    events = [
        {"at_s": 10.0, "action": "airspeed_stuck", "value": 27.0},
        {"at_s": 35.0, "action": "airspeed_good"},
    ]
    companion = aboard("arduplane", "LOITER", events=events)
    companion.stream(74, 200_000)
    companion.wait(16.0)
    assert companion.truth.airspeed == pytest.approx(17.5, abs=1.0)
    companion.wait(18.9)
    assert companion.truth.airspeed == pytest.approx(25.3, abs=0.3)
    assert {message.airspeed for message in companion.listen("VFR_HUD")[-30:]} == {27.0}
    assert companion.texts() == ["Airspeed sensor 1 failure. Disabling"]
    companion.wait(30.0)
    assert companion.texts()[1:] == ["Airspeed sensor 1 now OK. Re-enabled"]
    assert companion.truth.airspeed == pytest.approx(22.0 * 1.065, abs=0.5)


def test_stuck_airspeed_sensor_without_gps_stays_in_use():
    events = [
        {"at_s": 1.0, "action": "gps_off"},
        {"at_s": 10.0, "action": "airspeed_stuck", "value": 27.0},
    ]
    companion = aboard("arduplane", "LOITER", events=events)
    companion.wait(40.0)
    assert companion.texts() == [] and companion.truth.airspeed < 18.0
