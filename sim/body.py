"""The vehicle's physical state. NED meters from home, radians, clockwise seen from above."""

import math
from random import Random
from typing import NamedTuple

GRAVITY = 9.80665  # m/s^2
FREQUENCY = 0.32  # loop in which GPS corrects the estimate of tilt and velocity, rad/s
DAMPING = 0.45  # damping ratio of this loop
# random walk of roll, rad/sqrt(s), per rad of RMS roll error that it causes; pitch has half of this
# random walk
TILT_NOISE = 0.57
HARD_IRON = math.radians(0.2)  # amplitude of the compass error that repeats once per full turn
# bandwidth of an estimator without GPS, which assumes a vehicle at rest, rad/s
UNAIDED = 0.12
QUADRATIC_DRAG = 0.125  # quadratic over linear drag of a multicopter, s/m

Vector = tuple[float, float, float]
Line = tuple[tuple[float, float], ...]
"""Delayed commands, each as (seconds until it takes effect, value). The first entry is in
effect."""


class EstimateError(NamedTuple):
    """Error of the autopilot's estimate, estimated minus true: velocity m/s, tilt (`lean`) in g,
    heading rad.

    Noisy gyros tilt the estimate. Gravity then looks like a horizontal acceleration. The GPS
    corrects the errors of tilt and velocity within seconds. PX4's simulator SIH has 1 deg RMS of
    roll error, which behaves like an oscillator of 0.32 rad/s. SIH also has errors of 0.2 m/s in
    the velocity along the nose and of 1.1 deg in the heading. ArduPlane has 0.17 deg of roll error,
    0.1 deg of heading error, and another 0.2 deg that depends on the heading.
    """

    velocity: tuple[float, float] = (0.0, 0.0)
    lean: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    wander: float = 0.0  # the slowly varying part of the heading error
    place: tuple[float, float] = (
        0.0,
        0.0,
    )  # error of the position of an estimator without GPS

    def tilt(self, heading: float) -> tuple[float, float]:
        """Return the errors of roll and pitch, rad."""
        (north, east), cos, sin = self.lean, math.cos(heading), math.sin(heading)
        return east * cos - north * sin, -(north * cos + east * sin)

    def after(
        self, dt: float, roll: float, wander: float, heading: float, rng: Random
    ) -> "EstimateError":
        """Return the error dt later.

        roll: RMS roll error, rad.
        wander: RMS of the slowly varying heading error, rad.
        heading: true heading, rad.
        """
        noise = roll * TILT_NOISE * math.sqrt(dt)
        right, forward = rng.gauss(0.0, noise), rng.gauss(0.0, noise / 2)
        fresh = to_earth(forward, right, heading)
        # 12.0: correlation time of the heading error, s.
        kept = math.exp(-dt / 12.0)
        turned = kept * self.wander + rng.gauss(0.0, wander * math.sqrt(1 - kept * kept))
        moved = tuple(
            _corrected(*one, dt) for one in zip(self.velocity, self.lean, fresh, strict=True)
        )
        (north, lean_north), (east, lean_east) = moved
        off = turned + HARD_IRON * math.sin(heading)
        return EstimateError((north, east), (lean_north, lean_east), off, turned)

    def unaided(self, dt: float, acceleration: tuple[float, float]) -> "EstimateError":
        """Return the error dt later without GPS, as in ArduPilot's EKF3.

        The estimator assumes that the vehicle stays in place (within EK3_NOAID_M_NSE, 10 m). A
        lasting acceleration, north and east in m/s^2, looks like gravity, so that the estimated
        tilt is wrong by 1 to 3 deg in turns. With the wrong tilt, the compass gives a wrong
        heading.
        """
        north, east = (
            _standing(*one, dt)
            for one in zip(self.place, self.velocity, self.lean, acceleration, strict=True)
        )
        lean = north[2], east[2]
        # 2.1: tangent of the magnetic inclination, that is, the heading error per tilt error to the
        # east.
        return EstimateError((north[1], east[1]), lean, 2.1 * lean[1], 0.0, (north[0], east[0]))


def _standing(
    place: float, velocity: float, lean: float, acceleration: float, dt: float
) -> tuple[float, float, float]:
    """Return place, velocity and error of the lean after dt, for an estimator that measures "place
    = 0"."""
    measured = acceleration + GRAVITY * lean
    return (
        place + (velocity - 2 * UNAIDED * place) * dt,
        velocity + (measured - 2 * UNAIDED**2 * place) * dt,
        lean - UNAIDED**3 / GRAVITY * place * dt,
    )


def air_drag(coefficient: float, air: tuple[float, float], heading: float) -> tuple[float, float]:
    """Return the drag of a multicopter per mass against the air (north, east), m/s^2.

    coefficient: linear part of the drag, 1/s. The quadratic part is computed for each body axis
        separately, as in ArduPilot's simulator.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    forward, right = air[0] * cos + air[1] * sin, air[1] * cos - air[0] * sin
    return to_earth(
        coefficient * forward * (1 + QUADRATIC_DRAG * abs(forward)),
        coefficient * right * (1 + QUADRATIC_DRAG * abs(right)),
        heading,
    )


def _corrected(velocity: float, lean: float, fresh: float, dt: float) -> tuple[float, float]:
    lean += fresh - FREQUENCY**2 / GRAVITY * velocity * dt
    return velocity + (GRAVITY * lean - 2 * DAMPING * FREQUENCY * velocity) * dt, lean


class Body(NamedTuple):
    """Position, attitude and motion of the vehicle. Velocity is over the ground."""

    north: float
    east: float
    down: float
    heading: float
    turn_rate: float = 0.0  # rate of the heading, rad/s
    velocity_north: float = 0.0
    velocity_east: float = 0.0
    velocity_down: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    roll_rate: float = 0.0  # rate of the roll angle, rad/s
    pitch_rate: float = 0.0
    turn_acceleration: float = 0.0  # state of the yaw loop, rad/s^2
    course_rate: float = 0.0  # state of the velocity loop, rad/s
    course_feed: float = 0.0  # filtered feedforward of the velocity loop, rad/s
    push_north: float = 0.0  # integrators of the velocity loop, m/s^2
    push_east: float = 0.0
    air_speed: float = 0.0  # true airspeed of fixed wings
    climb_angle: float = 0.0  # flight path angle of a fixed wing, rad
    # Side-slip of a fixed wing: angle from the nose to the motion through the air, rad
    slip: float = 0.0
    gust_slip: float = 0.0  # the part of the side-slip caused by gusts
    trimmed_wind: tuple[float, float] = (
        0.0,
        0.0,
    )  # wind that the vehicle has compensated; the rest is a gust
    error: EstimateError = (
        EstimateError()
    )  # affects the reports and the inputs of the control loops
    on_the_way: Line = ()  # commands within the dead time (see through_line)

    @property
    def velocity(self) -> Vector:
        return self.velocity_north, self.velocity_east, self.velocity_down

    @property
    def ground_speed(self) -> float:
        return math.hypot(self.velocity_north, self.velocity_east)

    @property
    def course(self) -> float:
        """Direction of travel over the ground, rad. At standstill it is the heading."""
        if self.ground_speed < 1e-6:
            return self.heading
        return math.atan2(self.velocity_east, self.velocity_north)

    @property
    def forward_speed(self) -> float:
        return self.velocity_north * math.cos(self.heading) + self.velocity_east * math.sin(
            self.heading
        )

    @property
    def right_speed(self) -> float:
        return self.velocity_east * math.cos(self.heading) - self.velocity_north * math.sin(
            self.heading
        )

    def through_air(self, wind: tuple[float, float]) -> tuple[float, float]:
        return self.velocity_north - wind[0], self.velocity_east - wind[1]

    def airspeed(self, wind: tuple[float, float]) -> float:
        return math.hypot(*self.through_air(wind))

    def body_rates(self) -> tuple[float, float, float]:
        """Return the body rates p, q, r. They differ from the rates of the angles if the vehicle is
        tilted."""
        sin_roll = math.sin(self.roll)
        cos_roll = math.cos(self.roll)
        sin_pitch = math.sin(self.pitch)
        cos_pitch = math.cos(self.pitch)
        return (
            self.roll_rate - self.turn_rate * sin_pitch,
            self.pitch_rate * cos_roll + self.turn_rate * sin_roll * cos_pitch,
            self.turn_rate * cos_roll * cos_pitch - self.pitch_rate * sin_roll,
        )

    def from_earth(self, vector: Vector) -> Vector:
        """Return a NED vector in body axes: forward, right, down."""
        cr = math.cos(self.roll)
        sr = math.sin(self.roll)
        cp = math.cos(self.pitch)
        sp = math.sin(self.pitch)
        cy = math.cos(self.heading)
        sy = math.sin(self.heading)
        north, east, down = vector
        level = north * cy + east * sy
        right = east * cy - north * sy
        forward = level * cp - down * sp
        below = level * sp + down * cp
        return forward, right * cr + below * sr, below * cr - right * sr

    def quaternion(self) -> tuple[float, float, float, float]:
        """Attitude, w first."""
        cr = math.cos(self.roll / 2)
        sr = math.sin(self.roll / 2)
        cp = math.cos(self.pitch / 2)
        sp = math.sin(self.pitch / 2)
        cy = math.cos(self.heading / 2)
        sy = math.sin(self.heading / 2)
        return (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )


def to_earth(forward: float, right: float, heading: float) -> tuple[float, float]:
    """Return a horizontal vector (forward, right) as (north, east)."""
    cos, sin = math.cos(heading), math.sin(heading)
    return forward * cos - right * sin, forward * sin + right * cos


def within(value: float, limit: float) -> float:
    """Return the value limited to ±limit."""
    return max(-limit, min(limit, value))


def at_most(first: float, second: float, most: float) -> tuple[float, float]:
    """Return the vector, shortened to length `most` if it is longer."""
    size = math.hypot(first, second)
    share = min(1.0, most / size) if size > 0 else 1.0
    return first * share, second * share


def lean(north: float, east: float, heading: float) -> tuple[float, float]:
    """Return roll and pitch of a copter whose thrust accelerates it horizontally by this vector,
    m/s^2."""
    cos, sin = math.cos(heading), math.sin(heading)
    return math.atan((east * cos - north * sin) / GRAVITY), -math.atan(
        (north * cos + east * sin) / GRAVITY
    )


def euler(q: tuple[float, ...]) -> tuple[float, float, float]:
    """Return roll, pitch and heading of a unit quaternion, w first."""
    w, x, y, z = q
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(within(2 * (w * y - z * x), 1.0)),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def pieces(dt: float, longest: float) -> list[float]:
    """Return equal time steps of at most `longest` that add up to dt."""
    count = max(1, math.ceil(dt / longest - 1e-9))
    return [dt / count] * count


def through_line(line: Line, command: float, dead_time: float, h: float) -> Line:
    """Return the delay line `h` seconds later, with a new command. The value of its first entry is
    in effect."""
    line = tuple((left - h, value) for left, value in line)
    if not line or line[-1][1] != command:
        line += ((dead_time, command),)
    while len(line) > 1 and line[1][0] < h / 2:
        line = line[1:]
    return line


def second_order(error: float, rate: float, frequency: float, damping: float, h: float) -> float:
    """Return the rate after `h` seconds in a second-order loop that takes `error` to zero.
    frequency: rad/s."""
    return rate + (frequency**2 * error - 2 * damping * frequency * rate) * h
