"""Mission table [locate]: keys, and the settings derived from them."""

from collections.abc import Container
from typing import TYPE_CHECKING, Annotated, cast

from pydantic import Field

from circnav_mav.mission.mission import Mission
from circnav_mav.mission.schema import Table

if TYPE_CHECKING:
    from circnav_mav.extras.locate.locator import LocateSettings

COMPANIONS = (194, 193, 191)
"""Component ids that circnav may use, in order of preference (MAV_COMP_ID_ONBOARD_COMPUTER4, 3 and
1). 192 is reserved for a ranging radio."""


class LocateTable(Table):
    """[locate]: place of the target on the map. No value of this table affects the steering."""

    enabled: bool = False
    gps_sigma_m: Annotated[float, Field(ge=0.01, le=1000)] = 1.5


def companion(used: Container[int]) -> int:
    """Return the first component id of COMPANIONS that is not in use."""
    return next(one for one in COMPANIONS if one not in used)


def table_of(mission: Mission) -> LocateTable:
    """Return the table [locate] of a mission."""
    return cast(LocateTable, mission.file.locate)  # type: ignore[attr-defined]


def locate_settings(mission: Mission) -> "LocateSettings | None":
    """Return the settings of the locator, None if the mission does not enable it."""
    table = table_of(mission)
    if not table.enabled:
        return None
    from circnav_mav.extras.locate.locator import LocateSettings

    return LocateSettings(companion({mission.file.link.component_id}), table.gps_sigma_m)
