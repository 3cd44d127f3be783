"""`circnav check`: lines, count and exit code."""

from pathlib import Path

import pytest

MISSIONS = sorted(path.stem for path in (Path(__file__).parents[2] / "config").glob("*.toml"))


@pytest.mark.parametrize("name", MISSIONS)
def test_every_mission_that_ships_can_be_flown(circnav, name):
    """The vehicle in its [sim] table, too, is one that the emulator knows."""
    assert "0 FAIL" in circnav("check", name).done


def test_every_line_has_its_grade_and_the_last_one_counts(circnav, mission):
    *lines, count = circnav("check", mission).done.splitlines()
    grades = [line.split()[0] for line in lines]
    assert set(grades) <= {"PASS", "WARN", "FAIL"}
    told = ", ".join(f"{grades.count(grade)} {grade}" for grade in ("PASS", "WARN", "FAIL"))
    assert count == f"{mission}: {told}"


def test_an_impossible_gain_fails_with_the_number_and_its_bound(circnav, mission):
    ran = circnav("check", mission, "--set", "guidance.gain=1e-5")
    assert ran.code == 2
    (line,) = [line for line in ran.out.splitlines() if line.startswith("FAIL")]
    assert "k = 1e-05 1/m^2 (given), needs k > 1/(2 r_d^2) = 5e-05" in line
    assert "1 FAIL" in ran.out
    assert "\x1b" not in ran.out, "colours stay out of a pipe"


@pytest.mark.parametrize(
    ("name", "override", "grade", "says"),
    [
        ("plane", "sim.vehicle.profile=arducopter", "FAIL", "arducopter is no ardupilot plane"),
        ("px4-copter", "sim.vehicle.profile=arducopter", "FAIL", "arducopter is no px4 copter"),
        ("plane", "sim.wind.speed_mps=30", "WARN", "is 30.0 m/s, more than the"),
        ("copter", "sim.target.velocity_east_mps=30", "WARN", "is 30.0 m/s, more than the"),
        ("plane", "vehicle.speed_mps=18", "WARN", "the bundled plane cruises at 22 m/s"),
    ],
)
def test_a_bundled_vehicle_that_does_not_fit_the_mission_is_told(circnav, name, override, grade, says):
    out = circnav("check", name, "--set", override).out
    (line,) = [line for line in out.splitlines() if line[6:].startswith("sim ")]
    assert line.startswith(grade)
    assert says in line


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("copter", ["sim.wind.speed_mps=30"]),
        ("plane", ["sim.wind.speed_mps=30", "sim.wind.from_deg=0", "sim.target.velocity_north_mps=-30"]),
        ("plane", ["sim.vehicle.profile=arducopter", "link.endpoint=udpin:0.0.0.0:14550"]),
    ],
    ids=["wind and a copter that holds its speed over the ground", "a target that goes with the wind", "not flown"],
)
def test_a_bundled_vehicle_that_is_well_is_not_told_of(circnav, name, overrides):
    out = circnav("check", name, *(part for override in overrides for part in ("--set", override))).done
    assert not [line for line in out.splitlines() if line[6:].startswith("sim ")]
