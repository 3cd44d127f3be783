"""The complete application without I/O: bytes and time in, bytes out."""

from circnav_mav.mission.mission import LINKS, RANGING, VEHICLE
from circnav_mav.pilot.mission_state import Ending, Outcome, OutputMode, Phase
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
    "TickRecord",
    "phase_name",
]
