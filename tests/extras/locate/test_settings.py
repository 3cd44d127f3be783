"""The mission table of the locator and its settings."""

from circnav_mav.extras.locate.settings import locate_settings
from circnav_mav.mission.load import parse_mission
from tests.small_mission import TEXT


def mission(*overrides):
    return parse_mission(TEXT, "m.toml", overrides)


def test_locator_has_its_own_component_id():
    assert locate_settings(mission()) is None
    assert locate_settings(mission("locate.enabled=true")).component == 194
    assert locate_settings(mission("locate.enabled=true", "link.component_id=194")).component == 193
