"""Adapters by (autopilot, kind) of the mission file, and the reasons why other vehicles are not
supported."""

from circnav_mav.mav.autopilots.ardupilot_copter import ArduCopter, ArduCopterAttitude
from circnav_mav.mav.autopilots.ardupilot_plane import ArduPlane
from circnav_mav.mav.autopilots.ardupilot_rover import ArduRover
from circnav_mav.mav.autopilots.interface import Autopilot, VehicleFacts
from circnav_mav.mav.autopilots.px4_copter import PX4Copter, PX4CopterStick
from circnav_mav.mav.autopilots.px4_plane_stick import PX4PlaneStick

AUTOPILOTS: dict[tuple[str, str], type[Autopilot]] = {
    ("ardupilot", "copter"): ArduCopter,
    ("ardupilot", "copter attitude"): ArduCopterAttitude,
    ("ardupilot", "plane"): ArduPlane,
    ("ardupilot", "rover"): ArduRover,
    ("px4", "copter"): PX4Copter,
    ("px4", "copter stick"): PX4CopterStick,
    ("px4", "plane"): PX4PlaneStick,
}
"""Vehicles that can be flown, by autopilot and kind. A kind may contain a steering method."""

REFUSED: dict[tuple[str, str], str] = {
    ("px4", "rover"): (
        "PX4 rovers ignore yaw rate and attitude setpoints in OFFBOARD; only a turning velocity"
        " vector (the rover drives on after the stream stops) or a moving position target steers"
        " them"
    ),
}
"""Vehicles that cannot be flown, with a human-readable reason."""


DEFAULT_METHODS = {"plane": "stick"}
"""Default steering method by kind. A mission may name or omit it."""
_KEYS = (*AUTOPILOTS, *REFUSED)
MISSION_AUTOPILOTS = (*dict.fromkeys(autopilot for autopilot, _ in _KEYS), "auto")
MISSION_KINDS = tuple(dict.fromkeys(kind.split()[0] for _, kind in _KEYS))
MISSION_METHODS = tuple(
    dict.fromkeys(
        (*DEFAULT_METHODS.values(), *(method for _, kind in _KEYS for method in kind.split()[1:]))
    )
)
MISSION_EXITS = (
    "stop",
    *dict.fromkeys(name for vehicle in AUTOPILOTS.values() for name in vehicle.exits),
)
"""Permitted values in a mission file."""


def table_key(autopilot: str, kind: str, method: str | None) -> tuple[str, str]:
    return autopilot, kind if method in (None, DEFAULT_METHODS.get(kind)) else f"{kind} {method}"


def allowed(autopilot: str, kind: str | None) -> dict[tuple[str, str], type[Autopilot]]:
    """Return the rows of AUTOPILOTS that a mission allows. `auto` allows all autopilots. Without a
    kind, all kinds are allowed with their default methods."""
    return {
        (whose, what): vehicle
        for (whose, what), vehicle in AUTOPILOTS.items()
        if autopilot in ("auto", whose) and (what == kind or (kind is None and " " not in what))
    }


def adapters(autopilot: str, kind: str | None, facts: VehicleFacts) -> tuple[Autopilot, ...]:
    return tuple(vehicle(facts) for vehicle in allowed(autopilot, kind).values())
