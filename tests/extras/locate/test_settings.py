"""The mission tables of the survey: their keys, and the survey's settings."""

import pytest

from circnav_mav.extras.locate.settings import locate_settings
from circnav_mav.mission.load import MissionError, parse_mission
from tests.small_mission import TEXT


def mission(*overrides):
    return parse_mission(TEXT, "m.toml", overrides)


def test_a_place_of_the_target_is_given_whole():
    with pytest.raises(MissionError, match="one of latitude_deg and longitude_deg is missing"):
        mission("handback.latitude_deg=47.3")


def test_the_survey_sends_as_a_companion_of_its_own():
    assert locate_settings(mission()) is None
    assert locate_settings(mission("locate.enabled=true")).component == 194
    assert locate_settings(mission("locate.enabled=true", "link.component_id=194")).component == 193
