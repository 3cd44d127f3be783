"""Values that a ground station may read and set in flight with the MAVLink parameter protocol."""

from math import nan

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.types import Direction
from circnav_mav.mav.autopilots.table import MISSION_EXITS
from circnav_mav.mav.parameter_server import Parameter
from circnav_mav.mav.session import Session
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.height import Height
from circnav_mav.pilot.mission_state import MissionState
from circnav_mav.pilot.mode_request import ExitAction

DIRECTIONS = {1.0: Direction.CLOCKWISE, -1.0: Direction.COUNTERCLOCKWISE}
LONGEST_HOLD = 600.0
"""Largest hold time without ranges that may be set, s: the circle drifts with the wind during it."""
BY = "ground station"


class FlightParameters:
    """Radius, direction, speed, height, law, hold time and exit action of a flight."""

    def __init__(self, controller: Controller, height: Height, exit_action: ExitAction, session: Session,
                 mission: MissionState) -> None:  # fmt: skip
        self._controller, self._height, self._exit, self._session = controller, height, exit_action, session
        self._mission = mission

    def all(self) -> tuple[Parameter, ...]:
        """Return the parameters in the order of their indices."""
        controller = self._controller
        return (
            Parameter("CN_RADIUS", lambda: controller.circle.radius, self._set_radius),
            Parameter("CN_DIRECTION", lambda: -controller.circle.direction.turn_sign, self._set_direction),
            Parameter("CN_SPEED", lambda: controller.circle.speed, self._set_speed),
            Parameter("CN_HEIGHT", self._read_height, self._set_height),
            Parameter("CN_LAW", lambda: list(LAWS).index(controller.law), self._set_law),
            Parameter("CN_HOLD", lambda: self._mission.hold, self._set_hold),
            Parameter("CN_EXIT", self._read_exit, self._set_exit),
        )

    def _set_radius(self, value: float, now: float) -> str:
        return self._controller.change_circle(CircleRequest(radius=value, by=BY), now)

    def _set_direction(self, value: float, now: float) -> str:
        if value not in DIRECTIONS:
            return f"{value:g} is not 1 (clockwise) or -1 (counterclockwise)"
        return self._controller.change_circle(CircleRequest(direction=DIRECTIONS[value], by=BY), now)

    def _set_speed(self, value: float, now: float) -> str:
        return self._controller.change_circle(CircleRequest(speed=value, by=BY), now)

    def _read_height(self) -> float:
        height = self._height.newest
        return nan if height is None else height

    def _set_height(self, value: float, now: float) -> str:
        if value < 0:
            return f"{value:g} m is below 0: give the height above the target"
        return self._height.set(value, now)

    def _set_law(self, value: float, now: float) -> str:
        laws = list(LAWS)
        if value not in range(len(laws)):
            return f"{value:g} is not a law: " + ", ".join(f"{index} {name}" for index, name in enumerate(laws))
        return self._controller.change_law(laws[int(value)])

    def _set_hold(self, value: float, now: float) -> str:
        if not 0 <= value <= LONGEST_HOLD:
            return f"{value:g} s outside 0 to {LONGEST_HOLD:g} s"
        self._mission.hold = value
        return ""

    def _read_exit(self) -> float:
        return 0.0 if self._exit.action is None else 1.0 + MISSION_EXITS.index(self._exit.action)

    def _set_exit(self, value: float, now: float) -> str:
        actions, adapter = (None, *MISSION_EXITS), self._session.adapter
        if value not in range(len(actions)):
            return f"{value:g} is not an exit action: 0 to {len(actions) - 1}"
        action = actions[int(value)]
        able = action in (None, *adapter.exits) or (action == "stop" and not adapter.why_no_stop)
        if not able:
            return f"{adapter.name} has no exit action {action}"
        self._exit.action = action
        return ""
