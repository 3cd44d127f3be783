"""The whole application without I/O: bytes and the time in, bytes out."""

from circnav_mav.pilot.pilot import Pilot
from circnav_mav.pilot.settings import (
    LINKS,
    RANGING,
    VEHICLE,
    Ending,
    Outcome,
    PilotSettings,
    TickRecord,
    Timing,
    Voice,
    phase_name,
)

__all__ = [
    "LINKS",
    "RANGING",
    "VEHICLE",
    "Ending",
    "Outcome",
    "Pilot",
    "PilotSettings",
    "TickRecord",
    "Timing",
    "Voice",
    "phase_name",
]
