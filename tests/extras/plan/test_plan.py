"""`circnav plan`: its recommended mission passes `circnav check`, and an impossible site is
refused."""

import re
from itertools import pairwise

import pytest

from circnav_mav.cli.bundled import bundled
from circnav_mav.extras.plan.radius_error import radius_rms
from circnav_mav.mission.load import load_mission

SITES = {
    "plane": ("--wind", "6", "--largest", "300"),
    "copter": ("--speed", "4", "--speed", "6", "--sigma", "0.1", "--rate", "20"),
    "rover": ("--largest", "40"),
}


@pytest.mark.parametrize("vehicle", SITES)
def test_recommended_mission_passes_check(vehicle, circnav, tmp_path):
    mission = tmp_path / "my.toml"
    picture = tmp_path / "plan.png"
    ran = circnav("plan", vehicle, *SITES[vehicle], "--out", str(picture), "--write", str(mission))
    assert (ran.code, ran.err) == (0, "")
    rows = [line for line in ran.out.splitlines() if re.match(r"[> ] +[\d.]+ +\d", line)]
    assert len(rows) >= 2 and max(map(len, rows)) <= 80
    (best,) = [line for line in rows if line.startswith(">")]
    written = load_mission(mission)
    assert written.orbit.radius == float(best.split()[1]) and best.endswith("pass")
    checked = circnav("check", str(mission))
    assert checked.code == 0 and "turn rate" in checked.out
    assert not re.search(r"^WARN", checked.out, re.M), checked.out
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_plan_row_names_first_warning_and_counts_others(circnav, tmp_path):
    mission = tmp_path / "steep.toml"
    options = ("--smallest", "20", "--largest", "20", "--height", "25", "--write", str(mission))
    ran = circnav("plan", "copter", *options)
    (row,) = [line for line in ran.out.splitlines() if line.startswith(">")]
    warned = re.findall(r"^WARN +(\w+)", circnav("check", str(mission)).out, re.M)
    assert "height" in warned and row.split()[-2:] == [warned[0], f"+{len(warned) - 1}"]
    assert "1 m of height: 1.25 m of radius, 1 m of range offset: 1.60 m of radius" in ran.out


@pytest.mark.parametrize(
    "options, words",
    [
        (("--largest", "40"), "smallest radius is"),
        (("--wind", "30"), "raise --speed"),
        (("--smallest", "300", "--largest", "200"), "larger than --largest"),
    ],
)
def test_plan_refuses_impossible_site(options, words, circnav):
    ran = circnav("plan", "plane", *options)
    assert ran.code == 2 and words in ran.err and ran.err.count("\n") == 1


def test_plan_does_not_overwrite_existing_mission(circnav, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("mine")
    assert circnav("plan", "rover", "--write", str(file)).code == 2
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    "name, flown", [("arduplane", 0.162), ("arducopter", 0.064), ("ardurover", 0.049)]
)
def test_planned_radius_error_matches_emulator(name, flown):
    assert radius_rms(load_mission(bundled("mission", name)), 0.0) == pytest.approx(flown, rel=0.3)


def test_noise_and_gusts_increase_planned_radius_error():
    path = bundled("mission", "arduplane")
    calm = load_mission(path)
    noisy = load_mission(path, ["ranging.sigma_m=2.0"])
    assert radius_rms(calm, 0.0) < radius_rms(noisy, 0.0) < radius_rms(noisy, 1.0)
    assert radius_rms(calm, 0.0) < radius_rms(calm, 0.5) < radius_rms(calm, 1.0)


def test_plan_lowers_turn_limit_of_faster_copter(circnav, tmp_path):
    file = tmp_path / "my.toml"
    assert circnav("plan", "copter", "--speed", "7", "--write", str(file)).code == 0
    # 1.1 times the copter's acceleration limit of 2.5 m/s^2, at 7 m/s, is 22.5 deg/s
    assert load_mission(file).file.vehicle.max_turn_rate_deg_s == 22


def test_planned_place_error_falls_smoothly_with_radius(circnav):
    ran = circnav("plan", "plane", "--sigma", "30")
    rows = [
        line[1:].split() for line in ran.out.splitlines() if re.match(r"[> ] +[\d.]+ +\d", line)
    ]
    places = [float(row[7]) for row in rows]
    assert len(places) > 4 and places == sorted(places, reverse=True)
    assert all(wide > 0.7 * narrow for narrow, wide in pairwise(places))
