"""`check`: the grade of each line changes at its documented bound. Numbers by hand at V = 15 m/s,
r_d = 100 m."""

import re
from math import degrees

import pytest

from circnav_mav.cli.bundled import bundled
from circnav_mav.mav.check_result import Grade
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import load_mission

PASS = Grade.PASS
WARN = Grade.WARN
FAIL = Grade.FAIL
PLANE = ("vehicle.kind=plane", "vehicle.max_bank_deg=45")
SUBJECTS = [
    "keys",
    "autopilot",
    "gain",
    "radius",
    "drift",
    "settling",
    "height",
    "reach",
    "sampling",
    "damping",
]


def lines(mission, subject, *overrides):
    return [line for line in check_mission(mission(*overrides)) if line.subject == subject]


def only(mission, subject, *overrides):
    (line,) = lines(mission, subject, *overrides)
    assert "\n" not in line.text
    return line


def test_sound_mission_passes_except_for_unknown_height(mission):
    grades = {line.subject: line.grade for line in check_mission(mission())}
    assert grades.pop("acceleration") is WARN  # the mission's copter flies at 15 m/s
    assert set(grades) == {*SUBJECTS, "turn rate", "rate error"}
    assert {subject for subject, grade in grades.items() if grade is not PASS} == {"height"}
    assert grades["height"] is WARN


def turn(share):
    return f"vehicle.max_turn_rate_deg_s={degrees(0.15) / share}"


def lag(seconds):
    return f"guidance.gain=1e-4 vehicle.turn_lag_s={seconds}"


def law(name, gain, *more):
    return " ".join([f"guidance.law={name} guidance.gain={gain}", *more])


BEACON = "ranging.message=ranging_beacon"
FAST = "vehicle.max_turn_rate_deg_s=90.0 ranging.rate_hz=2.1"
BOUNDS = [
    # above 1/(2 r_d^2) = 5e-5 and above V/r_d = 0.15, both exclusive
    ("gain", law("smooth", 4.99e-5), FAIL),
    ("gain", law("smooth", 5e-5), FAIL),
    ("gain", law("smooth", 5.01e-5), PASS),
    ("gain", law("switching", 0.149), FAIL),
    ("gain", law("switching", 0.15), FAIL),
    ("gain", law("switching", 0.151), PASS),
    ("gain", "vehicle.turn_lag_s=9.0", PASS),
    # V/r_d = 0.15 rad/s = 8.594 deg/s
    ("turn rate", turn(0.69), PASS),
    ("turn rate", turn(0.71), WARN),
    ("turn rate", turn(0.99), WARN),
    ("turn rate", turn(1.01), FAIL),
    # DISTANCE_SENSOR ends at 655.34 m: 40 % are 262.1 m, 80 % are 524.3 m
    ("reach", "orbit.radius_m=261", PASS),
    ("reach", "orbit.radius_m=263", WARN),
    ("reach", "orbit.radius_m=524", WARN),
    ("reach", "orbit.radius_m=525", FAIL),
    ("reach", f"orbit.radius_m=2000 {BEACON}", PASS),
    # stale after 0.5 s, two ranges should fit
    ("sampling", "ranging.rate_hz=4.0", PASS),
    ("sampling", "limits.stale_s=0.5 ranging.rate_hz=3.9", WARN),
    ("sampling", "limits.stale_s=0.5 ranging.rate_hz=2.0", WARN),
    ("sampling", "limits.stale_s=0.5 ranging.rate_hz=1.9", FAIL),
    # 0.2 rad/s at 4 Hz turns 0.05 rad between two samples; lost beyond half a radian
    ("switching", law("switching", 0.2, "ranging.rate_hz=4.1"), PASS),
    ("switching", law("switching", 0.2, "ranging.rate_hz=3.9"), WARN),
    ("switching", law("switching", 1.04, FAST), WARN),
    ("switching", law("switching", 1.06, FAST), FAIL),
    # a fifth and a half of 15 m/s. Steady P_vv of white acceleration a: sqrt 2 (a^2 T)^(3/4)
    # (sigma^2 T)^(1/4), with a = (15^2/100 + 15 * 0.349)/3 = 2.5 m/s^2 and T = 0.1 s: 2.8 m/s at
    # 200 m, 5.0 at 2000 m, 7.6 at 11 km
    ("rate error", "ranging.sigma_m=200.0", PASS),
    ("rate error", "ranging.sigma_m=2000.0", WARN),
    ("rate error", "ranging.sigma_m=11000.0", FAIL),
    # 2 k r_d V = 0.3/s, times the lags of turn and filter: limit cycles from 0.45 on, refused at
    # four times that
    ("damping", lag(0.5), PASS),
    ("damping", lag(1.7), WARN),
    ("damping", lag(4.5), WARN),
    ("damping", lag(7.0), FAIL),
    ("damping", "vehicle.turn_lag_s=0.8", PASS),
    # growth sqrt(1 + (h/r)^2): 1.5 at 111.8 m, 5 at 489.9 m
    ("height", f"orbit.height_above_target_m=0 {BEACON}", PASS),
    ("height", f"orbit.height_above_target_m=111 {BEACON}", PASS),
    ("height", f"orbit.height_above_target_m=113 {BEACON}", WARN),
    ("height", f"orbit.height_above_target_m=489 {BEACON}", WARN),
    ("height", f"orbit.height_above_target_m=491 {BEACON}", FAIL),
    ("height", "orbit.target_altitude_m=500", PASS),
    ("height", "orbit.target_above_home_m=-3", PASS),
    # the reserve should be a tenth of the circle of 100 m
    ("bounds", "bounds.max_range_m=99", FAIL),
    ("bounds", "bounds.max_range_m=109", WARN),
    ("bounds", "bounds.max_range_m=111", PASS),
    ("bounds", "bounds.min_range_m=101", FAIL),
    ("bounds", "bounds.min_range_m=92", WARN),
    ("bounds", "bounds.min_range_m=90", PASS),
]


SIGNED = "signing.key_file=k"
WITHOUT_PEER = "link.endpoint=udpin:0.0.0.0:14550"
GRADES = [
    ("ranging", BEACON, WARN),  # autopilots do not forward RANGING_BEACON
    ("exit", "vehicle.autopilot=auto exit.action=brake", FAIL),  # a PX4 copter has no brake mode
    ("exit", " ".join([*PLANE, "exit.action=stop"]), FAIL),  # it would loiter with a hard bank
    ("signing", SIGNED, PASS),
    ("signing", f"{SIGNED} signing.accept_unsigned=true", WARN),
    (
        "signing",
        f"{SIGNED} ranging.endpoint=udpin:0.0.0.0:14560 signing.accept_unsigned=ranging",
        PASS,
    ),
    ("peer", WITHOUT_PEER, WARN),  # the first sender is accepted
    ("peer", f"{WITHOUT_PEER} link.peer=10.0.0.5", PASS),
    ("peer", "link.endpoint=tcp:10.0.0.5:5760 link.peer=10.0.0.5", WARN),  # no effect
    ("bounds", "bounds.max_range_m=640", PASS),
]


@pytest.mark.parametrize(("subject", "overrides", "grade"), [*BOUNDS, *GRADES])
def test_grade_changes_at_its_bound(mission, subject, overrides, grade):
    assert only(mission, subject, *overrides.split()).grade is grade


PAPER = "orbit.radius_m=10.0 guidance.gain=0.01 vehicle.speed_mps=1.0"


@pytest.mark.parametrize(
    ("subject", "overrides", "parts"),
    [
        ("gain", "guidance.gain=2e-4", "k = 0.0002 1/m^2 (given), needs k > .* = 5e-05"),
        ("gain", "orbit.radius_m=100", "k = 0.0001 1/m^2 (default), needs k >"),
        # example 1 of the paper: r_a = 10.98684113 at r_d = 10, k = 0.01
        ("radius", f"{PAPER} guidance.correct_radius=false", "10.987 m, desired 10 m; set"),
        ("radius", PAPER, "steady radius 10.000 m, desired 10 m"),
        # 9.80665 tan(45 deg)/15 = 37.46 deg/s, of which a plane that slips reaches 0.72
        (
            "turn rate",
            " ".join([*PLANE, "vehicle.max_turn_rate_deg_s=90"]),
            "needs 8.59 deg/s of the vehicle's 26.97 deg/s (32 %, .*; it turns 0.72 times",
        ),
        # 3, 4, 5: 300 m out and 400 m up are 500 m
        ("reach", "orbit.radius_m=300 orbit.height_above_target_m=400", "500.0 m, .* (76 %, at"),
        # d rho = slant/rho d slant - h/rho dh
        (
            "height",
            "orbit.height_above_target_m=37",
            "1 m of height: 0.37 m of radius, 1 m of range offset: 1.07 m of radius",
        ),
    ],
)
def test_check_line_contains_value_and_bound(mission, subject, overrides, parts):
    text = only(mission, subject, *overrides.split()).text
    assert re.search(re.escape(parts).replace(r"\.\*", ".*"), text)


@pytest.mark.parametrize(
    ("subject", "overrides"),
    [
        ("radius", "guidance.gain=4e-5"),  # an impossible gain gives no radius
        ("switching", "guidance.law=smooth"),
        ("margin", "guidance.law=smooth"),  # only laws that are tuned by the delay have one
        ("ranging", f"{BEACON} ranging.endpoint=udpin:0.0.0.0:14560"),
        ("exit", "exit.action=stop"),
        ("exit", "exit.action=brake"),
        ("exit", "engage.on_takeover=wait"),
        ("exit", "vehicle.kind=rover vehicle.autopilot=auto exit.action=stop"),  # no PX4 rover
        ("exit", "vehicle.autopilot=px4"),
        ("estimator", " ".join([*PLANE, "guidance.estimator=drift"])),
        ("signing", "limits.stale_s=0.5"),
        ("peer", "link.endpoint=serial:/dev/ttyS0:57600"),
    ],
)
def test_check_omits_lines_without_a_finding(mission, subject, overrides):
    assert lines(mission, subject, *overrides.split()) == []


def test_low_gain_warns(mission):
    """V = 15 m/s and lags of about 0.4 and 0.6 s: k near 0.5/15."""
    line = only(mission, "gain", "guidance.law=feedforward", "guidance.gain=0.002")
    assert line.grade is WARN and "with this gain the vehicle hardly turns" in line.text
    assert only(mission, "gain", "guidance.law=feedforward", "guidance.gain=0.01").grade is PASS


def test_switching_turn_beyond_limit_warns(mission):
    first, second = lines(mission, "turn rate", "guidance.law=switching", "guidance.gain=0.4")
    assert (first.grade, second.grade) == (PASS, WARN)
    assert "22.92 deg/s" in second.text


def test_default_gain_falls_with_turn_lag(mission):
    quick, late, very_late = (mission(f"vehicle.turn_lag_s={lag}") for lag in (0.1, 0.8, 9.0))
    assert quick.law.gain == pytest.approx(1e-4)
    assert 5e-5 < very_late.law.gain < late.law.gain < quick.law.gain


@pytest.mark.parametrize(
    ("bound", "height", "warns"), [(650, 0, False), (660, 0, True), (650, 100, True)]
)
def test_bound_beyond_sensor_range_warns(mission, bound, height, warns):
    """DISTANCE_SENSOR ends at a slant range of 655.34 m. A horizontal range of 650 m and a height
    of 100 m give 657.6 m."""
    found = lines(
        mission, "bounds", f"bounds.max_range_m={bound}", f"orbit.height_above_target_m={height}"
    )
    assert [line.grade for line in found] == [PASS, WARN][: 1 + warns]


@pytest.mark.parametrize("leaves_it", ["exit.action=stop", "engage.on_takeover=wait"])
@pytest.mark.parametrize(
    ("autopilot", "remedy"), [("px4", '"end"'), ("auto", ', or vehicle.autopilot "ardupilot"')]
)
def test_px4_needs_an_exit_mode(mission, leaves_it, autopilot, remedy):
    """It returns to OFFBOARD as soon as setpoints resume. With "auto", the vehicle may be a PX4."""
    line = only(mission, "exit", f"vehicle.autopilot={autopilot}", leaves_it)
    assert line.grade is FAIL and line.text.endswith(remedy)


@pytest.mark.parametrize("estimator", ["drift"])
def test_copter_refuses_drift_estimator(mission, estimator):
    line = only(mission, "estimator", f"guidance.estimator={estimator}")
    assert line.grade is FAIL and 'guidance.estimator = "auto"' in line.text


def test_settling_time_follows_shortest_tangent(mission):
    """500 m from a circle of 100 m, with the worst heading, the Dubins path to the tangent point
    takes 42.1 s. Feedforward closes in at 0.55 V or less, so the direct way alone takes 400/8.25 =
    48 s."""
    line = only(mission, "settling", "guidance.law=feedforward")
    assert float(re.search(r"about (\d+) s", line.text)[1]) == pytest.approx(42.1, abs=1.5)
    assert "at most" not in line.text
    assert "laws on range alone may take twice as long" in line.text


TIGHT = ("guidance.law=auto", *PLANE, "vehicle.turn_lag_s=0.5", "vehicle.max_turn_rate_deg_s=60.0")


@pytest.mark.parametrize(("radius", "grade"), [(60, WARN), (68, PASS), (150, PASS)])
def test_small_stability_margin_warns_with_sufficient_radius(mission, radius, grade):
    """60 m at 15 m/s oscillated in 5 m/s of wind on firmware, where the geometry allows 5.6 m/s."""
    line = only(mission, "margin", *TIGHT, f"orbit.radius_m={radius}")
    assert line.grade is grade
    assert ("a radius of 65 m suffices for up to 5.0 m/s" in line.text) == (radius == 60)


@pytest.mark.parametrize(
    ("vehicle", "speed", "warns"),
    [("arducopter", 5.2, False), ("arducopter", 5.3, True), ("px4_copter", 7, False)],
)
def test_turn_beyond_autopilot_acceleration_warns(vehicle, speed, warns):
    checks = check_mission(
        load_mission(bundled("mission", vehicle), [f"vehicle.speed_mps={speed}"])
    )
    # 30 deg/s at 5.25 m/s are 1.1 times 2.5 m/s^2
    assert [line.grade for line in checks if line.subject == "acceleration"] == [WARN] * warns
