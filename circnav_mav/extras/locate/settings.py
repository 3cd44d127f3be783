"""Mission tables [locate] and [handback]: keys, checks, and the settings derived from them."""

from collections.abc import Iterator
from typing import Annotated, Self, cast

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from circnav_mav.extras.locate.handback import HandBackSettings
from circnav_mav.extras.locate.locator import LocateSettings
from circnav_mav.mav.check_result import FAIL, WARN, Check
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.schema import MOST_PORT, Table

LAST_COMPANION = 194
"""Last component id of an onboard computer (MAV_COMP_ID_ONBOARD_COMPUTER4)."""


def _host_and_port(given: str) -> str:
    """Return a valid UDP address, host:port. Raises PydanticCustomError."""
    host, _, port = given.rpartition(":")
    if not host or ":" in host or not host.isprintable() or not port.isdecimal() or not 0 < int(port) <= MOST_PORT:
        raise PydanticCustomError("host", f'must be host:port, port 1 to {MOST_PORT}, such as "239.2.3.1:6969"')
    return given


class LocateTable(Table):
    """[locate]: where the target is on the map. Nothing of it steers."""

    enabled: bool = False
    gps_sigma_m: Annotated[float, Field(ge=0.01, le=1000)] = 1.5
    cot: Annotated[str, AfterValidator(_host_and_port)] | None = None
    camera: bool = False
    beacon: bool = False


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
        beacon=locate.beacon,
        camera=locate.camera,
        handback=HandBackSettings(place) if back.enabled else None,
    )


def check_tables(mission: Mission) -> Iterator[Check]:
    """Check the tables against the rest of the mission."""
    locate, back = tables_of(mission)
    given = [f"locate.{name}" for name in ("camera", "beacon", "cot") if getattr(locate, name)]
    if given and not (locate.enabled or back.enabled):
        yield Check(WARN, "locate", f"{', '.join(given)}: without effect, set locate.enabled = true")
    if locate.camera and mission.file.vehicle.kind == "copter":
        yield Check(FAIL, "locate", "locate.camera = true: a copter turns its nose to the target, omit it")
