"""Mission tables [locate] and [handback]: keys, and the settings derived from them."""

from typing import Annotated, Self, cast

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from circnav_mav.extras.locate.handback import HandBackSettings
from circnav_mav.extras.locate.locator import LocateSettings
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.schema import Table

LAST_COMPANION = 194
"""Last component id of an onboard computer (MAV_COMP_ID_ONBOARD_COMPUTER4)."""


class LocateTable(Table):
    """[locate]: where the target is on the map. Nothing of it steers."""

    enabled: bool = False
    gps_sigma_m: Annotated[float, Field(ge=0.01, le=1000)] = 1.5


class HandBackTable(Table):
    """[handback]: positions for an autopilot that has lost its own."""

    enabled: bool = False
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise PydanticCustomError("place", "one of latitude_deg and longitude_deg is missing: give both or neither")
        return self


def tables_of(mission: Mission) -> tuple[LocateTable, HandBackTable]:
    """Return the tables [locate] and [handback] of a mission."""
    return cast(LocateTable, mission.file.locate), cast(HandBackTable, mission.file.handback)  # type: ignore[attr-defined]


def locate_settings(mission: Mission) -> LocateSettings | None:
    """Return the settings of the survey, None if the mission enables neither table."""
    locate, back = tables_of(mission)
    if not (locate.enabled or back.enabled):
        return None
    place = None
    if back.latitude_deg is not None and back.longitude_deg is not None:
        place = back.latitude_deg, back.longitude_deg
    ours = mission.file.link.component_id
    return LocateSettings(
        component=LAST_COMPANION if ours != LAST_COMPANION else LAST_COMPANION - 1,
        gps_sigma=locate.gps_sigma_m,
        handback=HandBackSettings(place) if back.enabled else None,
    )
