"""Fixed wings: banked turns at the autopilot's height and airspeed."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..body import GRAVITY, Body, pieces, second_order, through_line, to_earth, within
from ..config import Airframe
from ..demands import Bank
from ..ground import standing

STEP = 0.02  # longest integration step, s
SPEED_LAG = 3.0  # lag of the airspeed, s
HEIGHT_LAG = 2.0  # climb rate is height error divided by this time, s
CLIMB_LAG = 1.0  # lag of the climb angle, s
MOST_CLIMB = 3.0  # largest climb rate, m/s
# Time constant of the speed in the ground roll, s: ArduPlane 4.6.3 in its simulator (SIM_Plane.cpp)
# reached 11.6 m/s after 1.2 s of full throttle, and 19.5 m/s after 2.7 s.
GROUND_ROLL = 1.8
BRAKING = 2.0  # deceleration on the wheels, m/s^2
MOST_ROLL_RATE = math.radians(100)
NOSE_DAMPING = 0.7  # damping ratio with which the tail fin turns the nose into the airflow
# Share of an error of the estimated bank that becomes side-slip instead of a turn; fitted to PX4's
# SIH
HELD_BY_RUDDER = 0.7
# turn rate of the path per side-slip of a gust, 1/s (ArduPilot's SITL plane at 22 m/s: 65 m/s^2 per
# rad)
SIDE_FORCE = 3.0


@dataclass(frozen=True)
class FixedWing:
    """A fixed wing.

    The bank follows its command after dead_time in a second-order loop with roll_frequency. If
    roll_frequency is 0, the bank follows with a first-order lag, roll_lag.

    A bank turns the path at once. The tail fin then turns the nose with nose_frequency, so a turn
    begins with side-slip. A gust changes airspeed and side-slip, not the velocity over the ground.
    Then the fin turns the nose into the gust, and the side force accelerates the plane. With
    nose_frequency 0, the nose turns with the path, and the plane moves with a gust at once.

    effectiveness: turn rate divided by that of a coordinated turn.
    roll_lag: s.
    roll_frequency: rad/s.
    roll_damping: damping ratio of the bank loop.
    dead_time: s.
    nose_frequency: rad/s.
    pitch: pitch above the path in level flight, and increase of this pitch with tan(bank), rad. In
        a bank this pitch is also a yaw angle between nose and path.
    fin: further part of that yaw angle, in the same form.
    held: share of the commanded bank that the autopilot holds.
    """

    effectiveness: float
    roll_lag: float = 0.0
    roll_frequency: float = 0.0
    roll_damping: float = 0.5
    dead_time: float = 0.0
    nose_frequency: float = 0.0
    pitch: tuple[float, float] = (0.0, 0.0)
    fin: tuple[float, float] = (0.0, 0.0)
    held: float = 1.0

    def configured(self, config: Airframe) -> "FixedWing":
        """Apply the vehicle file. The ideal plane has a bank lag and no side-slip."""
        if config.dynamics == "unicycle":
            return FixedWing(config.turn_effectiveness or 1.0, config.turn_lag_s)
        return replace(
            self,
            effectiveness=config.turn_effectiveness or self.effectiveness,
            roll_frequency=config.turn_frequency_rad_s or self.roll_frequency,
            roll_damping=config.turn_damping or self.roll_damping,
        )

    def step(self, body: Body, demand: Bank, dt: float, wind: tuple[float, float]) -> Body:
        for h in pieces(dt, STEP):
            body = self._gusted(body, wind)
            rolled = self._roll(body, demand.roll, h)
            body = self._fly(self._held(rolled, demand, h), body, h, wind)
        return body

    def _gusted(self, body: Body, wind: tuple[float, float]) -> Body:
        """Apply a change of the wind: the velocity over the ground stays, so airspeed and side-slip
        change."""
        if wind == body.trimmed_wind or self.nose_frequency == 0:
            return body
        north, east = wind[0] - body.trimmed_wind[0], wind[1] - body.trimmed_wind[1]
        course = body.heading + body.slip
        sink = body.velocity_down
        cos, sin = math.cos(course), math.sin(course)
        ahead = body.air_speed * math.cos(body.climb_angle) - north * cos - east * sin
        right = north * sin - east * cos
        turn = math.atan2(right, ahead)
        return body._replace(
            air_speed=math.hypot(ahead, right, sink),
            climb_angle=math.atan2(-sink, math.hypot(ahead, right)),
            slip=body.slip + turn,
            gust_slip=body.gust_slip + turn,
            trimmed_wind=wind,
        )

    def _roll(self, body: Body, commanded: float, h: float) -> Body:
        line = through_line(body.on_the_way, commanded, self.dead_time, h)
        error = self.held * line[0][1] - body.error.tilt(body.heading)[0] - body.roll
        if self.roll_frequency > 0:
            rate = second_order(error, body.roll_rate, self.roll_frequency, self.roll_damping, h)
            rate = within(rate, MOST_ROLL_RATE)
        else:
            rate = error * (1 - math.exp(-h / self.roll_lag) if self.roll_lag > 0 else 1.0) / h
        return body._replace(roll=body.roll + rate * h, roll_rate=rate, on_the_way=line)

    def _held(self, body: Body, demand: Bank, h: float) -> Body:
        """Apply the control of height and airspeed, or forced pitch and throttle."""
        speed = max(3.0, body.air_speed)
        climb = within((body.down - demand.down) / HEIGHT_LAG, MOST_CLIMB)
        angle = math.asin(climb / speed) if demand.pitch is None else demand.pitch
        wanted = demand.air_speed - 170.0 * (demand.pitch or 0.0)
        if demand.throttle is not None:
            wanted = demand.air_speed * (0.6 + 0.8 * demand.throttle)
        climb_angle = body.climb_angle + (angle - body.climb_angle) * (1 - math.exp(-h / CLIMB_LAG))
        change = (max(0.5 * demand.air_speed, wanted) - speed) * (1 - math.exp(-h / SPEED_LAG))
        pitch = climb_angle + self.pitch[0] + self.pitch[1] * abs(math.tan(body.roll))
        return body._replace(
            climb_angle=climb_angle,
            air_speed=speed + change,
            pitch=pitch,
            pitch_rate=(pitch - body.pitch) / h,
        )

    def _fly(self, shaped: Body, before: Body, h: float, wind: tuple[float, float]) -> Body:
        flat = shaped.air_speed * math.cos(shaped.climb_angle)
        turning = shaped.roll + HELD_BY_RUDDER * shaped.error.tilt(shaped.heading)[0]
        bend = self.effectiveness * GRAVITY * math.tan(turning) / max(3.0, shaped.air_speed)
        bend -= SIDE_FORCE * before.gust_slip
        course = before.heading + before.slip  # course through the air
        after = course + bend * h
        rate = bend
        if self.nose_frequency > 0:
            tilt = math.tan(shaped.roll)
            side = before.slip + tilt * (
                shaped.pitch - shaped.climb_angle + self.fin[0] + self.fin[1] * abs(tilt)
            )
            rate = second_order(side, before.turn_rate, self.nose_frequency, NOSE_DAMPING, h)
        heading = before.heading + rate * h
        sink = -shaped.air_speed * math.sin(shaped.climb_angle)
        # 5.4: rate at which the tail fin removes the side-slip of a gust, 1/s.
        return shaped._replace(
            north=before.north + (flat * math.cos(course + bend * h / 2) + wind[0]) * h,
            east=before.east + (flat * math.sin(course + bend * h / 2) + wind[1]) * h,
            down=min(before.down + sink * h, 0.0),
            heading=math.remainder(heading, math.tau),
            turn_rate=rate,
            slip=after - heading,
            gust_slip=before.gust_slip * math.exp(-(SIDE_FORCE + 5.4) * h),
            velocity_north=flat * math.cos(after) + wind[0],
            velocity_east=flat * math.sin(after) + wind[1],
            velocity_down=sink,
        )


def falling(body: Body, dt: float) -> Body:
    """Return a disarmed plane dt later: it sinks at 5 m/s and stops on the ground."""
    down = min(0.0, body.down + 5.0 * dt)
    moving = 0.0 if down >= 0 else 1.0
    return body._replace(
        north=body.north + body.velocity_north * dt * moving,
        east=body.east + body.velocity_east * dt * moving,
        down=down,
        velocity_north=body.velocity_north * moving,
        velocity_east=body.velocity_east * moving,
        velocity_down=5.0 * moving,
        turn_rate=0.0,
        air_speed=body.air_speed * moving,
    )


def rolling(
    body: Body, dt: float, wind: tuple[float, float], air_speed: float | None = None
) -> Body:
    """Return a plane on its wheels dt later. It keeps its heading and accelerates towards an
    airspeed; with None it brakes."""
    ahead = wind[0] * math.cos(body.heading) + wind[1] * math.sin(body.heading)
    speed = body.forward_speed
    if air_speed is None:
        speed = max(0.0, speed - BRAKING * dt)
    else:
        speed = max(0.0, speed + (air_speed + ahead - speed) * (1 - math.exp(-dt / GROUND_ROLL)))
    north, east = to_earth(speed, 0.0, body.heading)
    return standing(body)._replace(
        north=body.north + (body.velocity_north + north) / 2 * dt,
        east=body.east + (body.velocity_east + east) / 2 * dt,
        velocity_north=north,
        velocity_east=east,
        air_speed=max(0.0, speed - ahead),
        trimmed_wind=wind,
    )


class Loiter(NamedTuple):
    """A circle that is flown clockwise: center and radius, m."""

    north: float
    east: float
    radius: float


def bank_on_loiter(body: Body, circle: Loiter, limit: float, effectiveness: float) -> float:
    """Return the bank that leads to the circle and then along it."""
    north, east = body.north - circle.north, body.east - circle.east
    distance = max(1.0, math.hypot(north, east))
    radius = max(5.0, abs(circle.radius))
    outwards = math.atan2(east, north)
    outside = distance / radius - 1
    # Course along a clockwise circle, bent inwards outside the circle.
    wanted = outwards + math.pi / 2 + math.atan(2.0 * outside)
    error = math.remainder(wanted - body.course, math.tau)
    speed = max(3.0, body.ground_speed)
    along = speed / max(distance, radius) if abs(outside) < 0.5 else 0.0
    # 1.0: gain of the course loop in loiter, rad/s per rad.
    rate = along + 1.0 * error
    return within(math.atan(speed * rate / (GRAVITY * effectiveness)), limit)
