"""PX4's multicopter: the velocity loop in NED against drag, which is why a turning copter slows down and crabs.

MPC_XY_VEL_P_ACC 1.8, MPC_XY_VEL_I_ACC 0.4 and MPC_XY_VEL_D_ACC 0.2 with drag d make of a velocity setpoint that turns
at w, with no acceleration fed forward, the share (1.8 jw + .4) / (-1.2 w^2 + (1.8 + d) jw + .4): with d = 1/s, 5 m/s
and 0.3 rad/s that is 3.78 m/s and 17 deg behind; 3.76 and 16 were flown.
"""

import math
from dataclasses import dataclass

from ..body import GRAVITY, Body, at_most, lean
from ..demands import Brake, EarthVelocity
from .following import YawLoop, pieces

STEP = 0.02
PROPORTIONAL, INTEGRAL, DERIVATIVE = 1.8, 0.4, 0.2
MOST_ACCELERATION = GRAVITY  # 45 deg of tilt
SINKING = 0.06  # m/s: what vz = 0 loses
CLIMB_LAG = 0.3


def yaw_loop(limit: float) -> YawLoop:
    """63 % of a step after 0.45 .. 0.5 s."""
    return YawLoop(limit, dead_time=0.12, frequency=5.0, damping=0.7)


@dataclass(frozen=True)
class DraggedCopter:
    """Drag in 1/s."""

    yaw_loop: YawLoop
    drag: float

    def step(self, body: Body, demand: EarthVelocity | Brake, dt: float, wind: tuple[float, float]) -> Body:
        wanted = demand if isinstance(demand, EarthVelocity) else EarthVelocity(0.0, 0.0, demand.down)
        for h in pieces(dt, STEP):
            body = self._small_step(body, wanted, h, wind)
        return body

    def _small_step(self, body: Body, wanted: EarthVelocity, h: float, wind: tuple[float, float]) -> Body:
        # The loop closes round the estimate: what it holds is off by the estimate's error.
        (error_north, error_east), (lean_north, lean_east) = body.error.velocity, body.error.lean
        missing_north = wanted.north - body.velocity_north - error_north
        missing_east = wanted.east - body.velocity_east - error_east
        north, east = at_most(
            PROPORTIONAL * missing_north + body.push_north + wanted.acceleration_north,
            PROPORTIONAL * missing_east + body.push_east + wanted.acceleration_east,
            MOST_ACCELERATION,
        )
        limited = math.hypot(north, east) >= MOST_ACCELERATION * 0.999
        north, east = north - GRAVITY * lean_north, east - GRAVITY * lean_east
        drag_north, drag_east = (self.drag * speed for speed in body.through_air(wind))
        # the loop takes DERIVATIVE times the acceleration that comes of it off what it asks for
        north_rate, east_rate = (north - drag_north) / (1 + DERIVATIVE), (east - drag_east) / (1 + DERIVATIVE)
        velocity_north, velocity_east = body.velocity_north + north_rate * h, body.velocity_east + east_rate * h
        sink = body.velocity_down + (wanted.down + SINKING - body.velocity_down) * (1 - math.exp(-h / CLIMB_LAG))
        roll, pitch = lean(north_rate + drag_north, east_rate + drag_east, body.heading)
        return self.yaw_loop.turn(body, self.yaw_loop.limited(wanted.yaw_rate), h)._replace(
            north=body.north + (body.velocity_north + velocity_north) / 2 * h,
            east=body.east + (body.velocity_east + velocity_east) / 2 * h,
            down=min(body.down + sink * h, 0.0),
            velocity_north=velocity_north,
            velocity_east=velocity_east,
            velocity_down=sink,
            push_north=body.push_north + (0.0 if limited else INTEGRAL * missing_north * h),
            push_east=body.push_east + (0.0 if limited else INTEGRAL * missing_east * h),
            roll=roll,
            pitch=pitch,
            roll_rate=max(-4.0, min(4.0, (roll - body.roll) / h)),
            pitch_rate=max(-4.0, min(4.0, (pitch - body.pitch) / h)),
        )
