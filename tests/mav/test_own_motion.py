"""Own motion from ATTITUDE, VFR_HUD and the IMU: frames, measurement times, stale values and
missing values."""

import random
from functools import partial
from itertools import pairwise
from math import atan2, cos, nan, pi, remainder, sin, sqrt

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.frames import compass_from_vector, heading_enu_from_yaw_ned
from circnav_mav.mav.own_motion import Attitude, Motion, OwnMotionSensor
from tests.rig import attitude as attitude_at_rest

RATE = 0.3
"""Yaw rate of the vehicle, rad/s."""


attitude = partial(attitude_at_rest, yawspeed=RATE)


def hud(**rest):
    fields = {
        "airspeed": 15.0,
        "groundspeed": 99.0,
        "heading": 0,
        "throttle": 0,
        "alt": 50.0,
        "climb": 0.1,
    } | rest
    return mavlink.MAVLink_vfr_hud_message(**fields)


@pytest.mark.parametrize(
    ("yaw", "course"),
    [
        (0.0, pi / 2),
        (pi / 2, 0.0),
        (-pi / 2, pi),
        (pi, -pi / 2),
        (pi / 4, pi / 4),
        (7.0, 2.5 * pi - 7.0),
    ],
)
def test_heading_converts_from_compass_to_enu_and_back(yaw, course):
    """Compass heading: clockwise from north, in [0, 2 pi). ENU heading: counter-clockwise from
    east, in (-pi, pi]."""
    assert heading_enu_from_yaw_ned(yaw) == pytest.approx(course)
    assert compass_from_vector(cos(course), sin(course)) == pytest.approx(yaw % (2 * pi))


@pytest.mark.parametrize("steered", [True, False])
@pytest.mark.parametrize("jump", [pi, -pi / 2, 0.5])
def test_yaw_reset_in_flight_causes_no_turn_rate(jump, steered):
    sensor = OwnMotionSensor()
    headings = []
    sensor.keeps_heading = steered
    for n in range(200):
        now = 0.1 * n
        yaw = remainder(RATE * now + (jump if 5.05 < now < 15.05 else 0.0), 2 * pi)
        assert sensor.receive(attitude(100 * n, yaw), now)
        headings.append(sensor.own(now, 15.0).heading)
        assert sensor.at(now).yaw == pytest.approx(yaw, abs=1e-6)
        counted = jump if steered and 5.05 < now < 15.05 else 0.0
        assert abs(remainder(sensor.jumped - counted, 2 * pi)) < 1e-6
    turns = [remainder(after - before, 2 * pi) for before, after in pairwise(headings)]
    assert (max(turns) - min(turns) < 1e-6) == steered


def test_own_motion_reports_rare_attitudes():
    for every, seldom in ((0.5, False), (1.5, True)):
        sensor = OwnMotionSensor()
        for n in range(20):
            sensor.receive(attitude(round(1000 * every * n), 0.0), every * n)
        assert sensor.seldom(every * 19 + 0.1) is seldom


def test_attitudes_rare_before_engagement_are_not_reported_after_it():
    """The autopilot answers the stream requests 0.1 s before the engagement."""
    sensor = OwnMotionSensor()
    reported = []
    times = [*(1.5 * n for n in range(7)), *(10 + 0.1 * n for n in range(100))]
    for now in times:
        sensor.keeps_heading = now > 10.05
        sensor.receive(attitude(round(1000 * now), 0.0), now)
        reported.append(sensor.seldom(now))
    assert any(reported[:7])
    assert not any(reported[8:])


def received(delays, boot_ms=0, seconds=20.0):
    """Return own motion and the true time (s) of its attitude, for attitudes at 20 Hz. delays():
    delay of the next attitude, s."""
    sensor = OwnMotionSensor()
    found = []
    sent = [(i / 20, (boot_ms + 50 * i) % 2**32) for i in range(round(20 * seconds))]
    for now, at, ms in sorted((at + delays(), at, ms) for at, ms in sent):
        if sensor.receive(attitude(ms, (RATE * at + pi) % (2 * pi) - pi), now):
            found.append((sensor.own(now, 15.0), at))
    return found


@pytest.mark.parametrize("boot_ms", [0, 2**32 - 8000])
@pytest.mark.parametrize("longest", [0.2, 0.5])
def test_attitude_is_dated_by_its_measurement_time(boot_ms, longest):
    """Tested also across the wrap of the vehicle's 32-bit milliseconds."""
    chance = random.Random(1)
    found = received(lambda: chance.uniform(0.0, longest), boot_ms)
    times = [own.time for own, _ in found]
    assert times == sorted(set(times))
    late = [own.time - at for own, at in found if at > 10]
    assert len(late) > 50
    assert max(late) < 0.15 * longest and min(late) > -1e-6


@pytest.mark.parametrize("jump_ms", [3_600_000, -3_600_000])
def test_vehicle_clock_jump_rejects_two_attitudes(jump_ms):
    sensor = OwnMotionSensor()
    used = []
    for i in range(200):
        ms = 10_000_000 + 50 * i + (jump_ms if i >= 100 else 0)
        used.append(sensor.receive(attitude(ms), i / 20))
    assert used[:100] == [True] * 100
    assert used[102:] == [True] * 98
    assert sensor.own(199 / 20, 15.0).time == pytest.approx(199 / 20, abs=0.06)


def test_attitude_quaternion_replaces_missing_attitude():
    """ATTITUDE_QUATERNION contains w, x, y, z. A yaw of 0.6 rad is (cos 0.3, 0, 0, sin 0.3).
    Heading and turn rate are in the paper's frame: counter-clockwise, from east."""
    q = {
        "q1": cos(0.3),
        "q2": 0.0,
        "q3": 0.0,
        "q4": sin(0.3),
        "rollspeed": 0.0,
        "pitchspeed": 0.0,
        "yawspeed": RATE,
    }
    sensor = OwnMotionSensor()
    assert sensor.receive(mavlink.MAVLink_attitude_quaternion_message(time_boot_ms=1000, **q), 1.0)
    own = sensor.own(1.0, 15.0)
    assert (own.heading, own.turn_rate, own.airspeed) == pytest.approx((pi / 2 - 0.6, -RATE, 15.0))
    assert sensor.receive(attitude(1050, 0.61), 1.05)
    assert not sensor.receive(attitude(1050, 0.61), 1.07)
    assert not sensor.receive(
        mavlink.MAVLink_attitude_quaternion_message(time_boot_ms=1050, **q), 1.05
    )
    for wrong in ({"q1": 0.0, "q4": 0.0}, {"q1": nan}):
        assert not sensor.receive(
            mavlink.MAVLink_attitude_quaternion_message(time_boot_ms=1100, **q | wrong), 1.1
        )


@pytest.mark.parametrize(
    ("altitude", "density"), [(0.0, 1.225), (1000.0, 1.1117), (3000.0, 0.90925)]
)
def test_true_airspeed_grows_in_thin_air(altitude, density):
    """Expected values from air densities (kg/m^3) in the tables of the standard atmosphere."""
    sensor = OwnMotionSensor()
    sensor.receive(hud(alt=altitude), 0.0)
    assert sensor.at(0.0).true_airspeed(22.0) == pytest.approx(
        22.0 * sqrt(1.225 / density), rel=1e-4
    )


def test_stale_own_motion_is_unknown():
    sensor = OwnMotionSensor()
    sensor.receive(hud(), 1.0)
    sensor.receive(attitude(0), 1.0)
    assert sensor.at(1.4).yaw is not None
    assert sensor.at(1.6).yaw is None and sensor.own(1.6, 15.0) is None
    assert sensor.at(2.4).airspeed == 15.0 and sensor.at(2.6).airspeed is None


FUTURE_STAMPS = [lambda t, ms=ms: t + (ms if t == 5000 else 0) for ms in (250, 800, 3_600_000)]
WRONG_CLOCKS = [lambda t: 0, lambda t: 5000, lambda t: t // 2, lambda t: 5 * t]


@pytest.mark.parametrize("hz", [10, 50])
@pytest.mark.parametrize("stamp", FUTURE_STAMPS + WRONG_CLOCKS)
def test_heading_is_available_despite_wrong_stamps(stamp, hz):
    sensor = OwnMotionSensor()
    known = []
    for i in range(20 * hz):
        sensor.receive(attitude(10_000 + stamp(1000 * i // hz)), i / hz)
        known.append(sensor.own(i / hz, 15.0) is not None)
    assert all(known)


def test_newest_attitude_of_backlog_is_used():
    sensor = OwnMotionSensor()
    for i in range(130):
        sensor.receive(attitude(10_000 + 50 * i, yaw=0.01 * i), i / 20 if i < 100 else 6.5)
    assert sensor.at(6.5).yaw == pytest.approx(1.29)
    assert not sensor.receive(attitude(11_000, yaw=3.0), 6.52)
    assert sensor.receive(attitude(16_550, yaw=0.5), 6.55)
    assert sensor.at(6.55).yaw == 0.5


@pytest.mark.parametrize(
    ("field", "unknown", "rubbish"),
    [
        ("airspeed", "airspeed", (nan, 0.0, 201.0, 3.4e38)),
        ("alt", "altitude", (nan, -2e5)),
        ("climb", "climb", (nan, 1e12)),
    ],
)
def test_implausible_air_data_is_unknown(field, unknown, rubbish):
    """PX4's copter sends NaN as airspeed, and ArduPilot 0 before take-off."""
    sensor = OwnMotionSensor()
    for value in rubbish:
        sensor.receive(hud(**{field: value}), 0.0)
        motion = sensor.at(0.1)
        known = {"airspeed": motion.airspeed, "altitude": motion.altitude, "climb": motion.climb}
        assert known == pytest.approx(
            {"airspeed": 15.0, "altitude": 50.0, "climb": 0.1, unknown: None}
        )


@pytest.mark.parametrize(
    "rubbish",
    [{"yaw": nan}, {"yaw": 7.0}, {"roll": -1e30}, {"pitchspeed": 51.0}, {"yawspeed": -3e38}],
)
def test_implausible_attitude_is_rejected(rubbish):
    assert not OwnMotionSensor().receive(attitude(0, **rubbish), 0.0)


@pytest.mark.parametrize("pitch", [0.0, 0.5, -1.0])
@pytest.mark.parametrize("roll", [0.0, 0.7, -0.7])
def test_yaw_rate_is_derivative_of_heading(roll, pitch):
    """Reference: the yaw after a small rotation by the body rates, from R_z(yaw) R_y(pitch)
    R_x(roll) exp(omega dt)."""
    q = 0.2
    r = 0.3
    dt = 1e-6
    x_axis = (1.0, r * dt, -q * dt)  # direction of the nose after dt, in the body axes before dt
    y = x_axis[1] * cos(roll) - x_axis[2] * sin(roll)
    z = x_axis[1] * sin(roll) + x_axis[2] * cos(roll)
    turned = atan2(y, cos(pitch) * x_axis[0] + sin(pitch) * z)
    assert Attitude(0.0, roll, pitch, 0.0, 0.0, q, r).yaw_rate == pytest.approx(
        turned / dt, rel=1e-4
    )


def imu(ms, force, type_="raw"):
    """Return the IMU message of an autopilot for a specific force in the body frame, m/s^2."""
    if type_ == "highres":
        return mavlink.MAVLink_highres_imu_message(1000 * ms, *force, *[0.0] * 10, 0xFFFF)
    counts = [round(value / 9.80665 * 1000) for value in force]
    if type_ == "raw":
        return mavlink.MAVLink_raw_imu_message(1000 * ms, *counts, *[0] * 6)
    return mavlink.MAVLink_scaled_imu_message(ms, *counts, *[0] * 6)


@pytest.mark.parametrize("type_", ["raw", "highres", "scaled"])
@pytest.mark.parametrize("yaw", [0.0, 2.1])
def test_imu_velocity_change_in_coordinated_turn_matches_calculation(type_, yaw):
    """Bank 0.4 rad, specific force g/cos(0.4) up in body axes and 0.5 m/s^2 along the nose. In 1 s
    the velocity changes by 0.5 m/s forward and by g tan(0.4) = 4.146 m/s to the right. Paper's
    frame: x east, y north."""
    sensor = OwnMotionSensor()
    for ms in range(0, 1001, 40):
        sensor.receive(attitude(ms, yaw, roll=0.4, yawspeed=0.0), ms / 1000)
        sensor.receive(imu(ms, (0.5, 0.0, -9.80665 / cos(0.4)), type_), ms / 1000)
    acceleration = sensor.own(1.0, 15.0).acceleration
    north, east = 0.5 * cos(yaw) - 4.146 * sin(yaw), 0.5 * sin(yaw) + 4.146 * cos(yaw)
    assert (acceleration.x, acceleration.y) == pytest.approx((east, north), abs=0.02)


def test_repeated_accelerations_are_used_until_vehicle_tilts():
    """A simulator without noise repeats the accelerations of a steady flight."""
    sensor = OwnMotionSensor()
    used = {}
    for ms in range(0, 10_001, 40):
        tilt = 0.1 if ms > 5000 else 0.0
        sensor.receive(attitude(ms, roll=tilt), ms / 1000)
        sensor.receive(imu(ms, (0.5, 0.0, -9.8)), ms / 1000)
        used[ms] = sensor.accelerations.used
    assert used[5000] == "RAW_IMU"
    assert used[10_000] == ""


def test_imu_integration_restarts_after_a_gap():
    sensor = OwnMotionSensor()
    since = set()
    for ms in (*range(0, 400, 40), *range(1000, 1400, 40)):
        sensor.receive(attitude(ms, yawspeed=0.0), ms / 1000)
        sensor.receive(imu(ms, (0.0, 0.0, -9.8)), ms / 1000)
        acceleration = sensor.own(ms / 1000, 15.0).acceleration
        since.add(None if acceleration is None else acceleration.since)
    # first value, start of the integration before the gap, and start after the gap
    assert len(since) == 3
    sensor.receive(imu(1400, (nan, 0.0, -9.8), "highres"), 10.0)
    assert sensor.own(1.4, 15.0).acceleration is None


def climbed(*, altitude: float | None, above_home: bool) -> Motion:
    """Return the motion after 10 s at 600 m, and a climb of 7 s with 2 m/s. altitude: reported
    during the climb, m; None: the true altitude. above_home: True if GLOBAL_POSITION_INT is
    sent."""
    sensor = OwnMotionSensor()
    now = 0.0
    for tick in range(86):
        now = 0.2 * tick
        height = max(0.0, 2.0 * (now - 10.0))
        climb = 2.0 if height else 0.0
        shown = 600.0 + height if altitude is None or not height else altitude
        if above_home:
            place = (round(1000 * now), 0, 0, 0, round(1000 * (20.0 + height)), 0, 0, 0, 0)
            sensor.receive(mavlink.MAVLink_global_position_int_message(*place), now)
        sensor.receive(hud(alt=shown, climb=climb), now)
    return sensor.at(now)


def test_altitude_follows_climb_when_autopilot_repeats_altitude():
    """Without GPS, ArduCopter repeats VFR_HUD.alt. The altitude above home goes on."""
    live = climbed(altitude=None, above_home=True)
    frozen = climbed(altitude=600.0, above_home=True)
    assert live.altitude == pytest.approx(614.0) and frozen.altitude == pytest.approx(614.0)
    assert frozen.above_home == pytest.approx(34.0)


def test_repeated_altitude_is_missing_during_climb():
    assert climbed(altitude=600.0, above_home=False).altitude is None
    assert climbed(altitude=None, above_home=False).altitude == pytest.approx(614.0)


def test_altitude_is_unknown_without_position_since_boot():
    """ArduPilot then sends VFR_HUD.alt = 0."""
    sensor = OwnMotionSensor()
    sensor.receive(hud(alt=0.0), 0.0)
    assert sensor.at(0.0).altitude is None


@pytest.mark.parametrize(("climbs", "used"), [((0.1, 0.2), None), ((0.0, 0.0), 27.0)])
def test_stuck_airspeed_is_missing_while_climb_rate_changes(climbs, used):
    sensor = OwnMotionSensor()
    for tick in range(20):
        sensor.receive(hud(airspeed=27.0, climb=climbs[tick % 2]), 0.2 * tick)
    assert sensor.at(3.8).airspeed == used
