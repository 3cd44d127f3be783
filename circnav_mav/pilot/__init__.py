"""The complete application without I/O: bytes and time in, bytes out.

`Pilot` is imported at its first use, because checks of a mission need only its settings.
"""

from typing import TYPE_CHECKING, Any

from circnav_mav.pilot.mission_state import Ending, Outcome, Phase, Timing
from circnav_mav.pilot.settings import LINKS, RANGING, VEHICLE, OutputMode, PilotSettings

if TYPE_CHECKING:
    from circnav_mav.pilot.pilot import Pilot
    from circnav_mav.pilot.record import TickRecord, phase_name

__all__ = [
    "LINKS",
    "RANGING",
    "VEHICLE",
    "Ending",
    "Outcome",
    "OutputMode",
    "Phase",
    "Pilot",
    "PilotSettings",
    "TickRecord",
    "Timing",
    "phase_name",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from circnav_mav.pilot import pilot, record

    return getattr(pilot if name == "Pilot" else record, name)
