"""Mission table [locate]: keys, and the component id of the locator."""

from collections.abc import Container
from typing import cast

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mission.mission import Mission
from circnav_mav.mission.schema import Table

COMPANIONS: tuple[int, ...] = (
    dialect.MAV_COMP_ID_ONBOARD_COMPUTER4,
    dialect.MAV_COMP_ID_ONBOARD_COMPUTER3,
    dialect.MAV_COMP_ID_ONBOARD_COMPUTER,
)
"""Component ids that circnav may use, in order of preference. ONBOARD_COMPUTER2 is reserved for a
ranging radio."""


class LocateTable(Table):
    """[locate]: place of the target on the map. No value of this table affects the steering."""

    enabled: bool = False


def companion(used: Container[int]) -> int:
    """Return the first component id of COMPANIONS that is not in use."""
    return next(one for one in COMPANIONS if one not in used)


def table_of(mission: Mission) -> LocateTable:
    """Return the table [locate] of a mission."""
    return cast(LocateTable, mission.file.locate)  # type: ignore[attr-defined]


def locator_component(mission: Mission) -> int | None:
    """Return the component id of the locator, None if the mission does not enable it."""
    used = {mission.file.link.component_id}
    return companion(used) if table_of(mission).enabled else None
