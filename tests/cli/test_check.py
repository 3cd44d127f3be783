"""`circnav check`: lines, count and exit code."""

from pathlib import Path

import pytest

MISSIONS = sorted((Path(__file__).parents[2] / "config").glob("*.toml"))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.name)
def test_every_mission_that_ships_can_be_flown(circnav, path):
    """The vehicle in its [sim] table, too, is one that the emulator knows."""
    ran = circnav("check", path)
    assert ran.code == 0, ran.out + ran.err
    assert "0 FAIL" in ran.out
    assert ran.err == ""


def test_every_line_has_its_grade_and_the_last_one_counts(circnav, mission):
    ran = circnav("check", mission)
    *lines, count = ran.out.splitlines()
    grades = [line.split()[0] for line in lines]
    assert set(grades) <= {"PASS", "WARN", "FAIL"}
    told = ", ".join(f"{grades.count(grade)} {grade}" for grade in ("PASS", "WARN", "FAIL"))
    assert count == f"{mission}: {told}"
    assert ran.code == 0


def test_an_impossible_gain_fails_with_the_number_and_its_bound(circnav, mission):
    ran = circnav("check", mission, "--set", "guidance.gain=1e-5")
    assert ran.code == 2
    (line,) = [line for line in ran.out.splitlines() if line.startswith("FAIL")]
    assert "k = 1e-05 1/m^2 (given), needs k > 1/(2 r_d^2) = 5e-05" in line
    assert "1 FAIL" in ran.out


def test_overrides_are_checked_in_their_place(circnav, mission):
    assert "of the vehicle's 6.00 deg/s" in circnav("check", mission, "--set", "vehicle.max_turn_rate_deg_s=6.0").out


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (["orbit.raduis_m=80"], "orbit.raduis_m: unknown key, did you mean radius_m?"),
        (["orbit.radius_m=0"], "orbit.radius_m: must be above 0, not 0"),
        (["orbit.radius_m=far"], "orbit.radius_m: should be a valid number, not 'far'"),
        (["link.endpoint=sim"], 'link.endpoint: is "sim", which needs a [sim] table describing the vehicle'),
    ],
)
def test_a_bad_override_is_one_line_with_file_and_key(circnav, mission, overrides, line):
    ran = circnav("check", mission, *(part for override in overrides for part in ("--set", override)))
    assert ran.code == 2
    assert ran.line == f"circnav: {mission}: {line}"


def test_a_mistake_in_the_bundled_vehicles_table_is_one_line_too(circnav, config):
    ran = circnav("check", config / "quickstart.toml", "--set", "sim.ranging.nois_m=1.0")
    assert ran.code == 2
    assert "quickstart.toml: sim" in ran.line
    assert "nois_m" in ran.line


def test_colours_stay_out_of_a_pipe(circnav, mission):
    assert "\x1b" not in circnav("check", mission, "--set", "guidance.gain=1e-5").out


@pytest.mark.parametrize("endpoint", ["/dev/ttyACM0", "udpin:14550", "serial:/dev/ttyACM0"])
@pytest.mark.parametrize("key", ["link.endpoint", "ranging.endpoint"])
def test_an_endpoint_that_a_flight_would_refuse_is_refused(circnav, mission, key, endpoint):
    ran = circnav("check", mission, "--set", f"{key}={endpoint}")
    assert ran.code == 2
    assert ran.line.startswith(f"circnav: endpoint {endpoint!r}: ")


@pytest.mark.parametrize(
    ("name", "override", "grade", "says"),
    [
        ("arduplane", "sim.vehicle.profile=arducopter", "FAIL", "arducopter is no ardupilot plane"),
        ("px4_copter", "sim.vehicle.profile=arducopter", "FAIL", "arducopter is no px4 copter"),
        ("arduplane", "sim.wind.speed_mps=30", "WARN", "is 30.0 m/s, more than the"),
        ("arducopter", "sim.target.velocity_east_mps=30", "WARN", "is 30.0 m/s, more than the"),
        ("arduplane", "vehicle.speed_mps=18", "WARN", "the bundled plane cruises at 22 m/s"),
    ],
)
def test_a_bundled_vehicle_that_does_not_fit_the_mission_is_told(circnav, config, name, override, grade, says):
    ran = circnav("check", config / f"{name}.toml", "--set", override)
    (line,) = [line for line in ran.out.splitlines() if line[6:].startswith("sim ")]
    assert line.startswith(grade)
    assert says in line


def test_wind_does_not_carry_a_copter_that_holds_its_speed_over_the_ground(circnav, config):
    ran = circnav("check", config / "arducopter.toml", "--set", "sim.wind.speed_mps=30")
    assert not [line for line in ran.out.splitlines() if line[6:].startswith("sim ")]


def test_a_bundled_vehicle_that_is_not_flown_is_not_judged(circnav, config):
    overrides = ["--set", "sim.vehicle.profile=arducopter", "--set", "link.endpoint=udpin:0.0.0.0:14550"]
    assert circnav("check", config / "arduplane.toml", *overrides).code == 0
