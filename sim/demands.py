"""What an autopilot asks of an airframe that holds velocities: SI, NED, turn rates clockwise seen from above."""

from typing import NamedTuple


class BodyVelocity(NamedTuple):
    """Fly at this velocity seen from the nose, turning with it: the unicycle."""

    forward: float
    right: float = 0.0
    down: float = 0.0
    yaw_rate: float = 0.0


class EarthVelocity(NamedTuple):
    """Fly at this velocity over the ground whatever the nose does; accelerations are fed forward."""

    north: float
    east: float
    down: float = 0.0
    yaw_rate: float = 0.0
    acceleration_north: float = 0.0
    acceleration_east: float = 0.0


class Brake(NamedTuple):
    """Slow down along the present course and stay there."""

    deceleration: float = 2.0  # m/s^2
    down: float = 0.0


class Tilt(NamedTuple):
    """Hold an attitude; the nose goes to `heading` (when given) and beyond at `yaw_rate`.

    Height is held by a climb rate, or is the sender's own affair by a raw thrust (0 .. 1).
    """

    roll: float
    pitch: float
    heading: float | None = None
    yaw_rate: float = 0.0
    climb: float = 0.0
    thrust: float | None = None


class Spin(NamedTuple):
    """Turn at body rates p, q, r; height as with Tilt."""

    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    climb: float = 0.0
    thrust: float | None = None


class Bank(NamedTuple):
    """A fixed wing banked, its height and airspeed held by the autopilot unless pitch or throttle are forced."""

    roll: float
    air_speed: float
    down: float
    pitch: float | None = None
    throttle: float | None = None


class Glide(NamedTuple):
    """A fixed wing by attitude and thrust (0 .. 1) alone: height and speed follow from physics."""

    roll: float
    pitch: float
    thrust: float


Velocity = BodyVelocity | EarthVelocity | Brake
Demand = Velocity | Tilt | Spin
