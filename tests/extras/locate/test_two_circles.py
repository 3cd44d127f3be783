"""`orbit.radius_m = [100, 60]`: the first circle, then the second, and the texts about each."""

import re

import numpy as np
import pytest

from circnav_mav.cli.verdict import verdict
from circnav_mav.mav.check_result import Grade
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from circnav_mav.runlog.run_folder import open_run
from circnav_mav.runlog.summary import FlightFacts, summarise
from tests.extras.locate.flown import laps, surveyed
from tests.flight.lockstep import CONFIG, true_radius
from tests.flight.recorded import EPOCH_US, recorded_flight

BOTH = "orbit.radius_m=[100, 60]"
ON_CIRCLE = ("sim.start.north_m=100", "sim.start.east_m=0", "sim.start.heading_deg=90")
SURVEYED = (BOTH, *ON_CIRCLE, "sim.sensors.gps_error_m=0.02", "sim.ranging.bias_m=1.5")


def test_height_and_bias_are_known_after_the_second_circle_and_not_after_the_first():
    """The target is at 584 m above the sea, 30 m below the vehicle. All ranges are 1.5 m too long."""
    flown = surveyed(*("quickstart", *SURVEYED), law="feedforward", gps_sigma=0.02)
    flown.solve_from = 1e9
    flown.fly(56.0)
    one = flown.solve()
    assert not one.up_known
    flown.fly(120.0)
    known = flown.solve()
    assert known.up_known and abs(known.up - 584.0) < 0.5
    assert known.bias == pytest.approx(1.5, abs=0.3) and known.bias_sigma < 0.3
    flown.locator.found(known)
    flown.fly(125.0)
    texts = [message.text for _, message in flown.messages if message.get_type() == "STATUSTEXT"]
    # the ranges are 1.5 m too long at 67 m
    number = re.fullmatch(r"circnav: ranges 2 % too long, true radius ([\d.]+) m", texts[0])
    true = np.mean([true_radius(one) for one in flown.truths if one.time > 90.0])
    assert number and float(number[1]) == pytest.approx(true, abs=0.3)
    assert texts[1:] == [f"circnav: target {known.latitude:.6f} {known.longitude:.6f} {known.sigma:.1f} m",
                         f"circnav: target at {known.up:.1f} m AMSL, sigma {known.up_sigma:.1f} m"]  # fmt: skip


def test_the_second_circle_begins_after_a_lap_of_the_first_and_all_that_is_said_is_of_the_circle_flown(
    tmp_path,
):
    flown = recorded_flight(tmp_path, "quickstart", BOTH, *ON_CIRCLE, 'guidance.law="feedforward"').fly(120.0)
    flown.recorder.close()
    run = open_run(tmp_path)
    changed = float(run.ticks.time[run.ticks.numbers["desired"] == 60.0][0])
    before = [one for one in flown.truths if one.time < changed]
    assert 1.2 < laps(before) < 1.4
    assert true_radius(before[-1]) == pytest.approx(100.0, abs=5.0)
    assert np.mean([true_radius(one) for one in flown.truths[-100:]]) == pytest.approx(60.0, abs=2.0)
    settings = flown.pilot.settings
    assert replay(Pilot(settings), recorded_steps(tmp_path)).identical
    facts = FlightFacts("m", "completed", "", settings.orbit, 1, {}, 1, None, "", EPOCH_US, None, later_radii=(60.0,))
    summary = summarise(facts, run.ticks, run.truth)
    assert [circle["desired_radius_m"] for circle in summary["circles"]] == [100.0, 60.0]
    assert [circle["radius_mean_m"] for circle in summary["circles"]] == pytest.approx([100.0, 60.0], abs=2.0)
    assert summary["truth"]["radius_mean_m"] == pytest.approx(60.0, abs=2.0)
    words = verdict(summary, tmp_path)
    assert "before     circle of 100 m" in words and "desired    60 m" in words and "WARNING" not in words
    unflown = summarise(facts, run.ticks, run.truth) | {"circles": summary["circles"][:1]}
    assert "WARNING    circle of 60 m not begun" in verdict(unflown, tmp_path)


def test_each_circle_is_checked_and_what_differs_names_its_radius():
    """V/r = 0.25 rad/s at 60 m is 72 % of the limit of 20 deg/s, at 100 m 43 %."""
    lines = check_mission(load_mission(CONFIG / "quickstart.toml", (BOTH,)))
    turns = [(line.grade, line.text.partition(":")[0]) for line in lines if line.subject == "turn rate"]
    assert turns == [(Grade.PASS, "100 m"), (Grade.WARN, "60 m")]
    assert [line.subject for line in lines].count("sampling") == 1
    (laps_line,) = (line for line in lines if line.subject == "laps")
    assert laps_line.grade is Grade.PASS and "84 s" in laps_line.text  # 1.25 * 2 pi * 160 m / 15 m/s
    tight = check_mission(load_mission(CONFIG / "quickstart.toml", ("orbit.radius_m=[100, 40]",)))
    assert Grade.FAIL in {line.grade for line in tight if line.text.startswith("40 m: the circle needs")}


@pytest.mark.parametrize(
    ("radii", "told"),
    [("[]", "must be a radius"), ("[100, -60]", "must be above 0, not -60"), ('[100, "x"]', "not 'x'")],
)
def test_radii_that_are_none_are_refused_in_one_line(radii, told):
    with pytest.raises(MissionError, match=f"^[^\n]*orbit.radius_m: [^\n]*{told}[^\n]*$"):
        load_mission(CONFIG / "quickstart.toml", (f"orbit.radius_m={radii}",))
