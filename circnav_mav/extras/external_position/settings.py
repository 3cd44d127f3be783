"""Mission table [external_position]: keys, check, and the settings derived from them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self, cast

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from circnav_mav.extras.locate.settings import companion, table_of
from circnav_mav.mav.check_result import FAIL, Check
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.schema import Table


class ExternalPositionTable(Table):
    """[external_position]: positions for an autopilot that has lost its own."""

    enabled: bool = False
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise PydanticCustomError(
                "place", "one of latitude_deg and longitude_deg is missing: give both or neither"
            )
        return self


@dataclass(frozen=True, slots=True)
class ExternalPositionSettings:
    """Settings of the external position.

    component: own MAVLink component id.
    place: latitude and longitude of the target, degrees, None for the estimated position.
    """

    component: int
    place: tuple[float, float] | None = None


def external_position_settings(mission: Mission) -> ExternalPositionSettings | None:
    """Return the settings of the external position, None if the mission does not enable it."""
    table = cast(ExternalPositionTable, mission.file.external_position)  # type: ignore[attr-defined]
    if not table.enabled:
        return None
    place = None
    if table.latitude_deg is not None and table.longitude_deg is not None:
        place = table.latitude_deg, table.longitude_deg
    ours = mission.file.link.component_id
    return ExternalPositionSettings(companion({ours, companion({ours})}), place)


def check_table(mission: Mission) -> Iterator[Check]:
    """Check the table against the rest of the mission."""
    if external_position_settings(mission) is not None and not table_of(mission).enabled:
        yield Check(
            FAIL,
            "external_position",
            "external_position.enabled = true needs `locate`, set locate.enabled = true",
        )
