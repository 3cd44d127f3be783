"""Accelerometers, gusts and the error of a velocity estimate: what an inertial sensor feels of a flight."""

import itertools
import math
import statistics
from typing import Any

import pytest

from sim.body import GRAVITY
from sim.vehicle import Truth
from tests.sim.station import Station, build

QUIET = {"truth": {"rate_hz": 0}, "ranging": {"rate_hz": 0.0}}
EXACT = {"accel_noise_mps2": 0.0, "gyro_noise_deg_s": 0.0, "accel_bias_mps2": 0.0, "attitude_error_deg": 0.0}
FIELDS = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")
G = 9.80665


def si(message: Any) -> list[float]:
    """Forward, right, down in m/s^2, then rad/s, of any of the three messages."""
    values = [getattr(message, name) for name in FIELDS]
    if message.get_type() == "HIGHRES_IMU":
        return values
    return [value * 1e-3 * G for value in values[:3]] + [value * 1e-3 for value in values[3:]]


@pytest.mark.parametrize(
    ("profile", "number", "kind"),
    [
        ("arducopter", 27, "RAW_IMU"),
        ("arduplane", 116, "SCALED_IMU2"),
        ("ardurover", 27, "RAW_IMU"),
        ("px4_copter", 105, "HIGHRES_IMU"),
        ("px4_plane", 105, "HIGHRES_IMU"),
    ],
)
def test_at_rest_the_accelerometers_feel_one_g_upwards(profile: str, number: int, kind: str) -> None:
    """Noise about a bias of 0.05 .. 0.1 m/s^2 that the seed draws and keeps: 0.2 m/s^2, and what SIH sends."""
    level = {"attitude_error_deg": 0.0}
    companion = Station(build(vehicle={"profile": profile}, start={"armed": False}, sensors=level, **QUIET))
    assert companion.command(511, number, 25_000) == [0]
    companion.wait(20.0)
    readings = list(zip(*[si(message) for message in companion.listen(kind)], strict=True))
    assert len(readings[0]) >= 790
    for values, rest in zip(readings, (0, 0, -G, 0, 0, 0), strict=True):
        assert statistics.mean(values) == pytest.approx(rest, abs=0.13)
    assert all(abs(statistics.mean(values)) > 0.03 for values in readings[:2])
    noise = (0.36, 1.15, 0.99, 0.084, 0.042, 0.0185) if profile.startswith("px4") else (0.2, 0.2, 0.2, 0.0, 0.0, 0.0)
    for values, rms in zip(readings, noise, strict=True):
        assert statistics.pstdev(values) == pytest.approx(rms, rel=0.15, abs=1e-3)


def test_px4_streams_it_fifty_times_a_second_and_a_plane_of_ardupilot_once() -> None:
    for profile, kind, rate in (("px4_copter", "HIGHRES_IMU", 50), ("arduplane", "RAW_IMU", 1)):
        companion = Station(build(vehicle={"profile": profile}, **QUIET))
        companion.wait(10.0)
        assert len(companion.listen(kind)) == pytest.approx(rate * 10, abs=1)
    companion = Station(build(**QUIET))
    companion.wait(2.0)
    assert not companion.listen("RAW_IMU", "SCALED_IMU2")  # a copter sends nothing unasked


def turning(**sensors: Any) -> list[float]:
    """What the IMU of an ideal plane reads in a turn with 30 deg of bank."""
    vehicle = {"profile": "arduplane", "dynamics": "unicycle"}
    companion = Station(build(vehicle=vehicle, start={"mode": "GUIDED"}, sensors=EXACT | sensors, **QUIET))
    companion.command(511, 27, 40_000)
    companion.repeat(6.0, lambda: companion.attitude(0xC6, math.radians(30)))
    return si(companion.listen("RAW_IMU")[-1])


def test_a_coordinated_turn_presses_straight_into_the_seat() -> None:
    x, y, z, p, q, r = turning()
    turn = G * math.tan(math.radians(30)) / (22.0 * 1.065)
    assert (y, z) == (pytest.approx(0.0, abs=0.02), pytest.approx(-G / math.cos(math.radians(30)), abs=0.03))
    assert x == pytest.approx(G * math.sin(0.03), abs=0.05)  # the nose is held 0.03 rad above the path
    assert (p, q, r) == (
        pytest.approx(-turn * 0.03, abs=2e-3),
        pytest.approx(turn / 2, abs=2e-3),
        pytest.approx(turn * math.cos(math.radians(30)), abs=2e-3),
    )


def test_a_sensor_that_lies() -> None:
    x, y, z, p, q, _ = turning()
    assert turning(imu="rotated")[:5] == pytest.approx([y, -x, z, q, -p], abs=0.02)
    assert turning(imu="clipped")[2] == pytest.approx(-8.0, abs=0.01)
    frozen = turning(imu="frozen")  # as in the straight flight it began with
    assert frozen[2] == pytest.approx(-G, abs=0.05) and frozen[5] < 0.05
    assert turning(accel_bias_mps2=0.5)[2] in (
        pytest.approx(z - 0.5, 0.01),
        pytest.approx(z + 0.5, 0.01),
    )
    shaken = turning(accel_vibration_mps2=20.0)
    assert max(abs(a - b) for a, b in zip(shaken[:3], (x, y, z), strict=True)) > 5.0


def test_a_sensor_begins_to_lie_in_flight() -> None:
    events = [{"at_s": 1.0, "action": "imu_frozen"}, {"at_s": 2.0, "action": "imu_good"}]
    companion = Station(build(vehicle={"profile": "px4_copter"}, events=events, **QUIET))
    companion.wait(3.0)
    seen = {round(m.time_usec / 1e6, 2): m.zacc for m in companion.listen("HIGHRES_IMU")}
    assert seen[1.1] == seen[1.9] and seen[0.5] != seen[0.9] and seen[2.1] != seen[2.9]


@pytest.mark.parametrize("profile", ["arducopter", "arduplane", "ardurover", "px4_copter"])
def test_accelerometers_and_attitude_add_up_to_the_change_of_velocity(profile: str) -> None:
    """Turned to NED by ATTITUDE_QUATERNION and with gravity added; in gusts, hard turns and changes of speed."""
    vehicle = {"profile": profile, "dynamics": "realistic"}
    wind = {"speed_mps": 4.0, "gust_rms_mps": 2.0}
    vehicle_built = build(
        vehicle=vehicle, start={"mode": "GUIDED"} if "px4" not in profile else {}, wind=wind, sensors=EXACT, **QUIET
    )
    companion = Station(vehicle_built)
    if profile == "px4_copter":
        companion.fly(0.5, 0.0, 0.0)
        assert companion.command(176, 1, 6) == [0, 0]
    for number in (31, 105 if profile == "px4_copter" else 27):
        assert companion.command(511, number, 20_000 if profile == "px4_copter" else 40_000) == [0]
    start, north, east = companion.vehicle.time, 0.0, 0.0
    step = 0.02 if profile == "px4_copter" else 0.04
    companion.forget()
    for tick in range(round(8.0 / step)):
        if tick == 3:
            before = velocity(companion.vehicle.truth)
            north = east = 0.0
        turn = 0.5 if tick * step < 4.0 else -0.4
        if profile == "arduplane":
            companion.attitude(0xC6, turn)
        else:
            companion.velocity(3.0, turn)
        companion.vehicle.advance(start + (tick + 1) * step)
        attitude, imu = companion.listen("ATTITUDE_QUATERNION"), companion.listen("RAW_IMU", "HIGHRES_IMU")
        if attitude and imu:
            a_north, a_east = to_north_east(attitude[-1], si(imu[-1]))
            north, east = north + a_north * step, east + a_east * step
        companion.forget()
    after = velocity(companion.vehicle.truth)
    moved = math.dist(before, after)
    assert moved > 1.0
    assert math.dist((north, east), (after[0] - before[0], after[1] - before[1])) < 0.1 + 0.1 * moved


def velocity(truth: Truth) -> tuple[float, float]:
    return truth.ground_speed * math.cos(truth.course), truth.ground_speed * math.sin(truth.course)


def to_north_east(attitude: Any, body: list[float]) -> tuple[float, float]:
    """A vector from the vehicle's axes to NED by the quaternion's rotation matrix."""
    w, x, y, z = attitude.q1, attitude.q2, attitude.q3, attitude.q4
    f, r, d = body[:3]
    return (
        (1 - 2 * (y * y + z * z)) * f + 2 * (x * y - w * z) * r + 2 * (x * z + w * y) * d,
        2 * (x * y + w * z) * f + (1 - 2 * (x * x + z * z)) * r + 2 * (y * z - w * x) * d,
    )


def test_a_plane_turns_into_a_side_gust_and_is_carried_along_later() -> None:
    """A gust of 3 m/s across the nose: 7.3 deg of slip at once, the ground velocity follows by a share and smoothly."""
    events = [{"at_s": 1.0, "action": "wind", "value": 3.0}]
    vehicle = {"profile": "arduplane", "airspeed_scale": 1.0}
    companion = Station(build(vehicle=vehicle, start={"mode": "FBWA"}, wind={"from_deg": 90.0}, events=events, **QUIET))
    companion.vehicle.advance(0.99)
    truths = []
    for tick in range(300):
        companion.vehicle.advance(1.0 + tick * 0.01)
        truths.append(companion.vehicle.truth)
    east = [velocity(truth)[1] for truth in truths]
    assert abs(east[1]) < 0.3 and -2.0 < east[-1] < -0.5
    assert max(abs(b - a) for a, b in itertools.pairwise(east)) < 0.12  # 0.1 rad of slip: some 9 m/s^2
    assert 0.05 < math.asin(3.0 / 22.0) - truths[-1].heading < 0.1  # from the right: to the right, some of it
    assert truths[2].airspeed == pytest.approx(math.hypot(22.0, 3.0), abs=0.1)


def test_a_head_gust_is_airspeed_first_and_ground_speed_later() -> None:
    events = [{"at_s": 1.0, "action": "wind", "value": 4.0}]
    vehicle = {"profile": "arduplane", "airspeed_scale": 1.0}
    companion = Station(build(vehicle=vehicle, start={"mode": "FBWA"}, events=events, **QUIET))
    companion.vehicle.advance(1.05)
    struck = companion.vehicle.truth
    companion.vehicle.advance(4.0)
    later = companion.vehicle.truth
    companion.vehicle.advance(20.0)
    settled = companion.vehicle.truth
    assert struck.airspeed == pytest.approx(26.0, abs=0.2) and struck.ground_speed == pytest.approx(22.0, abs=0.2)
    assert 19.0 < later.ground_speed < 20.5 and settled.airspeed == pytest.approx(22.0, abs=0.05)


@pytest.mark.parametrize(("profile", "most"), [("arducopter", 1.0), ("px4_copter", 2.5)])
def test_a_gust_pushes_a_copter_until_its_loop_leans_against_it(profile: str, most: float) -> None:
    events = [{"at_s": 1.0, "action": "wind", "value": 5.0}]
    vehicle = {"profile": profile, "dynamics": "realistic"}
    companion = Station(build(vehicle=vehicle, start={"mode": "LOITER"}, sensors=EXACT, events=events, **QUIET))
    speeds = []
    for tick in range(300):
        companion.vehicle.advance(0.9 + tick * 0.05)
        speeds.append(velocity(companion.vehicle.truth)[0])
    assert speeds[2] == 0.0 and -most < min(speeds) < -0.05 and abs(speeds[-1]) < 0.05
    force = companion.vehicle._flight.specific_force()
    assert force[0] < -0.5 and math.hypot(*force) == pytest.approx(GRAVITY, abs=0.02)  # leans, and feels it


def test_px4s_estimate_under_sih_is_off_as_the_firmwares_is_and_flown_by() -> None:
    """Flown: 0.9 .. 1.1 deg of roll, 0.18 .. 0.24 m/s along the nose, 1.0 .. 1.8 deg of heading; half of the roll's
    error is left after 2 s, nothing after 5."""
    companion = Station(build(vehicle={"profile": "px4_copter"}, **QUIET))
    companion.fly(0.5, 0.0, 0.0)
    companion.command(176, 1, 6)
    companion.fly(10.0, 5.0, 0.0)
    flown, speeds, rolls, headings = [], [], [], []
    for _ in range(1200):
        companion.fly(0.5, 5.0, 0.0)
        true, told = companion.vehicle.truth, companion.listen("ATTITUDE")[-1]
        speeds.append(companion.listen("LOCAL_POSITION_NED")[-1].vx - velocity(true)[0])
        companion.forget()
        flown.append(velocity(true)[0])
        rolls.append(math.degrees(told.roll - true.roll))
        headings.append(math.degrees(math.remainder(told.yaw - true.heading, math.tau)))
    assert statistics.pstdev(rolls) == pytest.approx(1.0, abs=0.2)
    assert statistics.pstdev(speeds) == pytest.approx(0.23, abs=0.06)
    assert statistics.pstdev(headings) == pytest.approx(1.3, abs=0.4)
    assert 0.1 < statistics.pstdev(flown) < 0.35  # the loop holds what it believes
    assert statistics.correlation(rolls[:-4], rolls[4:]) == pytest.approx(0.6, abs=0.15)
    assert abs(statistics.correlation(rolls[:-10], rolls[10:])) < 0.2
