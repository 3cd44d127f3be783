"""Mission table [fleet]. A mission with one vehicle imports no other module of this package."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, cast

from pydantic import Field

from circnav_mav.mav.check_result import WARN, Check
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.schema import Table

if TYPE_CHECKING:
    from circnav_mav.extras.fleet.listener import FleetListener
    from circnav_mav.runtime.listeners import ListenerSettings

LEAST_LAYER = 15.0
"""Smallest distance of two height layers, m: twice the error of a barometer in a turn, plus the
size of the vehicles."""
PORT = 14570
"""UDP port of the reports."""


class FleetTable(Table):
    """[fleet]: several vehicles on one circle. Without an id a vehicle flies alone."""

    id: Annotated[int, Field(ge=1, le=255)] | None = None
    layer_m: Annotated[float, Field(ge=LEAST_LAYER, le=500)] = LEAST_LAYER
    size: Annotated[int, Field(ge=2, le=100)] = 6
    peers: Annotated[list[str], Field(max_length=100)] | None = None
    interface: str = ""
    key_file: Annotated[str, Field(min_length=1)] | None = None
    port: Annotated[int, Field(ge=1, le=65535)] = PORT
    ranging: Annotated[int, Field(ge=0, le=65000)] | None = None
    nearest_m: Annotated[float, Field(ge=1, le=500)] = 10.0


def table_of(mission: Mission) -> FleetTable:
    """Return the table [fleet] of a mission."""
    return cast(FleetTable, mission.file.fleet)  # type: ignore[attr-defined]


def check_fleet(mission: Mission) -> Iterator[Check]:
    """Yield checks of the fleet's limits if the mission has a fleet id. Warn if it has other fleet
    keys only."""
    table = table_of(mission)
    if table.id is not None:
        from circnav_mav.extras.fleet.limits import fleet_limits

        yield from fleet_limits(mission, table)
    elif table != FleetTable():
        yield Check(
            WARN, "fleet", "[fleet] without an id is without effect: give fleet.id, 1 to 255"
        )


def preflight_fleet(mission: Mission) -> Iterator[Check]:
    """Yield the checks of the other members' reports, if the mission has a fleet."""
    table = table_of(mission)
    if table.id is not None and not mission.flies_sim:
        from circnav_mav.extras.fleet.listening import listen_to_fleet

        yield from listen_to_fleet(mission, table)


def open_listener(given: "ListenerSettings") -> "FleetListener | None":
    """Return the listener of a fleet member, None for a single vehicle. Raises Refused."""
    if table_of(given.mission).id is None:
        return None
    from circnav_mav.extras.fleet.listener import join_fleet

    return join_fleet(given)
