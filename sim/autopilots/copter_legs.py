"""Where a copter flies by itself: to a point, up, home, down."""

import math
from collections import ChainMap

from ..body import Body
from ..demands import Brake, Demand, EarthVelocity
from .copter_targets import GoTo

NEARNESS = 0.5  # 1/s: speed wanted per metre left
AT_HOME = 2.0  # m


Speeds = ChainMap[str, float]
"""The speeds that DO_CHANGE_SPEED has set, cm/s, over the parameters."""


def to_point(body: Body, goal: GoTo, params: Speeds) -> Demand:
    climbing = goal.down < body.down
    climb = params["WPNAV_SPEED_UP" if climbing else "WPNAV_SPEED_DN"] / 100
    return _toward(body, goal, params["WPNAV_SPEED"] / 100, climb)


def climb_out(body: Body, down: float, params: Speeds) -> Demand | None:
    """Up to a height; None once there."""
    if body.down <= down + 0.1:
        return None
    return EarthVelocity(0.0, 0.0, max(-params["WPNAV_SPEED_UP"] / 100, NEARNESS * (down - body.down) - 0.2))


def way_home(body: Body, params: Speeds) -> Demand | None:
    """Up to RTL_ALT, home, down; None once landed."""
    if math.hypot(body.north, body.east) <= AT_HOME:
        return descent(body, params)
    cruise = min(body.down, -params["RTL_ALT"] / 100)
    if body.down > cruise + 0.5:
        return EarthVelocity(0.0, 0.0, -params["WPNAV_SPEED_UP"] / 100)
    return _toward(body, GoTo(0.0, 0.0, cruise), params["WPNAV_SPEED"] / 100, params["WPNAV_SPEED_UP"] / 100)


def descent(body: Body, params: Speeds) -> Demand | None:
    """Straight down, slowly below 10 m; None once landed."""
    if body.down >= -0.01:
        return None
    return Brake(down=params["LAND_SPEED" if body.down > -10.0 else "WPNAV_SPEED_DN"] / 100)


def _toward(body: Body, goal: GoTo, speed: float, climb: float) -> EarthVelocity:
    north, east = goal.north - body.north, goal.east - body.east
    distance = math.hypot(north, east)
    share = min(speed, NEARNESS * distance) / distance if distance > 1e-6 else 0.0
    vertical = max(-climb, min(climb, NEARNESS * (goal.down - body.down)))
    return EarthVelocity(north * share, east * share, vertical)
