"""Demands of an autopilot on an airframe: SI, NED, turn rates clockwise seen from above."""

from typing import NamedTuple

HOVER_THRUST = 0.485  # share of full thrust in hover


class BodyVelocity(NamedTuple):
    """Velocity in body axes. On a unicycle, the velocity turns with the nose."""

    forward: float
    right: float = 0.0
    down: float = 0.0
    yaw_rate: float = 0.0


class EarthVelocity(NamedTuple):
    """Velocity over the ground, independent of the heading. The acceleration is a feedforward."""

    north: float
    east: float
    down: float = 0.0
    yaw_rate: float = 0.0
    acceleration_north: float = 0.0
    acceleration_east: float = 0.0


class Brake(NamedTuple):
    """Slow down along the present course and hover."""

    deceleration: float = 2.0  # m/s^2
    down: float = 0.0


class Tilt(NamedTuple):
    """Attitude. The nose turns to `heading`, if given, and `yaw_rate` is added to this turn.

    The autopilot flies the climb rate `climb`. With a raw `thrust` (0 to 1), the sender has to
    control the height.
    """

    roll: float
    pitch: float
    heading: float | None = None
    yaw_rate: float = 0.0
    climb: float = 0.0
    thrust: float | None = None


class Spin(NamedTuple):
    """Body rates p, q, r, rad/s. The height is controlled as with Tilt."""

    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    climb: float = 0.0
    thrust: float | None = None


class Bank(NamedTuple):
    """Bank of a fixed wing. The autopilot holds height and airspeed unless pitch or throttle are
    forced."""

    roll: float
    air_speed: float
    down: float
    pitch: float | None = None
    throttle: float | None = None


def climb_rate(demand: BodyVelocity | EarthVelocity | Brake | Tilt | Spin) -> float:
    """Return the commanded climb rate, m/s. A raw thrust counts as its excess over hover."""
    if not isinstance(demand, (Tilt, Spin)):
        return -demand.down
    return demand.climb if demand.thrust is None else demand.thrust - HOVER_THRUST


Velocity = BodyVelocity | EarthVelocity | Brake
Demand = Velocity | Tilt | Spin
