"""A copter as its autopilot flies it: by velocity or by attitude, two airframes behind one step."""

import math
from dataclasses import dataclass

from ..body import Body, to_earth
from ..config import Airframe
from ..demands import BodyVelocity, Brake, Demand, EarthVelocity, Spin, Tilt, Velocity
from .dragged import DraggedCopter
from .multicopter import Multicopter, yaw_loop
from .tilting import TiltingCopter
from .unicycle import Unicycle


@dataclass(frozen=True)
class CopterAirframe:
    """`by_velocity` holds velocities over the ground, or, carried, those seen from the nose through the air;
    `by_attitude` only leans."""

    by_velocity: Unicycle | Multicopter | DraggedCopter
    by_attitude: TiltingCopter
    carried: bool = False

    @property
    def turns_with_nose(self) -> bool:
        return isinstance(self.by_velocity, Unicycle)

    def step(self, body: Body, demand: Demand, dt: float, wind: tuple[float, float]) -> Body:
        if isinstance(demand, (Tilt, Spin)):
            return self.by_attitude.step(body, demand, dt, wind)
        if self.carried and isinstance(demand, BodyVelocity):
            return self._through_air(body, demand, dt, wind)
        if isinstance(self.by_velocity, Unicycle):
            return self.by_velocity.step(body, demand, dt)
        return self.by_velocity.step(body, over_ground(demand, body.heading), dt, wind)

    def _through_air(self, body: Body, demand: BodyVelocity, dt: float, wind: tuple[float, float]) -> Body:
        """The ideal airframe in the frame of the air, and the air with it."""
        assert isinstance(self.by_velocity, Unicycle)
        moved = self.by_velocity.step(_seen_from(body, wind), demand, dt)
        moved = moved._replace(north=moved.north + wind[0] * dt, east=moved.east + wind[1] * dt)
        return _seen_from(moved, (-wind[0], -wind[1]))


def _seen_from(body: Body, velocity: tuple[float, float]) -> Body:
    """The body as somebody sees it who moves at a velocity north and east."""
    north, east = body.through_air(velocity)
    return body._replace(velocity_north=north, velocity_east=east)


def over_ground(demand: Velocity, heading: float) -> EarthVelocity | Brake:
    """A body velocity as it is over the ground right now."""
    if not isinstance(demand, BodyVelocity):
        return demand
    return EarthVelocity(*to_earth(demand.forward, demand.right, heading), demand.down, demand.yaw_rate)


def copter_airframe(config: Airframe) -> CopterAirframe:
    limit = math.radians(config.max_turn_rate_deg_s)
    ideal = Unicycle(limit, config.turn_lag_s, config.speed_lag_s)
    held = Multicopter(yaw_loop(limit)) if config.dynamics == "realistic" else ideal
    return CopterAirframe(held, TiltingCopter(limit), carried=config.dynamics == "airborne")
