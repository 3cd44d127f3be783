"""Real multicopters that hold a velocity, as measured in flight: ArduCopter's and PX4's."""

import math
from dataclasses import dataclass, replace

from ..body import GRAVITY, Body, at_most, lean, pieces, second_order, through_line, within
from ..config import Airframe
from ..demands import Brake, EarthVelocity

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

# PX4's loop
PROPORTIONAL, INTEGRAL, DERIVATIVE = 1.8, 0.4, 0.2
SINKING = 0.06  # m/s: what vz = 0 loses
CLIMB_LAG = 0.3


@dataclass(frozen=True)
class YawLoop:
    """A copter's turn rate: limit in rad/s, dead time in s, frequency in rad/s, acceleration limit in rad/s^2."""

    limit: float
    dead_time: float
    frequency: float
    damping: float
    most_acceleration: float = math.inf

    def configured(self, config: Airframe) -> "YawLoop":
        """As the vehicle file has it."""
        return replace(
            self,
            frequency=config.turn_frequency_rad_s or self.frequency,
            damping=config.turn_damping or self.damping,
        )

    def turn(self, body: Body, command: float, h: float) -> Body:
        line = through_line(body.on_the_way, command, self.dead_time, h)
        error = line[0][1] - body.turn_rate
        acceleration = second_order(error, body.turn_acceleration, self.frequency, self.damping, h)
        acceleration = within(acceleration, self.most_acceleration)
        rate = body.turn_rate + acceleration * h
        return body._replace(
            heading=math.remainder(body.heading + (body.turn_rate + rate) / 2 * h, math.tau),
            turn_rate=rate,
            turn_acceleration=acceleration,
            on_the_way=line,
        )


@dataclass(frozen=True)
class Multicopter:
    """ArduCopter 4.6.3: the wind is held against, a gust pushes until it is.

    A yaw-rate step shows nothing for 0.2 s, is half there after 0.35 s and overshoots by 20 %; the turn is then 1..6 %
    faster than asked, the more the harder it turns. The velocity follows behind the nose: its course is corrected by
    the error (a slip of 5 deg at 3 m/s and 0.2 rad/s, 10 at 5 and 0.3), unless the centripetal acceleration is fed
    forward.
    """

    yaw_loop: YawLoop
    drag: float = DRAG
    most_lean: float = math.radians(30)  # ANGLE_MAX

    def step(self, body: Body, demand: EarthVelocity | Brake, dt: float, wind: tuple[float, float]) -> Body:
        for h in pieces(dt, STEP):
            body = self._small_step(self._pushed(body, wind, h), demand, h)
        return body

    def _small_step(self, body: Body, demand: EarthVelocity | Brake, h: float) -> Body:
        wanted = demand if isinstance(demand, EarthVelocity) else EarthVelocity(0.0, 0.0, demand.down)
        command = within(wanted.yaw_rate, self.yaw_loop.limit)
        command *= 1 + YAW_EXCESS * abs(body.ground_speed * command) / GRAVITY
        turned = self.yaw_loop.turn(body, command, h)
        if isinstance(demand, Brake) and turned.ground_speed > STOPPED:
            moved = _brake(turned, demand.deceleration, h)
        elif min(math.hypot(wanted.north, wanted.east), body.ground_speed) < SLOW:
            moved = _towards(turned, wanted, h)
        else:
            moved = _follow(turned, wanted, h)
        moved = self._leant(moved, body, wanted, h)
        return self._tilted(_displaced(moved, body, wanted.down, h), body, h)

    def _pushed(self, body: Body, wind: tuple[float, float], h: float) -> Body:
        """What the wind has changed by since the loop was trimmed pushes, and is trimmed away in time."""
        gust_north, gust_east = wind[0] - body.trimmed_wind[0], wind[1] - body.trimmed_wind[1]
        share = h / TRIM_TIME
        return body._replace(
            velocity_north=body.velocity_north + self.drag * gust_north * h,
            velocity_east=body.velocity_east + self.drag * gust_east * h,
            trimmed_wind=(body.trimmed_wind[0] + gust_north * share, body.trimmed_wind[1] + gust_east * share),
        )

    def _thrust(self, moved: Body, before: Body, h: float) -> tuple[float, float]:
        """Horizontal acceleration that the thrust makes: what was flown and the drag in the wind it knows."""
        air_north, air_east = before.through_air(before.trimmed_wind)
        north = (moved.velocity_north - before.velocity_north) / h + self.drag * air_north
        east = (moved.velocity_east - before.velocity_east) / h + self.drag * air_east
        return north, east

    def _leant(self, moved: Body, before: Body, wanted: EarthVelocity, h: float) -> Body:
        """The lean limit: what turns the path comes first, what is left holds the speed (AP_Math limit_accel_xy)."""
        north, east = self._thrust(moved, before, h)
        most = GRAVITY * math.tan(self.most_lean)
        if math.hypot(north, east) <= most:
            return moved
        goal = math.hypot(wanted.north, wanted.east)
        if goal > SLOW:
            ahead = wanted.north / goal, wanted.east / goal
            across = within(east * ahead[0] - north * ahead[1], most)
            along = within(north * ahead[0] + east * ahead[1], math.sqrt(most**2 - across**2))
            north, east = along * ahead[0] - across * ahead[1], along * ahead[1] + across * ahead[0]
        else:
            north, east = at_most(north, east, most)
        air_north, air_east = before.through_air(before.trimmed_wind)
        return moved._replace(
            velocity_north=before.velocity_north + (north - self.drag * air_north) * h,
            velocity_east=before.velocity_east + (east - self.drag * air_east) * h,
        )

    def _tilted(self, moved: Body, before: Body, h: float) -> Body:
        """The attitude whose thrust, against the drag in the wind it knows, makes the acceleration just flown."""
        roll, pitch = lean(*self._thrust(moved, before, h), moved.heading)
        lag = 1 - math.exp(-h / 0.1)
        roll, pitch = before.roll + (roll - before.roll) * lag, before.pitch + (pitch - before.pitch) * lag
        return moved._replace(
            roll=roll, pitch=pitch, roll_rate=(roll - before.roll) / h, pitch_rate=(pitch - before.pitch) / h
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
    command = within(fed + error / correction_time, most)
    course_rate = body.course_rate + (command - body.course_rate) * (1 - math.exp(-h / COURSE_LAG))
    change = within((goal - speed) / SPEED_LAG, MOST_ACCELERATION)
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


@dataclass(frozen=True)
class DraggedCopter:
    """PX4's: the velocity loop in NED against drag, which is why a turning copter slows down and crabs. Drag in 1/s.

    MPC_XY_VEL_P_ACC 1.8, MPC_XY_VEL_I_ACC 0.4 and MPC_XY_VEL_D_ACC 0.2 with drag d make of a velocity setpoint that
    turns at w, with no acceleration fed forward, the share (1.8 jw + .4) / (-1.2 w^2 + (1.8 + d) jw + .4): with d =
    1/s, 5 m/s and 0.3 rad/s that is 3.78 m/s and 17 deg behind; 3.76 and 16 were flown.
    """

    yaw_loop: YawLoop
    drag: float
    most_lean: float = math.radians(45)  # MPC_TILTMAX_AIR

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
        most = GRAVITY * math.tan(self.most_lean)
        north, east = at_most(
            PROPORTIONAL * missing_north + body.push_north + wanted.acceleration_north,
            PROPORTIONAL * missing_east + body.push_east + wanted.acceleration_east,
            most,
        )
        limited = math.hypot(north, east) >= most * 0.999
        north, east = north - GRAVITY * lean_north, east - GRAVITY * lean_east
        drag_north, drag_east = (self.drag * speed for speed in body.through_air(wind))
        # the loop takes DERIVATIVE times the acceleration that comes of it off what it asks for
        north_rate, east_rate = (north - drag_north) / (1 + DERIVATIVE), (east - drag_east) / (1 + DERIVATIVE)
        velocity_north, velocity_east = body.velocity_north + north_rate * h, body.velocity_east + east_rate * h
        sink = body.velocity_down + (wanted.down + SINKING - body.velocity_down) * (1 - math.exp(-h / CLIMB_LAG))
        roll, pitch = lean(north_rate + drag_north, east_rate + drag_east, body.heading)
        return self.yaw_loop.turn(body, within(wanted.yaw_rate, self.yaw_loop.limit), h)._replace(
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
            roll_rate=within((roll - body.roll) / h, 4.0),
            pitch_rate=within((pitch - body.pitch) / h, 4.0),
        )
