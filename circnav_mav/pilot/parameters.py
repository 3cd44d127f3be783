"""Values that a ground station may read and set in flight with the MAVLink parameter protocol."""

from math import nan

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.maths import horizontal
from circnav_mav.guidance.types import Direction
from circnav_mav.mav.autopilots.table import MISSION_EXITS
from circnav_mav.mav.parameter_server import Parameter
from circnav_mav.mav.session import Session
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.mission_state import MissionState
from circnav_mav.pilot.mode_request import ExitAction
from circnav_mav.pilot.range_tracker import RangeTracker

DIRECTIONS = {1.0: Direction.CLOCKWISE, -1.0: Direction.COUNTERCLOCKWISE}
LONGEST_HOLD = 600.0
"""Largest value of CN_COAST, s: the time for which the turn rate is held without ranges. The circle
drifts with the wind during this time."""
BY = "ground station"


def flight_parameters(
    controller: Controller,
    tracker: RangeTracker,
    exits: ExitAction,
    session: Session,
    mission: MissionState,
) -> tuple[Parameter, ...]:
    """Return radius, direction, speed, height, law, hold time and exit action of a flight, in the
    order of their indices."""
    # A user-defined law is listed only while it is flown.
    laws = list(dict.fromkeys((*LAWS, controller.law)))
    actions = (None, *MISSION_EXITS)

    def set_direction(value: float, now: float) -> str:
        if value not in DIRECTIONS:
            return f"{value:g} is not 1 (clockwise) or -1 (counterclockwise)"
        return controller.change_circle(CircleRequest(direction=DIRECTIONS[value], by=BY), now)

    def set_height(value: float, now: float) -> str:
        if value < 0:
            return f"{value:g} m is below 0: give the height above the target"
        slant = tracker.ranging.slant
        # With a height above the slant range all ranges would be rejected, and the flight would
        # end.
        if slant and horizontal(slant, 1.0, value) is None:
            return f"{value:g} m leaves no circle at the measured range, {slant:.0f} m"
        return tracker.height.set(value, now)

    def set_law(value: float, now: float) -> str:
        if value not in range(len(laws)):
            return f"{value:g} is not a law: " + ", ".join(
                f"{index} {name}" for index, name in enumerate(laws)
            )
        return controller.change_law(laws[int(value)])

    def set_coast(value: float, now: float) -> str:
        if not 0 <= value <= LONGEST_HOLD:
            return f"{value:g} s outside 0 to {LONGEST_HOLD:g} s"
        mission.coast = value
        return ""

    def set_exit(value: float, now: float) -> str:
        if value not in range(len(actions)):
            return f"{value:g} is not an exit action: 0 to {len(actions) - 1}"
        action = actions[int(value)]
        adapter = session.adapter
        if action not in (None, *adapter.exits) and (action != "stop" or adapter.why_no_stop):
            return f"{adapter.name} has no exit action {action}"
        exits.action = action
        return ""

    return (
        Parameter(
            "CN_RADIUS",
            lambda: controller.circle.radius,
            lambda value, now: controller.change_circle(CircleRequest(radius=value, by=BY), now),
        ),
        Parameter("CN_DIRECTION", lambda: -controller.circle.direction.turn_sign, set_direction),
        Parameter(
            "CN_SPEED",
            lambda: controller.circle.speed,
            lambda value, now: controller.change_circle(CircleRequest(speed=value, by=BY), now),
        ),
        Parameter(
            "CN_HEIGHT",
            lambda: nan if tracker.height.newest is None else tracker.height.newest,
            set_height,
        ),
        Parameter("CN_LAW", lambda: laws.index(controller.law), set_law),
        Parameter("CN_COAST", lambda: mission.coast, set_coast),
        Parameter("CN_EXIT", lambda: actions.index(exits.action), set_exit),
    )
