"""Realistic multicopters under velocity control, fitted to flights of ArduCopter and PX4."""

import math
from dataclasses import dataclass, replace

from ..body import (
    GRAVITY,
    Body,
    air_drag,
    at_most,
    lean,
    pieces,
    second_order,
    through_line,
    within,
)
from ..config import Airframe
from ..demands import Brake, EarthVelocity

STEP = 0.02  # longest integration step, s
YAW_EXCESS = 0.23  # relative excess of the turn rate per g of centripetal acceleration
FEED_SHARE = 0.9  # effective share of the acceleration feedforward
FEED_LAG = 0.8  # lag of the acceleration feedforward, s
COURSE_LAG = 0.3  # lag of the course rate behind its command, s: the time to bank
SPEED_LAG = 0.5  # lag of the speed, s
MOST_ACCELERATION = 2.5  # WPNAV_ACCEL, m/s^2
SLOW = 0.5  # speed below which the course is undefined, m/s
DRAG = 0.24  # linear part of the drag, 1/s: 10 deg of pitch give 4.6 m/s
TRIM_TIME = 2.0  # time in which the integrator (PSC_VELXY_P / I) compensates a new wind, s

# PX4's velocity loop
PROPORTIONAL = 1.8
INTEGRAL = 0.4
DERIVATIVE = 0.2
SINKING = 0.06  # sink rate with a vertical velocity setpoint of 0, m/s
CLIMB_LAG = 0.3  # lag of the climb rate, s


@dataclass(frozen=True)
class YawLoop:
    """Second-order loop of a copter's turn rate.

    limit: largest turn rate, rad/s.
    dead_time: s.
    frequency: rad/s.
    damping: damping ratio.
    most_acceleration: largest change of the turn rate, rad/s^2.
    """

    limit: float
    dead_time: float
    frequency: float
    damping: float
    most_acceleration: float = math.inf

    def configured(self, config: Airframe) -> "YawLoop":
        """Apply the vehicle file."""
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
    """ArduCopter 4.6.3. It compensates a steady wind. A gust displaces the copter until the
    velocity loop has compensated the gust.

    A step of the commanded yaw rate acts after a dead time of 0.2 s. The turn rate reaches half its
    value after 0.35 s and overshoots by 20 %. The turn is then 1 to 6 % faster than commanded,
    increasing with the turn rate.

    The direction of the velocity lags behind the nose: by 5 deg at 3 m/s and 0.2 rad/s, by 10 deg
    at 5 m/s and 0.3 rad/s. A setpoint with centripetal acceleration removes this lag.
    """

    yaw_loop: YawLoop
    drag: float = DRAG
    most_lean: float = math.radians(30)  # ANGLE_MAX

    def step(
        self, body: Body, demand: EarthVelocity | Brake, dt: float, wind: tuple[float, float]
    ) -> Body:
        for h in pieces(dt, STEP):
            body = self._small_step(self._pushed(body, wind, h), demand, h)
        return body

    def _small_step(self, body: Body, demand: EarthVelocity | Brake, h: float) -> Body:
        wanted = (
            demand if isinstance(demand, EarthVelocity) else EarthVelocity(0.0, 0.0, demand.down)
        )
        command = within(wanted.yaw_rate, self.yaw_loop.limit)
        command *= 1 + YAW_EXCESS * abs(body.ground_speed * command) / GRAVITY
        turned = self.yaw_loop.turn(body, command, h)
        # 0.1: speed below which the velocity loop takes over from braking, m/s.
        if isinstance(demand, Brake) and turned.ground_speed > 0.1:
            moved = _brake(turned, demand.deceleration, h)
        elif min(math.hypot(wanted.north, wanted.east), body.ground_speed) < SLOW:
            moved = _towards(turned, wanted, h)
        else:
            moved = _follow(turned, wanted, h)
        moved = self._leant(moved, body, wanted, h)
        return self._tilted(_displaced(moved, body, wanted.down, h), body, h)

    def _pushed(self, body: Body, wind: tuple[float, float], h: float) -> Body:
        """Apply the drag that a change of the wind causes. The velocity loop compensates this drag
        within TRIM_TIME."""
        gust_north = wind[0] - body.trimmed_wind[0]
        gust_east = wind[1] - body.trimmed_wind[1]
        share = h / TRIM_TIME
        before = air_drag(self.drag, body.through_air(body.trimmed_wind), body.heading)
        after = air_drag(self.drag, body.through_air(wind), body.heading)
        return body._replace(
            velocity_north=body.velocity_north + (before[0] - after[0]) * h,
            velocity_east=body.velocity_east + (before[1] - after[1]) * h,
            trimmed_wind=(
                body.trimmed_wind[0] + gust_north * share,
                body.trimmed_wind[1] + gust_east * share,
            ),
        )

    def _thrust(self, moved: Body, before: Body, h: float) -> tuple[float, float]:
        """Return the horizontal acceleration by thrust, m/s^2: the acceleration flown in this step,
        plus the drag in the wind that the loop has compensated."""
        drag_north, drag_east = self._drag(before)
        north = (moved.velocity_north - before.velocity_north) / h + drag_north
        east = (moved.velocity_east - before.velocity_east) / h + drag_east
        return north, east

    def _leant(self, moved: Body, before: Body, wanted: EarthVelocity, h: float) -> Body:
        """Apply the lean limit. Acceleration across the path has priority over acceleration along
        the path (AP_Math limit_accel_xy)."""
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
        drag_north, drag_east = self._drag(before)
        return moved._replace(
            velocity_north=before.velocity_north + (north - drag_north) * h,
            velocity_east=before.velocity_east + (east - drag_east) * h,
        )

    def _drag(self, body: Body) -> tuple[float, float]:
        return air_drag(self.drag, body.through_air(body.trimmed_wind), body.heading)

    def _tilted(self, moved: Body, before: Body, h: float) -> Body:
        """Set the attitude that gives the acceleration just flown and balances the drag of the
        compensated wind."""
        roll, pitch = lean(*self._thrust(moved, before, h), moved.heading)
        lag = 1 - math.exp(-h / 0.1)
        roll = before.roll + (roll - before.roll) * lag
        pitch = before.pitch + (pitch - before.pitch) * lag
        return moved._replace(
            roll=roll,
            pitch=pitch,
            roll_rate=(roll - before.roll) / h,
            pitch_rate=(pitch - before.pitch) / h,
        )


def _follow(body: Body, wanted: EarthVelocity, h: float) -> Body:
    """Move speed and course towards the setpoint. The course follows the course error and the
    acceleration feedforward."""
    goal = math.hypot(wanted.north, wanted.east)
    speed = body.ground_speed
    feed = (
        FEED_SHARE
        * (wanted.north * wanted.acceleration_east - wanted.east * wanted.acceleration_north)
        / goal**2
    )
    fed = body.course_feed + (feed - body.course_feed) * (1 - math.exp(-h / FEED_LAG))
    error = math.remainder(math.atan2(wanted.east, wanted.north) - body.course, math.tau)
    sideways = min(MOST_ACCELERATION, abs(speed * wanted.yaw_rate))
    correction_time = 0.3 + 0.2 * sideways  # s; longer in a hard turn
    # The limit applies only to the correction: ArduCopter adds the acceleration feedforward after
    # limiting.
    command = fed + within(error / correction_time, 1.4 * MOST_ACCELERATION / speed)
    course_rate = body.course_rate + (command - body.course_rate) * (1 - math.exp(-h / COURSE_LAG))
    change = within((goal - speed) / SPEED_LAG, MOST_ACCELERATION)
    course = body.course + course_rate * h
    after = speed + change * h
    return body._replace(
        velocity_north=after * math.cos(course),
        velocity_east=after * math.sin(course),
        course_rate=course_rate,
        course_feed=fed,
    )


def _towards(body: Body, wanted: EarthVelocity, h: float) -> Body:
    """Move the velocity straight towards the setpoint, for starts and stops."""
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
    """PX4's copter: a velocity loop in NED against drag (1/s). The lag of the loop makes a turning
    copter slow down and crab.

    The gains are MPC_XY_VEL_P_ACC 1.8, MPC_XY_VEL_I_ACC 0.4 and MPC_XY_VEL_D_ACC 0.2. For a
    velocity setpoint that turns at w without feedforward, and drag d, the transfer function is
    (1.8 jw + 0.4) / (-1.2 w^2 + (1.8 + d) jw + 0.4).
    With d = 1/s, 5 m/s and 0.3 rad/s it predicts 3.78 m/s and a lag of 17 deg. PX4 flew 3.76 m/s
    and 16 deg.
    """

    yaw_loop: YawLoop
    drag: float
    most_lean: float = math.radians(45)  # MPC_TILTMAX_AIR

    def step(
        self, body: Body, demand: EarthVelocity | Brake, dt: float, wind: tuple[float, float]
    ) -> Body:
        wanted = (
            demand if isinstance(demand, EarthVelocity) else EarthVelocity(0.0, 0.0, demand.down)
        )
        for h in pieces(dt, STEP):
            body = self._small_step(body, wanted, h, wind)
        return body

    def _small_step(
        self, body: Body, wanted: EarthVelocity, h: float, wind: tuple[float, float]
    ) -> Body:
        # The velocity loop controls the estimated velocity, so the true velocity differs from the
        # setpoint by the error of the estimate.
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
        # The derivative term subtracts DERIVATIVE times the resulting acceleration.
        north_rate = (north - drag_north) / (1 + DERIVATIVE)
        east_rate = (east - drag_east) / (1 + DERIVATIVE)
        velocity_north = body.velocity_north + north_rate * h
        velocity_east = body.velocity_east + east_rate * h
        sink = body.velocity_down + (wanted.down + SINKING - body.velocity_down) * (
            1 - math.exp(-h / CLIMB_LAG)
        )
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
