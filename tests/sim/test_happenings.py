"""Events during a flight: failsafes, losses, reboots and weather."""

import itertools
import math
import statistics

import pytest
from circnav_sim.config import Target
from circnav_sim.world import target_at
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, aboard, build


def test_scripted_events_change_mode_and_disarm_vehicle():
    events = [{"at_s": 2.5, "action": "mode", "mode": "BRAKE"}, {"at_s": 3.6, "action": "disarm"}]
    companion = aboard(mode="GUIDED", events=events)
    companion.fly(3.45, 5.0, 0.1)
    assert companion.vehicle.setpoint_log[-1][0] <= 2.5
    assert [b.custom_mode for b in companion.listen("HEARTBEAT", source=(1, 1))] == [4, 4, 4, 17]
    companion.fly(12.0, 5.0, 0.1)
    assert not companion.truth.armed and companion.truth.down == 0.0
    assert not companion.listen("HEARTBEAT", source=(1, 1))[-1].base_mode & 128


@pytest.mark.parametrize(("profile", "mode"), [("arduplane", "FBWA"), ("px4_plane", "LOITER")])
def test_plane_rearmed_in_air_holds_its_new_height(profile, mode):
    events = [{"at_s": 1.0, "action": "disarm"}, {"at_s": 5.0, "action": "mode", "mode": "LOITER"}]
    companion = aboard(profile, mode, events=[*events, {"at_s": 5.0, "action": "arm"}])
    companion.wait(25.0)
    # the disarmed plane sinks for 4 s at 5 m/s from 100 m
    assert companion.truth.down == pytest.approx(-80.0, abs=1.0)


@pytest.mark.parametrize(
    ("profile", "guided", "after"),
    [("arducopter", 4, 6), ("arduplane", 15, 11), ("ardurover", 15, 4)],
)
def test_radio_failsafe_changes_mode_of_ardupilot(profile, guided, after):
    companion = aboard(profile, "GUIDED", events=[{"at_s": 1.0, "action": "rc_failsafe"}])
    companion.wait(0.9)
    assert companion.truth.mode == guided
    companion.wait(1.2)
    assert companion.truth.mode == after and companion.texts() == ["Radio Failsafe"]
    assert companion.listen("HEARTBEAT", source=(1, 1))[-1].system_status == 5


def test_gps_loss_lands_guided_copter_after_eight_seconds():
    companion = aboard(mode="GUIDED", events=[{"at_s": 2.0, "action": "gps_off"}])
    companion.stream(24, 1_000_000)
    companion.stream(193, 1_000_000)
    companion.fly(9.4, 5.0, 0.2)
    assert companion.truth.turn_rate == pytest.approx(0.2, abs=0.01)
    assert companion.listen("GPS_RAW_INT")[-1].fix_type == 1
    assert companion.listen("EKF_STATUS_REPORT")[-1].flags == 0x33F
    companion.fly(0.4, 5.0, 0.2)
    assert companion.set_mode(5) == [4] and companion.truth.mode == 4
    assert companion.texts() == ["Mode change to LOITER failed: requires position"]
    companion.forget()
    companion.fly(1.3, 5.0, 0.2)
    assert companion.truth.mode == 9 and companion.listen("EKF_STATUS_REPORT")[-1].flags == 0x25
    assert companion.texts() == ["EKF variance", "EKF Failsafe: changed to LAND Mode"]
    assert companion.set_mode(4) == [4] and companion.set_mode(2) == [0]
    companion.wait(7.0)
    assert companion.listen("EKF_STATUS_REPORT")[-1].flags == 0xA7


@pytest.mark.parametrize("bit", [0, 2])
def test_copter_altitude_freezes_fifteen_seconds_after_gps_loss(bit):
    """GCS_Common.cpp, send_vfr_hud and send_global_position_int: "we send stale data". Bit 1 of
    DEV_OPTIONS: vfr_hud_alt in ArduCopter/GCS_Mavlink.cpp. Measured on 4.6.3."""
    events = [
        {"at_s": 1.0, "action": "gps_off"},
        {"at_s": 18.0, "action": "throttle", "value": 0.9},
        {"at_s": 26.0, "action": "throttle", "value": 0.5},
        {"at_s": 32.0, "action": "gps_on"},
    ]
    companion = aboard(mode="ALT_HOLD", events=events)
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"DEV_OPTIONS", bit, 6))
    for number in (29, 33, 74):
        assert companion.stream(number, 100_000) == [0]
    companion.wait(22.0)
    hud = companion.listen("VFR_HUD")[-1]
    place = companion.listen("GLOBAL_POSITION_INT")[-1]
    assert hud.climb == pytest.approx(1.87, abs=0.05)
    height = -companion.truth.down
    assert height > 55.0 and place.relative_alt == pytest.approx(height * 1000, abs=2)
    assert place.alt == 634_000 and place.lat != 0
    assert hud.alt == pytest.approx(height if bit else 634.0, abs=0.01)
    # 0.1125 hPa per m at 640 m above sea level
    first, *_, last = companion.listen("SCALED_PRESSURE")
    assert (first.press_abs - last.press_abs) / 0.1125 == pytest.approx(height - 50, rel=0.02)
    companion.wait(11.0)
    assert companion.listen("VFR_HUD")[-1].alt > (60.0 if bit else 644.0)


def test_copter_started_without_gps_never_reports_altitude_changes():
    events = [{"at_s": 1.0, "action": "throttle", "value": 1.0}]
    companion = aboard("arducopter_nogps", events=events)
    companion.stream(74, 100_000)
    companion.wait(5.0)
    assert {message.alt for message in companion.listen("VFR_HUD")} == {634.0}
    assert companion.truth.down < -58.0


def test_loiter_is_refused_at_once_after_gps_loss():
    """The value of gps_off is the time until modes "require position" (position_ok in
    ArduCopter/system.cpp); the failsafe follows 8 s after the loss, as always."""
    companion = aboard(mode="GUIDED", events=[{"at_s": 2.0, "action": "gps_off", "value": 0.5}])
    companion.fly(2.7, 5.0, 0.0)
    assert companion.set_mode(5) == [4] and companion.truth.mode == 4
    companion.fly(7.0, 5.0, 0.0)
    assert companion.truth.mode == 4
    companion.fly(0.5, 5.0, 0.0)
    assert companion.truth.mode == 9


def test_scripted_event_clears_flags_of_one_ekf_report():
    companion = aboard(mode="GUIDED", events=[{"at_s": 2.5, "action": "ekf_zero"}])
    companion.stream(193, 1_000_000)
    companion.wait(5.5)
    reports = [message.flags for message in companion.listen("EKF_STATUS_REPORT")]
    assert reports == [0x33F, 0x33F, 0, 0x33F, 0x33F]
    assert companion.truth.mode == 4


def test_scripted_events_lose_mode_requests_or_their_acks():
    events = [
        {"at_s": 1.0, "action": "lose_mode_ack"},
        {"at_s": 2.0, "action": "lose_mode_request", "value": 2},
    ]
    companion = aboard(mode="ALT_HOLD", events=events)
    companion.wait(1.1)
    assert companion.set_mode(20) == [] and companion.truth.mode == 20
    assert companion.set_mode(2) == [0]
    companion.wait(1.0)
    assert [companion.set_mode(20) for _ in range(3)] == [[], [], [0]]


@pytest.mark.parametrize("profile", ["arducopter", "arducopter_nogps", "arduplane"])
def test_heading_error_grows_from_start_of_drift_event(profile):
    events = [{"at_s": 5.0, "action": "heading_drift", "value": 0.5}]
    companion = aboard(profile, events=events, sensors={"compass": False})
    companion.stream(30, 100_000)
    companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COMPASS_USE", -1))
    assert companion.listen("PARAM_VALUE")[-1].param_value == 0.0

    def error():
        reported = companion.listen("ATTITUDE")[-1].yaw
        return math.degrees(math.remainder(reported - companion.truth.heading, math.tau))

    companion.wait(5.0)
    before = error()
    companion.wait(40.0)
    assert error() - before == pytest.approx(20.0, abs=0.5)


def test_copter_turns_until_reported_heading_equals_setpoint():
    """A copter with a wrong compass turns its reported heading to the commanded one."""
    sensors = {"heading_bias_deg": 30.0}
    companion = aboard("arducopter_nogps", "GUIDED_NOGPS", sensors=sensors)
    companion.repeat(6.0, lambda: companion.attitude(7, 0.0, 0.0, math.radians(50)))
    assert math.degrees(companion.truth.heading) == pytest.approx(20.0, abs=0.5)


def test_gcs_failsafe_needs_heartbeats_of_its_own_station():
    companion = aboard(mode="GUIDED")
    operator = Station(companion.vehicle, 255, 190, link="gcs")
    operator.heartbeat(6)
    companion.fly(10.0, 3.0, 0.1)
    assert companion.truth.mode == 4  # the failsafe is off by default
    operator.send(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 1.0, 2))
    operator.heartbeat(6)
    for _ in range(4):
        companion.fly(1.2, 3.0, 0.1)
        companion.heartbeat()
    assert companion.truth.mode == 4
    companion.fly(0.5, 3.0, 0.1)
    assert companion.truth.mode == 6 and companion.texts() == ["GCS Failsafe"]


def test_reboot_resets_clock_streams_and_routes():
    events = [{"at_s": 5.0, "action": "reboot", "value": 3.0}]
    companion = Station(build(start={"mode": "GUIDED"}, truth={"rate_hz": 0}, events=events))
    companion.heartbeat()
    companion.stream(30, 100_000)
    companion.wait(5.0)
    companion.forget()
    assert companion.set_mode(4) == []
    companion.wait(2.9)
    assert companion.listen() == []
    companion.wait(2.2)
    beats = companion.listen(source=(1, 1))
    assert {m.get_type() for m in beats} == {"HEARTBEAT"}  # after the reboot no streams are sent
    # no ranges are forwarded to a component that has not sent since the reboot
    assert companion.listen("DISTANCE_SENSOR") == []
    assert beats[-1].custom_mode == 0 and not beats[-1].base_mode & 128
    companion.command(512, 2)
    assert companion.listen("SYSTEM_TIME")[-1].time_boot_ms == 2100


def test_autopilot_continues_flight_while_its_transmission_is_muted():
    events = [
        {"at_s": 1.0, "action": "mute_autopilot"},
        {"at_s": 3.0, "action": "unmute_autopilot"},
    ]
    companion = aboard(mode="GUIDED", events=events)
    companion.fly(1.0, 5.0, 0.1)
    companion.forget()
    companion.fly(1.9, 5.0, 0.1)
    assert companion.listen() == [] and companion.truth.ground_speed == pytest.approx(5.0)
    companion.fly(1.2, 5.0, 0.1)
    assert companion.listen("HEARTBEAT", source=(1, 1)) != []


def test_scripted_event_sets_charge_of_draining_battery():
    battery = {"percent": 80.0, "drain_percent_per_min": 6.0}
    companion = aboard(
        battery=battery, events=[{"at_s": 100.0, "action": "battery", "value": 15.0}]
    )
    companion.stream(147, 1_000_000)
    companion.wait(60.0)
    assert companion.listen("BATTERY_STATUS")[-1].battery_remaining == 74
    companion.wait(45.0)
    assert companion.listen("BATTERY_STATUS")[-1].battery_remaining in (14, 15)


def test_gusts_have_their_strength_and_correlation_time():
    wind = {"speed_mps": 5.0, "from_deg": 90.0, "gust_rms_mps": 1.5, "gust_time_s": 2.0}
    air = build(seed=4, wind=wind)._flight.air
    blown = []
    for _ in range(20_000):
        air.gust()
        blown.append(air.velocity)
    north, east = zip(*blown[100:], strict=True)
    assert statistics.fmean(east) == pytest.approx(-5.0, abs=0.3)
    assert statistics.pstdev(north) == pytest.approx(1.5, rel=0.1)
    lagged = statistics.correlation(north[:-20], north[20:])  # samples 2 s apart
    assert lagged == pytest.approx(math.exp(-1), abs=0.08)


def test_target_turns_and_accelerates_along_its_course():
    turning = Target(velocity_north_mps=2.0, turn_rate_deg_s=90.0)
    assert target_at(turning, 4.0)[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    # a positive turn rate is clockwise
    assert target_at(turning, 1.0)[:2] == pytest.approx((2.0 / (math.pi / 2), 2.0 / (math.pi / 2)))
    faster = Target(velocity_east_mps=1.0, acceleration_mps2=0.5)
    assert target_at(faster, 4.0)[:2] == pytest.approx((0.0, 1.0 * 4 + 0.25 * 16))
    both = Target(velocity_north_mps=1.0, acceleration_mps2=0.3, turn_rate_deg_s=10.0)
    path = [target_at(both, t / 1000) for t in range(5001)]
    speeds = [math.dist(a, b) * 1000 for a, b in itertools.pairwise(path)]
    assert (speeds[0], speeds[-1]) == pytest.approx((1.0, 2.5), abs=0.01)


@pytest.mark.parametrize(("profile", "guided"), [("arducopter", 4), ("ardurover", 15)])
def test_guided_without_gps_needs_odometry_with_an_origin(profile, guided):
    companion = aboard(profile, "ACRO", vehicle={"gps": False, "odometry": True})
    assert companion.set_mode(guided) == [4]
    companion.send(mavlink.MAVLink_set_gps_global_origin_message(1, -353632621, 1491652374, 584000))
    assert companion.set_mode(guided) == [0]
    companion.fly(5.0, 3.0, 0.2)
    assert companion.truth.turn_rate == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize(("sensor", "shown"), [(False, 5.0), (True, math.hypot(5.0, 8.0))])
def test_copter_reports_ground_speed_without_airspeed_sensor(sensor, shown):
    wind = {"speed_mps": 8.0, "from_deg": 90.0}
    companion = aboard(mode="GUIDED", vehicle={"airspeed_sensor": sensor}, wind=wind)
    companion.stream(74, 100_000)
    companion.fly(2.0, 5.0, 0.0)
    assert companion.listen("VFR_HUD")[-1].airspeed == pytest.approx(shown, abs=0.01)


def test_sensor_errors_change_reports_but_not_truth():
    sensors = {
        "heading_bias_deg": 10.0,
        "heading_drift_deg_s": 0.5,
        "gyro_scale": 1.1,
        "airspeed_noise_mps": 0.3,
    }
    companion = aboard("arduplane", "GUIDED", sensors=sensors)
    companion.stream(74, 100_000)
    companion.repeat(20.0, lambda: companion.attitude(0xC6, 0.0))
    reported = companion.listen("ATTITUDE")[-1].yaw
    assert math.degrees(reported - companion.truth.heading) == pytest.approx(20.0, abs=0.6)
    assert statistics.stdev(m.airspeed for m in companion.listen("VFR_HUD")) == pytest.approx(
        0.3, abs=0.08
    )
    companion.repeat(5.0, lambda: companion.attitude(0xC6, 0.3))
    last = companion.listen("ATTITUDE")[-1]
    rate = last.pitchspeed * math.sin(last.roll) + last.yawspeed * math.cos(last.roll)
    assert rate == pytest.approx(1.1 * companion.truth.turn_rate, rel=0.02)


TURNS = {
    "good": 0.2,
    "straight": 0.0,
    "turning": math.radians(12),
    "hovering": 0.0,
    "reversed": -0.2,
    "weak": 0.02,
}


@pytest.mark.parametrize("profile", ["arducopter", "ardurover", "px4_copter"])
@pytest.mark.parametrize("state", [*TURNS, "frozen"])
def test_steering_faults_replace_the_commanded_turn(profile, state):
    events = [{"at_s": 3.0, "action": f"steering_{state}"}]
    companion = aboard(profile, "OFFBOARD" if profile == "px4_copter" else "GUIDED", events=events)
    companion.fly(3.2, 3.0, 0.1)
    companion.fly(4.0, 3.0, 0.2)
    assert companion.truth.turn_rate == pytest.approx(TURNS.get(state, 0.1), abs=0.02)
    assert companion.truth.ground_speed == pytest.approx(
        0.0 if state == "hovering" else 3.0, abs=0.5
    )


def test_weak_steering_fault_reduces_turn_rate_of_rover():
    events = [
        {"at_s": 1.0, "action": "steering_weak", "value": 0.4},
        {"at_s": 6.0, "action": "steering_weak", "value": 0.15},
        {"at_s": 11.0, "action": "steering_good"},
    ]
    companion = aboard("ardurover", "GUIDED", events=events)
    flown = []
    for _ in range(3):
        companion.fly(5.5, 3.0, 0.3)
        flown.append(companion.truth.turn_rate / 0.3)
    assert flown == pytest.approx([0.4, 0.15, 1.0], rel=0.02)


@pytest.mark.parametrize(("profile", "lean"), [("arducopter", 12.0), ("px4_copter", 20.0)])
def test_copter_airspeed_is_limited_by_its_lean(profile, lean):
    """At the largest airspeed the drag equals g tan(lean). The drag is proportional to the airspeed
    v on PX4, and to v (1 + v/8) on ArduPilot."""
    wind = {"speed_mps": 4.0, "from_deg": 0.0}
    airframe = {"dynamics": "realistic", "max_lean_deg": lean, "drag_per_s": 0.4}
    mode = "OFFBOARD" if profile == "px4_copter" else "GUIDED"
    companion = aboard(profile, mode, wind=wind, vehicle=airframe)
    companion.fly(25.0, 8.0, 0.0)
    fastest = 9.80665 * math.tan(math.radians(lean)) / 0.4
    if profile == "arducopter":
        fastest = (math.sqrt(1 + fastest / 2) - 1) * 4  # solution of v (1 + v / 8) = fastest
    assert companion.truth.airspeed == pytest.approx(min(fastest, 12.0), rel=0.06)
    name = "MPC_TILTMAX_AIR" if profile == "px4_copter" else "ANGLE_MAX"
    assert companion.vehicle._flight.autopilot.params[name] == lean * (
        1 if profile == "px4_copter" else 100
    )
