"""`check`: each line's grade turns where its bound stands. Numbers by hand at V = 15 m/s, r_d = 100 m."""

import re
from math import degrees

import numpy as np
import pytest

from circnav_mav.experiments import dubins
from circnav_mav.mission.check_result import Grade
from circnav_mav.mission.checks import check_mission

PASS, WARN, FAIL = Grade.PASS, Grade.WARN, Grade.FAIL


def lines(mission, subject, *overrides):
    return [line for line in check_mission(mission(*overrides)) if line.subject == subject]


def grade(mission, subject, *overrides):
    (line,) = lines(mission, subject, *overrides)
    assert "\n" not in line.says
    return line.grade


def test_a_sound_mission_passes_every_line_but_the_unknown_height(mission):
    grades = {line.subject: line.grade for line in check_mission(mission())}
    assert grades.pop("height") is WARN
    assert set(grades.values()) == {PASS}
    assert set(grades) == {
        "keys",
        "vehicle",
        "gain",
        "radius",
        "drift",
        "settling",
        "turn rate",
        "reach",
        "sampling",
        "range rate",
        "damping",
    }


def test_keys_that_nobody_needs_to_set_are_named_in_one_line_and_still_count(mission):
    """Those at their default may go; another value is meant."""
    old = ("vehicle.loops.max_pitch_deg=15.0", "guidance.gate_sigma=5.0", "limits.tick_hz=25.0", "limits.hold_s=10.0")
    (line,) = lines(mission, "keys", *old)
    assert line.grade is WARN
    assert line.says.endswith(": delete vehicle.loops.max_pitch_deg, guidance.gate_sigma")
    assert mission(*old).pilot_settings().timing.tick == 0.04


@pytest.mark.parametrize(
    ("law", "gain", "expected"),
    [
        ("smooth", 4.99e-5, FAIL),
        ("smooth", 5e-5, FAIL),
        ("smooth", 5.01e-5, PASS),
        ("switching", 0.149, FAIL),
        ("switching", 0.15, FAIL),
        ("switching", 0.151, PASS),
    ],
)
def test_a_gain_must_be_above_the_bound_of_its_law(mission, law, gain, expected):
    """1/(2 r_d^2) = 5e-5 and V/r_d = 0.15, both exclusive."""
    assert grade(mission, "gain", f"guidance.law={law}", f"guidance.gain={gain}") is expected


@pytest.mark.parametrize(
    ("gain", "trim", "told"), [(0.0117, 0.05, [WARN]), (0.0118, 0.05, []), (0.0117, 0.0, []), (0.0099, 0.05, [])]
)
def test_a_gain_that_does_not_do_for_the_whole_trim_of_the_radius_is_told(mission, gain, trim, told):
    """A trim of 15 % leaves 85 m: 1/r_d = 0.01176. One that does not do for 100 m is told as that."""
    overrides = ("guidance.law=bounded", f"guidance.gain={gain}", f"guidance.radius_trim_per_s={trim}")
    assert [line.grade for line in lines(mission, "trim", *overrides)] == told


def test_the_gain_line_shows_the_number_and_its_bound(mission):
    (line,) = lines(mission, "gain", "guidance.gain=2e-4")
    assert line.says == "smooth: k = 0.0002 1/m^2 (given), needs k > 1/(2 r_d^2) = 5e-05"
    (line,) = lines(mission, "gain")
    assert "k = 0.0001 1/m^2 (default)" in line.says


def test_the_radius_line_names_the_radius_of_the_theorem(mission):
    """Example 1 scaled: r_a = 10.98684113 at r_d = 10, k = 0.01."""
    overrides = ["orbit.radius_m=10.0", "guidance.gain=0.01", "vehicle.speed_mps=1.0"]
    (line,) = lines(mission, "radius", *overrides, "guidance.correct_radius=false")
    assert line.grade is WARN
    assert line.says.startswith("10.987 m will be reached, 10 m asked for; set guidance.correct_radius = true")
    (line,) = lines(mission, "radius", *overrides)
    assert (line.grade, line.says) == (PASS, "10.000 m will be reached, 10 m asked for")


def test_an_impossible_gain_has_no_radius(mission):
    assert lines(mission, "radius", "guidance.gain=4e-5") == []


@pytest.mark.parametrize(("share", "expected"), [(0.69, PASS), (0.71, WARN), (0.99, WARN), (1.01, FAIL)])
def test_the_circle_must_leave_the_vehicle_some_turn_rate(mission, share, expected):
    """V/r_d = 0.15 rad/s = 8.594 deg/s."""
    limit = degrees(0.15) / share
    assert grade(mission, "turn rate", f"vehicle.max_turn_rate_deg_s={limit}") is expected


def test_a_plane_that_slips_is_given_both_its_limits(mission):
    """9.80665 tan(45 deg)/15 = 37.46 deg/s may be told, of which it reaches .72."""
    (line,) = lines(
        mission, "turn rate", "vehicle.kind=plane", "vehicle.max_bank_deg=45", "vehicle.max_turn_rate_deg_s=90"
    )
    assert "of the vehicle's 26.97 deg/s" in line.says
    assert line.says.endswith("0.72 of the 37.46 deg/s that may be commanded")


def test_a_switching_law_beyond_the_vehicles_limit_is_told(mission):
    first, second = lines(mission, "turn rate", "guidance.law=switching", "guidance.gain=0.4")
    assert (first.grade, second.grade) == (PASS, WARN)
    assert "22.92 deg/s" in second.says


@pytest.mark.parametrize(("radius", "expected"), [(261, PASS), (263, WARN), (524, WARN), (525, FAIL), (2000, FAIL)])
def test_the_circle_must_stay_within_four_fifths_of_the_message(mission, radius, expected):
    """DISTANCE_SENSOR ends at 655.34 m: 40 % are 262.1 m, 80 % are 524.3 m."""
    assert grade(mission, "reach", f"orbit.radius_m={radius}") is expected


def test_the_reach_is_that_of_the_slant_range_and_of_the_missions_own_limit(mission):
    """3, 4, 5: 300 m out and 400 m up are 500 m."""
    assert grade(mission, "reach", "orbit.radius_m=300", "orbit.height_above_target_m=400") is WARN
    (line,) = lines(mission, "reach", "orbit.radius_m=300", "orbit.height_above_target_m=400")
    assert line.says.startswith("range on the circle 500.0 m of the 655.3 m")
    assert grade(mission, "reach", "ranging.max_range_m=120") is FAIL


def test_a_beacons_millimetres_reach_far(mission):
    assert grade(mission, "reach", "orbit.radius_m=2000", "ranging.message=ranging_beacon") is PASS


@pytest.mark.parametrize(("rate", "expected"), [(4.0, PASS), (3.9, WARN), (2.0, WARN), (1.9, FAIL)])
def test_two_ranges_should_fit_into_the_time_until_they_are_stale(mission, rate, expected):
    """Stale after 0.5 s."""
    assert grade(mission, "sampling", f"ranging.rate_hz={rate}") is expected


@pytest.mark.parametrize(("rate", "expected"), [(4.1, PASS), (3.9, WARN)])
def test_the_switching_law_wants_samples_that_come_quickly(mission, rate, expected):
    """0.2 rad/s at 4 Hz turns 0.05 rad between two samples."""
    overrides = ["guidance.law=switching", "guidance.gain=0.2", f"ranging.rate_hz={rate}"]
    assert grade(mission, "switching", *overrides) is expected


def test_the_switching_law_is_lost_beyond_half_a_radian_a_sample(mission):
    overrides = ["guidance.law=switching", "vehicle.max_turn_rate_deg_s=90.0", "ranging.rate_hz=2.1"]
    assert grade(mission, "switching", *overrides, "guidance.gain=1.04") is WARN
    assert grade(mission, "switching", *overrides, "guidance.gain=1.06") is FAIL


def test_the_smooth_law_has_no_switching_line(mission):
    assert lines(mission, "switching") == []


@pytest.mark.parametrize(("sigma", "expected"), [(0.5, PASS), (200.0, PASS), (2000.0, WARN), (10000.0, FAIL)])
def test_noise_that_hides_the_range_rate_is_told(mission, sigma, expected):
    """A fifth and a half of 15 m/s. Steady P_vv of white acceleration a: sqrt 2 (a^2 T)^(3/4) (sigma^2 T)^(1/4), with
    a = (15^2/100 + 15 * 0.349)/3 = 2.5 m/s^2 and T = 0.1 s: 2.8 m/s at 200 m, 5.0 at 2000 m."""
    assert grade(mission, "range rate", f"ranging.sigma_m={sigma}") is expected


@pytest.mark.parametrize(("lag", "expected"), [(0.5, PASS), (1.7, WARN), (4.5, WARN), (7.0, FAIL)])
def test_a_lag_that_makes_the_circle_oscillate_is_told(mission, lag, expected):
    """2 k r_d V = 2 * 1e-4 * 100 * 15 = 0.3 a second, times the lags of turn and filter: the laws limit-cycle from
    about 0.45 on, and four times the bound is refused."""
    assert grade(mission, "damping", "guidance.gain=1e-4", f"vehicle.turn_lag_s={lag}") is expected


def test_a_default_gain_is_lowered_for_a_vehicle_that_turns_late_but_stays_above_the_papers_bound(mission):
    quick, late, very_late = (mission(f"vehicle.turn_lag_s={lag}") for lag in (0.1, 0.8, 9.0))
    assert quick.law.gain == pytest.approx(1e-4)
    assert 5e-5 < very_late.law.gain < late.law.gain < quick.law.gain
    assert grade(mission, "damping", "vehicle.turn_lag_s=0.8") is PASS
    assert grade(mission, "gain", "vehicle.turn_lag_s=9.0") is PASS


@pytest.mark.parametrize(("height", "expected"), [(0, PASS), (111, PASS), (113, WARN), (489, WARN), (491, FAIL)])
def test_a_height_that_drowns_the_range_in_noise_is_told(mission, height, expected):
    """Growth sqrt(1 + (h/r)^2): 1.5 at 111.8 m, 5 at 489.9 m."""
    overrides = [f"orbit.height_above_target_m={height}", "ranging.message=ranging_beacon"]
    assert grade(mission, "height", *overrides) is expected


@pytest.mark.parametrize(("height", "expected"), [(29, PASS), (31, WARN)])
def test_what_a_metre_of_wrong_height_costs_in_radius_is_told(mission, height, expected):
    """d rho = h/rho dh: 0.31 m of radius for a metre, 31 m up on a circle of 100 m."""
    (line,) = lines(mission, "height cost", f"orbit.height_above_target_m={height}")
    assert line.grade is expected
    assert f"is 0.{height} m of radius" in line.says


@pytest.mark.parametrize("way", ["target_altitude_m=500", "target_above_home_m=-3"])
def test_a_height_that_comes_from_the_altitude_is_judged_by_preflight(mission, way):
    assert grade(mission, "height", f"orbit.{way}") is PASS
    assert lines(mission, "height cost", f"orbit.{way}") == []


@pytest.mark.parametrize(
    ("bound", "expected"),
    [
        ("max_range_m=99", FAIL),
        ("max_range_m=109", WARN),
        ("max_range_m=111", PASS),
        ("min_range_m=101", FAIL),
        ("min_range_m=92", WARN),
        ("min_range_m=90", PASS),
    ],
)
def test_bounds_of_the_range_leave_the_circle_room(mission, bound, expected):
    """The circle is 100 m; a tenth of it is the room that it should have."""
    assert grade(mission, "bounds", f"bounds.{bound}") is expected


def test_bounds_are_said_to_be_of_the_horizontal_range(mission):
    (line,) = lines(mission, "bounds", "bounds.max_range_m=640")
    assert "below bounds.max_range_m = 640 m (horizontal ranges)" in line.says


@pytest.mark.parametrize(("bound", "height", "told"), [(650, 0, False), (660, 0, True), (650, 100, True)])
def test_a_bound_beyond_the_farthest_range_is_told(mission, bound, height, told):
    """DISTANCE_SENSOR ends at a slant range of 655.34 m; 650 m and 100 m up are 657.6 m."""
    found = lines(mission, "bounds", f"bounds.max_range_m={bound}", f"orbit.height_above_target_m={height}")
    assert [line.grade for line in found] == [PASS, WARN][: 1 + told]


def test_a_beacon_without_an_endpoint_of_its_own_is_told(mission):
    (line,) = lines(mission, "ranging", "ranging.message=ranging_beacon")
    assert line.grade is WARN
    assert "do not forward RANGING_BEACON" in line.says
    assert lines(mission, "ranging", "ranging.message=ranging_beacon", "ranging.endpoint=udpin:0.0.0.0:14560") == []


def test_far_ends_of_ranges_are_told_in_kilometres_and_by_what_sets_them(mission):
    (line,) = lines(mission, "reach", "ranging.message=ranging_beacon")
    assert line.says.startswith("range on the circle 100.0 m of the 4295 km that ranging_beacon carries")
    (line,) = lines(mission, "reach", "ranging.max_range_m=600")
    assert line.says.startswith("range on the circle 100.0 m of the 600.0 m that ranging.max_range_m allows")


def test_a_plane_is_not_left_in_its_mode(mission):
    """It loiters after 3 s, banking hard; a copter brakes."""
    plane = ["vehicle.kind=plane", "vehicle.max_bank_deg=45", "exit.action=stop"]
    (line,) = lines(mission, "exit", *plane)
    assert line.grade is FAIL
    assert "choose loiter, rtl, hold" in line.says
    assert lines(mission, "exit", "exit.action=stop") == []


@pytest.mark.parametrize("leaves_it", ["exit.action=stop", "engage.on_takeover=wait"])
def test_a_px4_is_left_in_no_mode_to_which_it_would_return_by_itself(mission, leaves_it):
    """It is back in OFFBOARD as soon as setpoints resume. With "auto", it may be a PX4 that is heard."""
    (line,) = lines(mission, "exit", "vehicle.autopilot=px4", leaves_it)
    assert line.grade is FAIL
    assert line.says.endswith('engage.on_takeover must be "end"')
    (line,) = lines(mission, "exit", "vehicle.autopilot=auto", leaves_it)
    assert line.grade is FAIL
    assert line.says.endswith(', or vehicle.autopilot "ardupilot"')
    assert lines(mission, "exit", leaves_it) == []
    rover = ("vehicle.kind=rover", "vehicle.autopilot=auto", leaves_it)
    assert lines(mission, "exit", *rover) == []  # no PX4 rover is flown
    assert lines(mission, "exit", "vehicle.autopilot=auto") == lines(mission, "exit", "vehicle.autopilot=px4") == []


def test_an_exit_that_the_autopilot_does_not_know_is_answered_with_those_that_it_does(mission):
    """Of the two copters only ArduPilot's brakes."""
    (line,) = lines(mission, "exit", "vehicle.autopilot=auto", "exit.action=brake")
    assert line.grade is FAIL
    assert line.says == "px4 copter knows no exit action brake: choose loiter, rtl, land, hold"
    assert lines(mission, "exit", "exit.action=brake") == []


@pytest.mark.parametrize("estimator", ["drift", "unicycle"])
def test_a_copter_cannot_be_engaged_on_an_estimator_that_must_see_it_move_first(mission, estimator):
    copter = ("vehicle.autopilot='ardupilot'", "vehicle.kind='copter'", f"guidance.estimator='{estimator}'")
    (line,) = lines(mission, "estimator", *copter)
    assert line.grade is FAIL and 'guidance.estimator = "auto"' in line.says
    plane = ("vehicle.autopilot='ardupilot'", "vehicle.kind='plane'", "vehicle.max_bank_deg=30.0")
    assert lines(mission, "estimator", *plane, f"guidance.estimator='{estimator}'") == []


@pytest.mark.parametrize(("round_trip", "told"), [(1.0, 0), (1.1, 1)])
def test_a_link_may_be_no_slower_than_twice_the_age_of_a_range(mission, round_trip, told):
    assert len(lines(mission, "delay", "limits.stale_s=0.5", f"limits.round_trip_s={round_trip}")) == told


def test_the_settling_time_is_that_of_the_shortest_tangent_and_is_not_promised_for_a_law(mission):
    """500 m from a circle of 100 m at the worst heading: the Dubins path to the tangent point. Feedforward closes in at
    0.55 V at most, which takes it 400/8.25 = 48 s for the straight way alone."""
    (line,) = lines(mission, "settling", "guidance.law=feedforward")
    heading = np.radians(np.arange(0.0, 360.0))
    away = np.stack([np.full(360, 500.0), np.zeros(360)])
    limit = mission().orbit.max_turn_rate
    tangent = dubins.tangent_time(away, heading, np.ones(360), V=15.0, r_d=100.0, max_turn_rate=limit).max()
    assert float(re.search(r"about (\d+) s", line.says)[1]) == pytest.approx(tangent, abs=1.5)
    assert "at most" not in line.says
    assert "laws on range alone may take twice as long" in line.says
