"""The adapters by (autopilot, kind) of the mission file, and why the others are not there."""

from collections.abc import Callable

from circnav_mav.mav.autopilots.ardupilot import ArduCopter, ArduPlane, ArduRover
from circnav_mav.mav.autopilots.interface import Autopilot, VehicleFacts
from circnav_mav.mav.autopilots.px4 import PX4Copter, PX4PlaneAttitude, PX4PlaneStick

AUTOPILOTS: dict[tuple[str, str], Callable[[VehicleFacts], Autopilot]] = {
    ("ardupilot", "copter"): ArduCopter,
    ("ardupilot", "plane"): ArduPlane,
    ("ardupilot", "rover"): ArduRover,
    ("px4", "copter"): PX4Copter,
    ("px4", "plane"): PX4PlaneStick,
    ("px4", "plane attitude"): PX4PlaneAttitude,
}
"""The vehicles that can be flown without position, or by the autopilot's own velocity estimate."""

REFUSED: dict[tuple[str, str], str] = {
    ("ardupilot", "copter nogps"): (
        "GUIDED_NOGPS holds no speed, and a copter without GPS or flow measures none (its VFR_HUD.airspeed is its "
        "ground-speed estimate): the circle's V cannot be held honestly. Give the copter optical flow and use GUIDED"
    ),
    ("px4", "rover"): (
        "PX4 rovers ignore yaw rate and attitude setpoints in OFFBOARD; only a rotated velocity or a position carrot "
        "steers them, and the first keeps driving after the stream stops"
    ),
}
"""The vehicles that cannot, with the reason for people."""


def adapters(autopilot: str, kind: str | None, facts: VehicleFacts) -> tuple[Autopilot, ...]:
    """The adapters that a mission allows; `auto` allows all that share the kind, if it is given."""
    return tuple(
        make(facts)
        for (whose, what), make in AUTOPILOTS.items()
        if autopilot in ("auto", whose) and (what == kind or (kind is None and " " not in what))
    )
