"""The emulated IMU in flight: accelerometers, gusts, and the errors of PX4's estimates."""

import itertools
import math
import statistics

import pytest
from scipy.spatial.transform import Rotation

from tests.sim.station import EXACT, QUIET, Station, aboard, build

FLAWLESS = EXACT | {"accel_noise_mps2": 0.0, "accel_bias_mps2": 0.0}
G = 9.80665
RAW_IMU = 27
HIGHRES_IMU = 105


def si(message):
    """Return acceleration (m/s^2) and turn rate (rad/s) in the order forward, right, down, from any
    of the three IMU messages."""
    values = [
        getattr(message, name) for name in ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")
    ]
    if message.get_type() == "HIGHRES_IMU":
        return values
    return [value * 1e-3 * G for value in values[:3]] + [value * 1e-3 for value in values[3:]]


@pytest.mark.parametrize(
    ("profile", "number", "kind"),
    [
        ("arducopter", 27, "RAW_IMU"),
        ("arduplane", 116, "SCALED_IMU2"),
        ("px4_copter", 105, "HIGHRES_IMU"),
        ("px4_plane", 105, "HIGHRES_IMU"),
    ],
)
def test_accelerometers_at_rest_measure_one_g(profile, number, kind):
    """The bias is 0.05 to 0.1 m/s^2 and depends on the seed. The noise is 0.2 m/s^2 for ArduPilot,
    and that of SIH for PX4."""
    companion = aboard(profile, start={"armed": False}, sensors={"attitude_error_deg": 0.0})
    assert companion.stream(number, 25_000) == [0]
    companion.wait(20.0)
    readings = list(zip(*[si(message) for message in companion.listen(kind)], strict=True))
    assert len(readings[0]) >= 790
    noise = (
        (0.36, 1.15, 0.99, 0.084, 0.042, 0.0185)
        if profile.startswith("px4")
        else (0.2, 0.2, 0.2, 0.0, 0.0, 0.0)
    )
    for values, rest, rms in zip(readings, (0, 0, -G, 0, 0, 0), noise, strict=True):
        assert statistics.mean(values) == pytest.approx(rest, abs=0.13)
        assert statistics.pstdev(values) == pytest.approx(rms, rel=0.15, abs=1e-3)
    assert all(abs(statistics.mean(values)) > 0.03 for values in readings[:2])


def turning(**sensors):
    """Return the IMU measurement of an ideal plane in a turn with 30 deg of bank."""
    companion = aboard(
        "arduplane", "GUIDED", vehicle={"dynamics": "unicycle"}, sensors=FLAWLESS | sensors
    )
    companion.stream(RAW_IMU, 40_000)
    companion.repeat(6.0, lambda: companion.attitude(0xC6, math.radians(30)))
    return si(companion.listen("RAW_IMU")[-1])


def test_coordinated_turn_has_no_lateral_force():
    x, y, z, *rates = turning()
    turn = G * math.tan(math.radians(30)) / (22.0 * 1.065)
    assert (y, z) == (
        pytest.approx(0.0, abs=0.02),
        pytest.approx(-G / math.cos(math.radians(30)), abs=0.03),
    )
    assert x == pytest.approx(0.0, abs=0.05)
    assert rates == pytest.approx([0.0, turn / 2, turn * math.cos(math.radians(30))], abs=2e-3)


def test_imu_faults_change_measured_acceleration():
    x, y, z, p, q, _ = turning()
    assert turning(imu="rotated")[:5] == pytest.approx([y, -x, z, q, -p], abs=0.02)
    assert turning(imu="clipped")[2] == pytest.approx(-8.0, abs=0.01)
    # the frozen IMU repeats the value of the straight flight before the turn
    frozen = turning(imu="frozen")
    assert frozen[2] == pytest.approx(-G, abs=0.05) and frozen[5] < 0.05
    assert abs(turning(accel_bias_mps2=0.5)[2] - z) == pytest.approx(0.5, abs=0.12)
    shaken = turning(accel_vibration_mps2=20.0)
    assert max(abs(a - b) for a, b in zip(shaken[:3], (x, y, z), strict=True)) > 5.0


def test_accelerometer_fault_affects_only_first_imu():
    """Measured on 4.6.3 with SIM_ACC_FAIL_MSK 1: RAW_IMU keeps its accelerations, its gyros and
    SCALED_IMU2 continue, and the copter flies on its second IMU (send_raw_imu in GCS_Common.cpp is
    always the first). SCALED_IMU3 is all zero on a board with two IMUs and three compasses."""
    for state in ("frozen", "zero"):
        events = [{"at_s": 2.0, "action": f"imu_first_{state}"}]
        vehicle = {"dynamics": "realistic"}
        companion = aboard(mode="GUIDED", vehicle=vehicle, events=events)
        for number in (27, 116, 129):
            assert companion.stream(number, 100_000) == [0]
        companion.fly(2.05, 5.0, 0.0)
        companion.forget()
        companion.fly(4.0, 5.0, 0.3)
        first = [si(message) for message in companion.listen("RAW_IMU")]
        second = [si(message) for message in companion.listen("SCALED_IMU2")]
        assert len({tuple(one[:3]) for one in first}) == 1
        assert (first[0][:3] == [0.0, 0.0, 0.0]) == (state == "zero")
        assert len({tuple(one[:3]) for one in second}) > 30
        assert first[-1][5] == second[-1][5] == pytest.approx(0.3, abs=0.03)
        third = companion.listen("SCALED_IMU3")[-1]
        assert (third.xacc, third.yacc, third.zacc) == (0, 0, 0)
        assert companion.truth.turn_rate == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("gps", [True, False])
def test_accelerometer_bias_tilts_estimated_attitude_without_gps(gps):
    """Without GPS, EKF3 takes a bias for gravity: 0.3 m/s^2 are 1.75 deg. The levelled copter then
    leans and drifts."""
    profile = "arducopter" if gps else "arducopter_nogps"
    vehicle = {"dynamics": "realistic"}
    events = [{"at_s": 1.0, "action": "accel_bias", "value": 0.3}]
    companion = aboard(profile, "ALT_HOLD", vehicle=vehicle, sensors=FLAWLESS, events=events)
    for number in (27, 30, 116):
        companion.stream(number, 100_000)
    companion.wait(60.0)
    attitude = companion.listen("ATTITUDE")[-1]
    error = math.degrees(attitude.roll - companion.truth.roll)
    for kind in ("RAW_IMU", "SCALED_IMU2"):
        force = companion.vehicle._flight.specific_force()
        x, y, *_ = si(companion.listen(kind)[-1])
        assert (x - force[0], y - force[1]) == pytest.approx((0.3, 0.3), abs=0.02)
    assert abs(error) == pytest.approx(0.0 if gps else 1.75, abs=0.5)


def test_imu_fault_begins_and_ends_in_flight():
    events = [{"at_s": 1.0, "action": "imu_frozen"}, {"at_s": 2.0, "action": "imu_good"}]
    companion = Station(build(vehicle={"profile": "px4_copter"}, events=events, **QUIET))
    companion.wait(3.0)
    seen = {round(m.time_usec / 1e6, 2): m.zacc for m in companion.listen("HIGHRES_IMU")}
    assert seen[1.1] == seen[1.9] and seen[0.5] != seen[0.9] and seen[2.1] != seen[2.9]


@pytest.mark.parametrize(
    ("profile", "step", "imu"),
    [
        ("arducopter", 0.04, RAW_IMU),
        ("arduplane", 0.04, RAW_IMU),
        ("ardurover", 0.04, RAW_IMU),
        ("px4_copter", 0.02, HIGHRES_IMU),
    ],
)
def test_imu_and_attitude_integrate_to_velocity(profile, step, imu):
    """The test rotates the specific force to NED by ATTITUDE_QUATERNION, adds gravity and
    integrates, in gusts, hard turns and changes of speed."""
    px4 = profile == "px4_copter"
    wind = {"speed_mps": 4.0, "gust_rms_mps": 2.0}
    companion = aboard(
        profile,
        None if px4 else "GUIDED",
        vehicle={"dynamics": "realistic"},
        wind=wind,
        sensors=FLAWLESS,
    )
    if px4:
        companion.velocity(0.0, 0.0)
        assert companion.set_mode(6) == [0, 0]
    for number in (31, imu):
        assert companion.stream(number, step * 1e6) == [0]
    start = companion.vehicle.time
    summed = [0.0, 0.0]
    for tick in range(round(8.0 / step)):
        turn = 0.5 if tick * step < 4.0 else -0.4
        if profile == "arduplane":
            companion.attitude(0xC6, turn)
        else:
            companion.velocity(3.0, turn)
        companion.forget()
        if tick == 3:
            before = velocity(companion.truth)
        companion.vehicle.advance(start + (tick + 1) * step)
        if tick >= 3:
            (attitude,) = companion.listen("ATTITUDE_QUATERNION")
            (acceleration,) = companion.listen("RAW_IMU", "HIGHRES_IMU")
            to_ned = Rotation.from_quat([attitude.q2, attitude.q3, attitude.q4, attitude.q1])
            summed = [
                total + a * step
                for total, a in zip(summed, to_ned.apply(si(acceleration)[:3])[:2], strict=True)
            ]
    moved = [b - a for a, b in zip(before, velocity(companion.truth), strict=True)]
    assert math.hypot(*moved) > 1.0
    assert math.dist(summed, moved) < 0.1 + 0.1 * math.hypot(*moved)


def velocity(truth):
    return truth.ground_speed * math.cos(truth.course), truth.ground_speed * math.sin(truth.course)


def struck(profile, mode, gust, from_deg=0.0, **vehicle):
    """Return a vehicle in calm air in which a constant wind begins after 1 s."""
    events = [{"at_s": 1.0, "action": "wind", "value": gust}]
    return aboard(
        profile, mode, vehicle=vehicle, wind={"from_deg": from_deg}, events=events, sensors=FLAWLESS
    )


def test_side_gust_turns_nose_before_displacing_plane():
    """A gust of 3 m/s across the nose causes a slip of 7.3 deg at once. The ground velocity then
    changes gradually by a part of the gust."""
    companion = struck("arduplane", "FBWA", 3.0, 90.0, airspeed_scale=1.0)
    companion.wait(0.99)
    truths = []
    for tick in range(300):
        companion.vehicle.advance(1.0 + tick * 0.01)
        truths.append(companion.truth)
    east = [velocity(truth)[1] for truth in truths]
    assert abs(east[1]) < 0.3 and -2.0 < east[-1] < -0.5
    # 0.1 rad of slip accelerates the plane by about 9 m/s^2
    assert max(abs(b - a) for a, b in itertools.pairwise(east)) < 0.12
    # a gust from the right turns the nose to the right, by a part of the slip angle
    assert 0.03 < math.asin(3.0 / 22.0) - truths[-1].heading < 0.1
    assert truths[2].airspeed == pytest.approx(math.hypot(22.0, 3.0), abs=0.1)


@pytest.mark.parametrize(("profile", "most"), [("arducopter", 1.0), ("px4_copter", 2.5)])
def test_gust_displaces_copter_until_lean_compensates(profile, most):
    companion = struck(profile, "LOITER", 5.0, dynamics="realistic")
    speeds = []
    for tick in range(300):
        companion.vehicle.advance(0.9 + tick * 0.05)
        speeds.append(velocity(companion.truth)[0])
    assert speeds[2] == 0.0 and -most < min(speeds) < -0.05 and abs(speeds[-1]) < 0.05
    force = companion.vehicle._flight.specific_force()
    # the copter leans into the wind, and the IMU measures the drag
    assert force[0] < -0.5 and math.hypot(*force) == pytest.approx(G, abs=0.02)


def test_errors_of_px4_estimates_match_sih():
    """Standard deviations of PX4's errors in SIH: 0.9 to 1.1 deg of roll, 0.18 to 0.24 m/s along
    the nose, 1.0 to 1.8 deg of heading. The correlation of the roll error is about 0.5 after 2 s
    and 0 after 5 s."""
    companion = aboard("px4_copter", sensors={})
    companion.velocity(5.0, 0.0)
    companion.set_mode(6)
    companion.stream(30, 500_000)
    companion.stream(32, 500_000)
    companion.fly(10.0, 5.0, 0.0)
    flown = []
    speeds = []
    rolls = []
    headings = []
    for _ in range(1200):
        companion.forget()
        companion.fly(0.5, 5.0, 0.0, rate=4.0)
        true, (attitude,), (moving,) = (
            companion.truth,
            companion.listen("ATTITUDE"),
            companion.listen("LOCAL_POSITION_NED"),
        )
        flown.append(velocity(true)[0])
        speeds.append(moving.vx - flown[-1])
        rolls.append(math.degrees(attitude.roll - true.roll))
        headings.append(math.degrees(math.remainder(attitude.yaw - true.heading, math.tau)))
    assert statistics.pstdev(rolls) == pytest.approx(1.0, abs=0.2)
    assert statistics.pstdev(speeds) == pytest.approx(0.23, abs=0.06)
    assert statistics.pstdev(headings) == pytest.approx(1.3, abs=0.4)
    # the velocity loop controls the estimated speed, so the true speed varies
    assert 0.1 < statistics.pstdev(flown) < 0.35
    assert statistics.correlation(rolls[:-4], rolls[4:]) == pytest.approx(0.6, abs=0.15)
    assert abs(statistics.correlation(rolls[:-10], rolls[10:])) < 0.2
