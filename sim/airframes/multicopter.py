"""A real quadcopter under ArduCopter 4.6.3, as measured in flight.

A yaw-rate step shows nothing for 0.2 s, is half there after 0.35 s and overshoots by 20 %; the turn is then 1..6 %
faster than asked, the more the harder it turns. The velocity follows behind the nose: its course is corrected by the
error (a slip of 5 deg at 3 m/s and 0.2 rad/s, 10 at 5 and 0.3), unless the centripetal acceleration is fed forward.
"""

import math
from dataclasses import dataclass

from ..body import GRAVITY, Body, lean
from ..demands import Brake, EarthVelocity
from .following import YawLoop, pieces

STEP = 0.02
YAW_EXCESS = 0.23  # of the centripetal acceleration in g
FEED_SHARE, FEED_LAG = 0.9, 0.8  # of the acceleration fed forward, s
COURSE_LAG = 0.3  # s, course rate behind its command: the time to bank
SPEED_LAG = 0.5  # s
MOST_ACCELERATION = 2.5  # m/s^2, WPNAV_ACCEL
SLOW = 0.5  # m/s: below, a course means nothing
STOPPED = 0.1  # m/s: a brake gives way to the velocity loop
DRAG = 0.185  # 1/s: 4 deg of pitch hold 3.7 m/s
TRIM_TIME = 2.0  # s in which the loop's integrator (PSC_VELXY_P / I) holds a new wind


def yaw_loop(limit: float) -> YawLoop:
    """Swings of +-45 deg/s at 1 Hz came back 1.19 times as large, no more: the acceleration is limited."""
    return YawLoop(limit, dead_time=0.18, frequency=7.5, damping=0.46, most_acceleration=3.5)


@dataclass(frozen=True)
class Multicopter:
    """Flies velocities over the ground; the wind is held against, a gust pushes until it is."""

    yaw_loop: YawLoop

    def step(self, body: Body, demand: EarthVelocity | Brake, dt: float, wind: tuple[float, float]) -> Body:
        for h in pieces(dt, STEP):
            body = self._small_step(_pushed(body, wind, h), demand, h)
        return body

    def _small_step(self, body: Body, demand: EarthVelocity | Brake, h: float) -> Body:
        wanted = demand if isinstance(demand, EarthVelocity) else EarthVelocity(0.0, 0.0, demand.down)
        turned = self._yaw(body, wanted, h)
        if isinstance(demand, Brake) and turned.ground_speed > STOPPED:
            moved = _brake(turned, demand.deceleration, h)
        elif min(math.hypot(wanted.north, wanted.east), body.ground_speed) < SLOW:
            moved = _towards(turned, wanted, h)
        else:
            moved = _follow(turned, wanted, h)
        return _tilted(_displaced(moved, body, wanted.down, h), body, h)

    def _yaw(self, body: Body, wanted: EarthVelocity, h: float) -> Body:
        command = self.yaw_loop.limited(wanted.yaw_rate)
        command *= 1 + YAW_EXCESS * abs(body.ground_speed * command) / GRAVITY
        return self.yaw_loop.turn(body, command, h)


def _pushed(body: Body, wind: tuple[float, float], h: float) -> Body:
    """What the wind has changed by since the loop was trimmed pushes, and is trimmed away in time."""
    gust_north, gust_east = wind[0] - body.trimmed_wind[0], wind[1] - body.trimmed_wind[1]
    share = h / TRIM_TIME
    return body._replace(
        velocity_north=body.velocity_north + DRAG * gust_north * h,
        velocity_east=body.velocity_east + DRAG * gust_east * h,
        trimmed_wind=(body.trimmed_wind[0] + gust_north * share, body.trimmed_wind[1] + gust_east * share),
    )


def _follow(body: Body, wanted: EarthVelocity, h: float) -> Body:
    """Speed and course each towards what is wanted; the course by its error and by the acceleration fed forward."""
    goal, speed = math.hypot(wanted.north, wanted.east), body.ground_speed
    feed = FEED_SHARE * (wanted.north * wanted.acceleration_east - wanted.east * wanted.acceleration_north) / goal**2
    fed = body.course_feed + (feed - body.course_feed) * (1 - math.exp(-h / FEED_LAG))
    error = math.remainder(math.atan2(wanted.east, wanted.north) - body.course, math.tau)
    sideways = min(MOST_ACCELERATION, abs(speed * wanted.yaw_rate))
    correction_time = 0.3 + 0.2 * sideways  # s: the harder the turn, the more it slips
    most = 1.4 * MOST_ACCELERATION / speed
    command = max(-most, min(most, fed + error / correction_time))
    course_rate = body.course_rate + (command - body.course_rate) * (1 - math.exp(-h / COURSE_LAG))
    change = max(-MOST_ACCELERATION, min(MOST_ACCELERATION, (goal - speed) / SPEED_LAG))
    course, after = body.course + course_rate * h, speed + change * h
    return body._replace(
        velocity_north=after * math.cos(course),
        velocity_east=after * math.sin(course),
        course_rate=course_rate,
        course_feed=fed,
    )


def _towards(body: Body, wanted: EarthVelocity, h: float) -> Body:
    """Starting and stopping: straight to the wanted velocity."""
    north, east = wanted.north - body.velocity_north, wanted.east - body.velocity_east
    missing = math.hypot(north, east)
    change = min(missing / SPEED_LAG, MOST_ACCELERATION) * h
    share = change / missing if missing > 1e-9 else 0.0
    return body._replace(
        velocity_north=body.velocity_north + north * share,
        velocity_east=body.velocity_east + east * share,
        course_rate=0.0,
        course_feed=0.0,
    )


def _brake(body: Body, deceleration: float, h: float) -> Body:
    speed = body.ground_speed
    kept = max(0.0, 1 - deceleration * h / speed) if speed > 0 else 0.0
    return body._replace(
        velocity_north=body.velocity_north * kept,
        velocity_east=body.velocity_east * kept,
        course_rate=0.0,
        course_feed=0.0,
    )


def _displaced(moved: Body, before: Body, down: float, h: float) -> Body:
    below = min(before.down + down * h, 0.0)
    return moved._replace(
        north=before.north + (before.velocity_north + moved.velocity_north) / 2 * h,
        east=before.east + (before.velocity_east + moved.velocity_east) / 2 * h,
        down=below,
        velocity_down=(below - before.down) / h,
    )


def _tilted(moved: Body, before: Body, h: float) -> Body:
    """The attitude whose thrust, against the drag in the wind it knows, makes the acceleration just flown."""
    air_north, air_east = before.through_air(before.trimmed_wind)
    north = (moved.velocity_north - before.velocity_north) / h + DRAG * air_north
    east = (moved.velocity_east - before.velocity_east) / h + DRAG * air_east
    roll, pitch = lean(north, east, moved.heading)
    lag = 1 - math.exp(-h / 0.1)
    roll, pitch = before.roll + (roll - before.roll) * lag, before.pitch + (pitch - before.pitch) * lag
    return moved._replace(
        roll=roll, pitch=pitch, roll_rate=(roll - before.roll) / h, pitch_rate=(pitch - before.pitch) / h
    )
