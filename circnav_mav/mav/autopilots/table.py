"""The adapters by (autopilot, kind) of the mission file."""

from collections.abc import Callable

from circnav_mav.mav.autopilots.ardupilot_copter import ArduCopter
from circnav_mav.mav.autopilots.interface import Autopilot

AUTOPILOTS: dict[tuple[str, str], Callable[[], Autopilot]] = {
    ("ardupilot", "copter"): ArduCopter,
}
