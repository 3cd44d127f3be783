"""The mission table of the survey and its settings."""

from circnav_mav.extras.locate.settings import locate_settings
from circnav_mav.mission.load import parse_mission
from tests.small_mission import TEXT


def mission(*overrides):
    return parse_mission(TEXT, "m.toml", overrides)


def test_the_survey_sends_as_a_companion_of_its_own():
    assert locate_settings(mission()) is None
    assert locate_settings(mission("locate.enabled=true")).component == 194
    assert locate_settings(mission("locate.enabled=true", "link.component_id=194")).component == 193
