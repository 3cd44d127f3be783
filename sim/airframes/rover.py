"""A rover whose steering oscillates: a second-order turn-rate loop instead of the well-tuned
first-order one."""

import math
from dataclasses import dataclass

from ..body import Body, pieces, to_earth
from ..demands import BodyVelocity, Velocity
from .multicopter import YawLoop

STEP = 0.02


@dataclass(frozen=True)
class RingingRover:
    """A rover that moves along its nose. speed_lag: first-order lag of the speed, s."""

    yaw_loop: YawLoop
    speed_lag: float

    def step(self, body: Body, demand: Velocity, dt: float) -> Body:
        wanted = demand if isinstance(demand, BodyVelocity) else BodyVelocity(0.0)
        for h in pieces(dt, STEP):
            turned = self.yaw_loop.turn(body, wanted.yaw_rate, h)
            speed = body.forward_speed + (wanted.forward - body.forward_speed) * (
                1 - math.exp(-h / self.speed_lag)
            )
            north, east = to_earth(speed, 0.0, turned.heading)
            body = turned._replace(
                north=body.north + (body.velocity_north + north) / 2 * h,
                east=body.east + (body.velocity_east + east) / 2 * h,
                velocity_north=north,
                velocity_east=east,
            )
        return body
