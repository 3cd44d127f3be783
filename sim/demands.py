"""What an autopilot asks of an airframe that holds velocities: SI, NED, turn rates clockwise seen from above."""

from typing import NamedTuple


class BodyVelocity(NamedTuple):
    """Fly at this velocity seen from the nose, turning with it: the unicycle."""

    forward: float
    right: float = 0.0
    down: float = 0.0
    yaw_rate: float = 0.0


class EarthVelocity(NamedTuple):
    """Fly at this velocity over the ground whatever the nose does."""

    north: float
    east: float
    down: float = 0.0
    yaw_rate: float = 0.0


class Brake(NamedTuple):
    """Slow down along the present course and stay there."""

    deceleration: float = 2.0  # m/s^2
    down: float = 0.0


Demand = BodyVelocity | EarthVelocity | Brake
