"""Airframe of copters. One model flies velocity setpoints, another model flies attitude setpoints.
Each step uses the model for the present setpoint."""

import math
from dataclasses import dataclass

from ..body import GRAVITY, Body, air_drag, pieces, to_earth, within
from ..config import Airframe
from ..demands import HOVER_THRUST, BodyVelocity, Demand, EarthVelocity, Spin, Tilt
from .multicopter import DRAG, DraggedCopter, Multicopter, YawLoop
from .unicycle import Unicycle

STEP = 0.025  # longest integration step, s
TILT_LAG = 0.12  # lag of roll and pitch, s
YAW_LAG = 0.15  # lag of the turn rate, s
YAW_GAIN = 4.5  # turn rate per heading error, 1/s
MOST_TILT = math.radians(80)  # largest roll and pitch with body-rate setpoints
ARDUPILOT_LEAN_DEG = 30.0  # default of ANGLE_MAX
PX4_LEAN_DEG = 45.0  # default of MPC_TILTMAX_AIR


@dataclass(frozen=True)
class TiltingCopter:
    """A multicopter flown by attitude setpoints. With a constant tilt, it accelerates until the
    drag balances the thrust: 10 deg give 4.6 m/s.

    max_turn_rate: rad/s.
    drag: linear part of the drag, 1/s.
    quadratic: True if a quadratic part is added to the drag.
    """

    max_turn_rate: float
    drag: float = DRAG
    quadratic: bool = True

    def step(self, body: Body, demand: Tilt | Spin, dt: float, wind: tuple[float, float]) -> Body:
        for h in pieces(dt, STEP):
            turned = (
                self._tilt(body, demand, h) if isinstance(demand, Tilt) else _spin(body, demand, h)
            )
            body = self._move(turned, body, demand, h, wind)
        return body

    def _tilt(self, body: Body, demand: Tilt, h: float) -> Body:
        share = 1 - math.exp(-h / TILT_LAG)
        wrong_roll, wrong_pitch = body.error.tilt(body.heading)
        roll = body.roll + (demand.roll - wrong_roll - body.roll) * share
        pitch = body.pitch + (demand.pitch - wrong_pitch - body.pitch) * share
        error = (
            0.0
            if demand.heading is None
            else math.remainder(demand.heading - body.heading - body.error.heading, math.tau)
        )
        command = within(demand.yaw_rate + YAW_GAIN * error, self.max_turn_rate)
        rate = body.turn_rate + (command - body.turn_rate) * (1 - math.exp(-h / YAW_LAG))
        return body._replace(
            roll=roll,
            pitch=pitch,
            roll_rate=(roll - body.roll) / h,
            pitch_rate=(pitch - body.pitch) / h,
            turn_rate=rate,
            heading=math.remainder(body.heading + rate * h, math.tau),
        )

    def _move(
        self, turned: Body, before: Body, demand: Tilt | Spin, h: float, wind: tuple[float, float]
    ) -> Body:
        forward, right = (
            -GRAVITY * math.tan(turned.pitch),
            GRAVITY * math.tan(turned.roll) / math.cos(turned.pitch),
        )
        (north, east), air = to_earth(forward, right, turned.heading), before.through_air(wind)
        linear = self.drag * air[0], self.drag * air[1]
        drag = air_drag(self.drag, air, turned.heading) if self.quadratic else linear
        velocity_north = before.velocity_north + (north - drag[0]) * h
        velocity_east = before.velocity_east + (east - drag[1]) * h
        down = self._sink(turned, before, demand, h)
        return turned._replace(
            north=before.north + (before.velocity_north + velocity_north) / 2 * h,
            east=before.east + (before.velocity_east + velocity_east) / 2 * h,
            down=min(before.down + (before.velocity_down + down) / 2 * h, 0.0),
            velocity_north=velocity_north,
            velocity_east=velocity_east,
            velocity_down=down,
        )

    def _sink(self, turned: Body, before: Body, demand: Tilt | Spin, h: float) -> float:
        if demand.thrust is None:
            return before.velocity_down + (-demand.climb - before.velocity_down) * (
                1 - math.exp(-h / 0.3)
            )
        lift = (
            demand.thrust / HOVER_THRUST * GRAVITY * math.cos(turned.roll) * math.cos(turned.pitch)
        )
        return before.velocity_down + (GRAVITY - lift - self.drag * before.velocity_down) * h


def _spin(body: Body, demand: Spin, h: float) -> Body:
    """Turn at body rates. With p = q = 0 a vehicle that yaws stays tilted in the same direction
    over the ground."""
    sin, cos = math.sin(body.roll), math.cos(body.roll)
    around = demand.pitch_rate * sin + demand.yaw_rate * cos
    roll_rate = demand.roll_rate + around * math.tan(body.pitch)
    pitch_rate = demand.pitch_rate * cos - demand.yaw_rate * sin
    turn_rate = around / math.cos(body.pitch)
    return body._replace(
        roll=within(body.roll + roll_rate * h, MOST_TILT),
        pitch=within(body.pitch + pitch_rate * h, MOST_TILT),
        roll_rate=roll_rate,
        pitch_rate=pitch_rate,
        turn_rate=turn_rate,
        heading=math.remainder(body.heading + turn_rate * h, math.tau),
    )


@dataclass(frozen=True)
class CopterAirframe:
    """A copter.

    by_velocity: model for velocity demands.
    by_attitude: model for attitude demands.
    carried: True if velocities in body axes are relative to the air, False if relative to the
        ground.
    """

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
        if isinstance(demand, BodyVelocity):  # rotate the velocity by the present heading
            north, east = to_earth(demand.forward, demand.right, body.heading)
            demand = EarthVelocity(north, east, demand.down, demand.yaw_rate)
        return self.by_velocity.step(body, demand, dt, wind)

    def _through_air(
        self, body: Body, demand: BodyVelocity, dt: float, wind: tuple[float, float]
    ) -> Body:
        """Fly the ideal airframe relative to the air, and add the motion of the air."""
        assert isinstance(self.by_velocity, Unicycle)
        moved = self.by_velocity.step(_seen_from(body, wind), demand, dt)
        moved = moved._replace(north=moved.north + wind[0] * dt, east=moved.east + wind[1] * dt)
        return _seen_from(moved, (-wind[0], -wind[1]))


def _seen_from(body: Body, velocity: tuple[float, float]) -> Body:
    """Return the body with its velocity relative to an observer that moves at `velocity`."""
    north, east = body.through_air(velocity)
    return body._replace(velocity_north=north, velocity_east=east)


def copter_airframe(config: Airframe) -> CopterAirframe:
    limit = math.radians(config.max_turn_rate_deg_s)
    ideal = Unicycle(limit, config.turn_lag_s, config.speed_lag_s)
    # Limit the acceleration of the turn. On ArduCopter, yaw-rate commands of ±45 deg/s at 1 Hz gave
    # 1.19 times the commanded turn rate. Without the limit, the model would give more.
    yaw_loop = YawLoop(
        limit, dead_time=0.18, frequency=7.5, damping=0.46, most_acceleration=3.5
    ).configured(config)
    drag = DRAG if config.drag_per_s is None else config.drag_per_s
    real = Multicopter(yaw_loop, drag, math.radians(config.max_lean_deg or ARDUPILOT_LEAN_DEG))
    held = real if config.dynamics == "realistic" else ideal
    return CopterAirframe(held, TiltingCopter(limit, drag), carried=config.dynamics == "airborne")
