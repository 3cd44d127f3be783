"""The mission tables of the survey: their keys, their checks, and the survey's settings."""

import pytest

from circnav_mav.extras.locate.settings import locate_settings
from circnav_mav.mav.check_result import FAIL, WARN
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, parse_mission
from tests.small_mission import TEXT

PLANE = ("vehicle.kind=plane", "vehicle.max_bank_deg=45")


def mission(*overrides):
    return parse_mission(TEXT, "m.toml", overrides)


def said(*overrides):
    """Return the grades and texts of the check lines about the survey."""
    return [(line.grade, line.text) for line in check_mission(mission(*overrides)) if line.subject == "locate"]


@pytest.mark.parametrize("where", ["239.2.3.1:99999", "239.2.3.1:0", "239.2.3.1", ":6969", "::1:6969", "tak:x"])
def test_a_place_for_datagrams_has_a_host_and_a_port_that_exists(where):
    with pytest.raises(MissionError) as refused:
        mission(f"locate.cot={where!r}")
    line = 'm.toml: locate.cot: must be host:port, port 1 to 65535, such as "239.2.3.1:6969"'
    assert str(refused.value).startswith(line)


def test_a_place_of_the_target_is_given_whole():
    with pytest.raises(MissionError, match="one of latitude_deg and longitude_deg is missing"):
        mission("handback.latitude_deg=47.3")


def test_a_camera_is_no_copters_which_would_turn_its_nose():
    on = ("locate.enabled=true", "locate.camera=true")
    assert said(*on) == [(FAIL, "locate.camera = true: a copter turns its nose to the target, omit it")]
    assert said(*PLANE, *on) == []
    assert locate_settings(mission(*PLANE, *on)).camera


def test_keys_without_effect_are_named_and_nothing_is_said_where_they_have_one():
    told = "locate.beacon, locate.cot: without effect, set locate.enabled = true"
    assert said("locate.beacon=true", "locate.cot=239.2.3.1:6969") == [(WARN, told)]
    for table in ("locate", "handback"):
        assert said(f"{table}.enabled=true", "locate.beacon=true") == []


def test_the_survey_sends_as_a_companion_of_its_own():
    assert locate_settings(mission()) is None
    assert locate_settings(mission("locate.enabled=true")).component == 194
    assert locate_settings(mission("locate.enabled=true", "link.component_id=194")).component == 193
