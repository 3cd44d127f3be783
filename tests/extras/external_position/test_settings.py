"""The mission table of the external position: its keys, its check, and the settings."""

from contextlib import ExitStack

import pytest

from circnav_mav.cli.connect import open_listeners
from circnav_mav.extras.external_position.settings import external_position_settings
from circnav_mav.mav.check_result import FAIL
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, parse_mission
from circnav_mav.pilot import Pilot
from tests.small_mission import TEXT

ON = ("external_position.enabled=true", "locate.enabled=true")


def mission(*overrides):
    return parse_mission(TEXT, "m.toml", overrides)


def test_target_position_needs_latitude_and_longitude():
    with pytest.raises(MissionError, match="one of latitude_deg and longitude_deg is missing"):
        mission("external_position.latitude_deg=47.3")
    given = mission(
        *ON, "external_position.latitude_deg=47.3", "external_position.longitude_deg=8.5"
    )
    assert external_position_settings(given).place == (47.3, 8.5)


def test_external_position_needs_the_locator():
    for keys, problems in (
        (ON[:1], ["external_position.enabled = true needs `locate`, set locate.enabled = true"]),
        (ON, []),
    ):
        lines = [
            line for line in check_mission(mission(*keys)) if line.subject == "external_position"
        ]
        assert [line.text for line in lines] == problems and all(
            line.grade is FAIL for line in lines
        )


@pytest.mark.parametrize(("ours", "component"), [(191, 193), (192, 193), (193, 191), (194, 191)])
def test_external_position_has_its_own_component_id(ours, component):
    assert (
        external_position_settings(mission(*ON, f"link.component_id={ours}")).component == component
    )
    assert external_position_settings(mission()) is None


def test_external_position_starts_after_locator():
    flown = mission(*ON)
    with ExitStack() as open_things:
        opened = open_listeners(flown, Pilot(flown), None, {"web": None}, open_things)
        names = [one.name for one in opened.attached if one.name in ("locate", "external position")]
        assert names == ["locate", "external position"]
