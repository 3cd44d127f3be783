"""The complete application without I/O: bytes and time in, bytes out."""

from circnav_mav.pilot.mission_state import Ending, Outcome, Phase, Timing
from circnav_mav.pilot.pilot import Pilot
from circnav_mav.pilot.record import TickRecord, phase_name
from circnav_mav.pilot.settings import LINKS, RANGING, VEHICLE, OutputMode, PilotSettings

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
