"""A copter as its autopilot flies it: by velocity or by attitude, two airframes behind one step."""

import math
from dataclasses import dataclass

from sim.airframes.multicopter import Multicopter
from sim.airframes.tilting import TiltingCopter
from sim.airframes.unicycle import Unicycle
from sim.body import Body
from sim.config import Airframe
from sim.demands import BodyVelocity, Brake, Demand, EarthVelocity, Spin, Tilt, Velocity


@dataclass(frozen=True)
class CopterAirframe:
    """`by_velocity` holds velocities over the ground, `by_attitude` only leans."""

    by_velocity: Unicycle | Multicopter
    by_attitude: TiltingCopter

    @property
    def turns_with_nose(self) -> bool:
        return isinstance(self.by_velocity, Unicycle)

    def step(self, body: Body, demand: Demand, dt: float, wind: tuple[float, float]) -> Body:
        if isinstance(demand, (Tilt, Spin)):
            return self.by_attitude.step(body, demand, dt, wind)
        if isinstance(self.by_velocity, Unicycle):
            return self.by_velocity.step(body, demand, dt)
        return self.by_velocity.step(body, over_ground(demand, body.heading), dt)


def over_ground(demand: Velocity, heading: float) -> EarthVelocity | Brake:
    """A body velocity as it is over the ground right now."""
    if not isinstance(demand, BodyVelocity):
        return demand
    cos, sin = math.cos(heading), math.sin(heading)
    north, east = demand.forward * cos - demand.right * sin, demand.forward * sin + demand.right * cos
    return EarthVelocity(north, east, demand.down, demand.yaw_rate)


def copter_airframe(config: Airframe) -> CopterAirframe:
    limit = math.radians(config.max_turn_rate_deg_s)
    ideal = Unicycle(limit, config.turn_lag_s, config.speed_lag_s)
    held = ideal if config.dynamics in (None, "unicycle") else Multicopter(limit)
    return CopterAirframe(held, TiltingCopter(limit))
