"""Fleet problems that `check` and `preflight` report before the flight."""

from dataclasses import replace
from math import nan

import pytest

from circnav_mav.cli.exits import Refused
from circnav_mav.extras.fleet import listening
from circnav_mav.extras.fleet.acceptance import Rejection
from circnav_mav.extras.fleet.limits import spacing_settings
from circnav_mav.extras.fleet.listening import judge_fleet
from circnav_mav.extras.fleet.report import MemberReport, State
from circnav_mav.extras.fleet.settings import check_fleet, table_of
from circnav_mav.mav.check_result import Grade
from circnav_mav.mission.load import MissionError, load_mission
from tests.process import ROOT


def mission(*overrides, name="arduplane"):
    return load_mission(ROOT / "config" / f"{name}.toml", ("fleet.id=1", *overrides))


def lines(*overrides, name="arduplane"):
    return {line.subject: line for line in check_fleet(mission(*overrides, name=name))}


def test_check_reports_size_evenness_and_ranging_rate():
    found = lines("vehicle.speed_mps=15", "orbit.radius_m=100")
    assert (
        "6 members; a radius of 100 m takes at most 13, because of compass errors"
        in found["fleet size"].text
    )
    assert "worst gap 5.4 deg rms" in found["fleet evenness"].text
    assert "10 Hz in all, each of 6 members gets 1.7 Hz" in found["fleet ranging"].text
    assert all(line.grade is Grade.PASS for line in found.values())


def test_check_refuses_impossible_fleets():
    assert lines("fleet.size=40")["fleet size"].grade is Grade.FAIL
    assert lines('guidance.law="smooth"')["fleet"].grade is Grade.FAIL
    no_room = lines("bounds.min_range_m=59.5", "orbit.radius_m=60", name="px4_plane")
    assert no_room["fleet evenness"].grade is Grade.FAIL
    assert lines("fleet.size=20")["fleet ranging"].grade is Grade.WARN


def test_spacing_limits_depend_on_vehicle_and_mission_bounds():
    plane, copter, px4 = (
        spacing_settings(mission(name=name), 1) for name in ("arduplane", "arducopter", "px4_plane")
    )
    assert (plane.speed_share, copter.speed_share, px4.speed_share) == (0.15, 0.15, 0.0)
    assert (plane.radius_share, copter.radius_share) == (pytest.approx(20 / 150), 0.0)
    assert px4.radius_share > 0.1
    bounded = spacing_settings(mission("bounds.min_range_m=140"), 1)
    assert bounded.radius_share == pytest.approx(9 / 150)


def test_check_requires_beacon_ids_for_ranges_between_members():
    assert lines("fleet.ranging=100")["fleet.ranging"].grade is Grade.FAIL
    beacons = ("fleet.ranging=100", 'ranging.message="ranging_beacon"')
    assert lines(*beacons, "ranging.beacon_id=1")["fleet.ranging"].grade is Grade.PASS
    assert lines(*beacons, "ranging.beacon_id=120")["fleet.ranging"].grade is Grade.FAIL


def test_flight_is_refused_if_id_or_layer_is_taken(monkeypatch):
    own = mission("orbit.height_above_target_m=60")
    other = MemberReport(
        2, State.ON_CIRCLE, 0.0, 1.0, 0.01, 40.0, 100.0, 75.0, 1, (0.0, 0.0), (1.0, 0.0, 1.0)
    )

    def listen(height, rejected):
        found = {2: replace(other, height=height)}, rejected, ["fleet link: clocks disagree"]
        monkeypatch.setattr(listening, "_listen", lambda table, seconds: found)

    listen(75.0, {Rejection.CLOCKS_DISAGREE: 9})
    listening.refuse_taken(own, table_of(own))
    listen(62.0, {})
    with pytest.raises(Refused, match="members 1 and 2 are 2 m apart in height"):
        listening.refuse_taken(own, table_of(own))
    rover = mission(name="ardurover")  # rovers have no height layers
    listen(0.0, {})
    listening.refuse_taken(rover, table_of(rover))
    listen(75.0, {Rejection.SAME_ID: 2})
    with pytest.raises(Refused, match="the id 1 is in use"):
        listening.refuse_taken(own, table_of(own))


def test_height_layers_closer_than_15_m_are_refused():
    with pytest.raises(MissionError, match=r"fleet\.layer_m: must be at least 15, not 5"):
        mission("fleet.layer_m=5.0")


@pytest.mark.parametrize(
    ("height", "rejected", "problems", "failed"),
    [
        (75.0, {}, [], []),
        (nan, {}, [], []),
        (64.0, {}, [], ["fleet layer"]),
        (
            75.0,
            {Rejection.SAME_ID: 3},
            ["fleet link: two members have the same id"],
            ["fleet link"],
        ),
        (75.0, {Rejection.SAME_ID: 1}, [], ["fleet link"]),
        (75.0, {Rejection.CLOCKS_DISAGREE: 9}, ["fleet link: clocks disagree"], ["fleet link"]),
        (75.0, {Rejection.MALFORMED: 9}, ["fleet link: frames are not complete"], []),
    ],
)
def test_preflight_refuses_id_layer_and_clock_conflicts(height, rejected, problems, failed):
    given = mission()
    other = MemberReport(
        2, State.ON_CIRCLE, 0.0, 1.0, 0.1, 40.0, 150.0, height, -1, (0.0, 0.0), (1.0, 0.0, 1.0)
    )
    found = list(judge_fleet(given, table_of(given), {2: other}, rejected, problems))
    assert "members received: 2" in found[0].text
    assert [line.subject for line in found if line.grade is Grade.FAIL] == failed
