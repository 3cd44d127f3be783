"""Targets of ArduCopter 4.6.3 (GCS_Mavlink.cpp), and its flights without pilot input: to a point,
up, home, down.

In SET_POSITION_TARGET_LOCAL_NED, any ignore bit of a group of three ignores the whole group. An
unknown combination stops the vehicle.
"""

import math
from collections import ChainMap
from typing import NamedTuple

from ..body import Body, euler, to_earth, within
from ..demands import BodyVelocity, Brake, Demand, EarthVelocity, Spin, Tilt
from ..links import Message
from ..params import Parameters

LOCAL_NED = 1
LOCAL_OFFSET_NED = 7
BODY_NED = 8
BODY_OFFSET_NED = 9
POSITION = 0x007
VELOCITY = 0x038
ACCELERATION = 0x1C0
FORCE = 0x200
YAW_RATE = 0x800
RATES = 0x07
THROTTLE = 0x40
ATTITUDE = 0x80
THRUST_AS_THRUST = 8  # GUID_OPTIONS bit 3
AT_HOME = 2.0  # arrival radius, m
NEARNESS = 0.5  # speed per remaining distance, 1/s


class GoTo(NamedTuple):
    """Target that flies to a place and stays there; NED, m."""

    north: float
    east: float
    down: float


class Stop(NamedTuple):
    """Target that stops the vehicle. ArduCopter stops for an unsupported target:
    mode_guided.init(true)."""


class NotFinite(NamedTuple):
    """Target with a yaw rate or acceleration that is not finite. ArduCopter does not check these
    values and passes them to the controllers."""


Target = BodyVelocity | EarthVelocity | GoTo | Stop | NotFinite


def read_local_target(message: Message, body: Body, turns_with_nose: bool) -> Target:
    """Return the target. A body-frame velocity is rotated by the present heading, unless the
    vehicle is a unicycle."""
    mask = message.type_mask
    frame = message.coordinate_frame
    if frame not in (LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED):
        return Stop()
    if mask & FORCE and not mask & ACCELERATION:
        return Stop()
    if not mask & VELOCITY:
        return _velocity(message, body, turns_with_nose)
    if not mask & POSITION and mask & ACCELERATION:
        return _position(message, body)
    return Stop()


def _velocity(message: Message, body: Body, turns_with_nose: bool) -> Target:
    wanted = (message.vx, message.vy, message.vz)
    # 1000.0: largest velocity, m/s, as in ArduCopter's sane_vel_or_acc_vector.
    if any(math.isnan(v) or abs(v) > 1000.0 for v in wanted):
        return Stop()
    yaw_rate = 0.0 if message.type_mask & YAW_RATE else message.yaw_rate
    fed: tuple[float, float] = (
        (0.0, 0.0) if message.type_mask & ACCELERATION else (message.afx, message.afy)
    )
    if not all(map(math.isfinite, (yaw_rate, *fed))):
        return NotFinite()
    if message.coordinate_frame in (LOCAL_NED, LOCAL_OFFSET_NED):
        return EarthVelocity(*wanted, yaw_rate, *fed)
    if turns_with_nose:
        return BodyVelocity(*wanted, yaw_rate)
    north, east = to_earth(message.vx, message.vy, body.heading)
    return EarthVelocity(north, east, message.vz, yaw_rate, *to_earth(*fed, body.heading))


def _position(message: Message, body: Body) -> Target:
    north = message.x
    east = message.y
    down = message.z
    if not all(math.isfinite(v) for v in (north, east, down)):
        return Stop()
    if message.coordinate_frame in (BODY_NED, BODY_OFFSET_NED):
        north, east = to_earth(north, east, body.heading)
    if message.coordinate_frame != LOCAL_NED:
        north = north + body.north
        east = east + body.east
        down = down + body.down
    return GoTo(north, east, down)


def read_attitude_target(
    message: Message, params: Parameters
) -> Tilt | Spin | Stop | NotFinite | None:
    """Return the target, Stop if the message is invalid, or None if the message is silently
    dropped."""
    mask = message.type_mask
    if mask & THROTTLE:
        return None
    given = mask & RATES
    if given not in (0, RATES):  # all three rates or none
        return Stop()
    rates = (
        (0.0, 0.0, 0.0)
        if given
        else (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    )
    climb, thrust = _lift(message.thrust, params)
    if not all(map(math.isfinite, (*rates, climb))):
        return NotFinite()
    if mask & ATTITUDE:
        return Spin(rates[0], rates[1], rates[2], climb, thrust)
    q = tuple(message.q)
    if not all(map(math.isfinite, q)) or abs(sum(v * v for v in q) - 1) > 1e-3:
        return Stop()
    roll, pitch, heading = euler(q)
    return Tilt(roll, pitch, heading, rates[2], climb, thrust)


def _lift(thrust: float, params: Parameters) -> tuple[float, float | None]:
    """Return (climb rate in m/s, raw thrust). Thrust 0.5 holds the height, unless GUID_OPTIONS
    selects raw thrust."""
    if int(params["GUID_OPTIONS"]) & THRUST_AS_THRUST:
        return 0.0, within(thrust, 1.0)
    if not math.isfinite(thrust):
        return math.nan, None
    share = (max(0.0, min(1.0, thrust)) - 0.5) * 2
    return share * params["WPNAV_SPEED_UP" if share > 0 else "WPNAV_SPEED_DN"] / 100, None


Speeds = ChainMap[str, float]
"""Speeds of flights to points, cm/s, by parameter name. A speed set by DO_CHANGE_SPEED replaces the
parameter."""


def to_point(body: Body, goal: GoTo, params: Speeds) -> Demand:
    climb = params["WPNAV_SPEED_UP" if goal.down < body.down else "WPNAV_SPEED_DN"] / 100
    north, east = goal.north - body.north, goal.east - body.east
    distance = math.hypot(north, east)
    share = (
        min(params["WPNAV_SPEED"] / 100, NEARNESS * distance) / distance if distance > 1e-6 else 0.0
    )
    vertical = within(NEARNESS * (goal.down - body.down), climb)
    return EarthVelocity(north * share, east * share, vertical)


def climb_out(body: Body, down: float, params: Speeds) -> Demand | None:
    """Climb to a height. Return None at that height."""
    if body.down <= down + 0.1:
        return None
    return EarthVelocity(
        0.0, 0.0, max(-params["WPNAV_SPEED_UP"] / 100, NEARNESS * (down - body.down) - 0.2)
    )


def way_home(body: Body, params: Speeds) -> Demand:
    """Climb to RTL_ALT, then fly home."""
    cruise = min(body.down, -params["RTL_ALT"] / 100)
    if body.down > cruise + 0.5:
        return EarthVelocity(0.0, 0.0, -params["WPNAV_SPEED_UP"] / 100)
    return to_point(body, GoTo(0.0, 0.0, cruise), params)


def descent(body: Body, params: Speeds, position: bool) -> Demand:
    """Descend, slowly below 10 m. Without a position, the copter levels and drifts (nogps_run in
    mode_land.cpp)."""
    sink = params["LAND_SPEED" if body.down > -10.0 else "WPNAV_SPEED_DN"] / 100
    return Brake(down=sink) if position else Tilt(0.0, 0.0, climb=-sink)
