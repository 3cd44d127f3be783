"""The mission table of the locator and its settings."""

from circnav_mav.extras.locate.settings import locator_component
from circnav_mav.mission.load import parse_mission
from tests.small_mission import TEXT


def mission(*overrides):
    return parse_mission(TEXT, "m.toml", overrides)


def test_locator_has_its_own_component_id():
    assert locator_component(mission()) is None
    assert locator_component(mission("locate.enabled=true")) == 194
    assert locator_component(mission("locate.enabled=true", "link.component_id=194")) == 193
