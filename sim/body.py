"""The vehicle's physical state. NED metres from home, radians, clockwise seen from above."""

import math
from random import Random
from typing import NamedTuple

GRAVITY = 9.80665  # m/s^2
FREQUENCY, DAMPING = 0.32, 0.45  # of the correction by GPS, rad/s
TILT_NOISE = 0.57  # of the gyro about the nose, for each rad of roll error, 1/s^.5; half of it about the wings
HEADING_TIME = 12.0  # s
HARD_IRON = math.radians(0.2)  # of the heading, once round the compass

Vector = tuple[float, float, float]
Line = tuple[tuple[float, float], ...]
"""Commands on their way: seconds until each arrives and its value. The first has arrived and is in force."""


class EstimateError(NamedTuple):
    """What an autopilot believes, and flies by, less what is true: m/s; the acceleration of the tilt in g; rad.

    Noisy gyros tilt the estimate; gravity then looks like an acceleration, and the GPS takes both back within seconds:
    in PX4's SIH 1 deg of roll like an oscillator of 0.32 rad/s, with 0.2 m/s of velocity along the nose and 1.1 deg of
    heading; ArduPlane 0.17 deg of it, 0.1 of heading, and 0.2 that goes with the heading itself.
    """

    velocity: tuple[float, float] = (0.0, 0.0)
    lean: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    wander: float = 0.0  # the part of it that comes and goes

    def tilt(self, heading: float) -> tuple[float, float]:
        """Of roll and pitch, rad."""
        (north, east), cos, sin = self.lean, math.cos(heading), math.sin(heading)
        return east * cos - north * sin, -(north * cos + east * sin)

    def after(self, dt: float, roll: float, wander: float, heading: float, rng: Random) -> "EstimateError":
        """A step later; roll, wander: rms of these, rad; heading: of the nose."""
        noise = roll * TILT_NOISE * math.sqrt(dt)
        right, forward = rng.gauss(0.0, noise), rng.gauss(0.0, noise / 2)
        fresh = to_earth(forward, right, heading)
        kept = math.exp(-dt / HEADING_TIME)
        turned = kept * self.wander + rng.gauss(0.0, wander * math.sqrt(1 - kept * kept))
        moved = tuple(_corrected(*one, dt) for one in zip(self.velocity, self.lean, fresh, strict=True))
        (north, lean_north), (east, lean_east) = moved
        off = turned + HARD_IRON * math.sin(heading)
        return EstimateError((north, east), (lean_north, lean_east), off, turned)


def _corrected(velocity: float, lean: float, fresh: float, dt: float) -> tuple[float, float]:
    lean += fresh - FREQUENCY**2 / GRAVITY * velocity * dt
    return velocity + (GRAVITY * lean - 2 * DAMPING * FREQUENCY * velocity) * dt, lean


class Body(NamedTuple):
    """Where the vehicle is and how it moves; velocity is over the ground."""

    north: float
    east: float
    down: float
    heading: float
    turn_rate: float = 0.0  # of the heading, rad/s
    velocity_north: float = 0.0
    velocity_east: float = 0.0
    velocity_down: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    roll_rate: float = 0.0  # of the roll angle, rad/s
    pitch_rate: float = 0.0
    turn_acceleration: float = 0.0  # inside the yaw loop, rad/s^2
    course_rate: float = 0.0  # inside the velocity loop, rad/s
    course_feed: float = 0.0  # what of a fed-forward turn has arrived there, rad/s
    push_north: float = 0.0  # integrators of the velocity loop, m/s^2
    push_east: float = 0.0
    air_speed: float = 0.0  # true, of vehicles that fly by it
    climb_angle: float = 0.0  # flight path angle of a fixed wing, rad
    slip: float = 0.0  # of a fixed wing: from the nose to the direction of flight through the air, rad
    gust_slip: float = 0.0  # the part of it that a gust made
    trimmed_wind: tuple[float, float] = (0.0, 0.0)  # what the vehicle has settled in; what differs is a gust
    error: EstimateError = EstimateError()  # of the estimate: it is reported, and flown by
    on_the_way: Line = ()  # commands within the dead time (through_line)

    @property
    def velocity(self) -> Vector:
        return self.velocity_north, self.velocity_east, self.velocity_down

    @property
    def ground_speed(self) -> float:
        return math.hypot(self.velocity_north, self.velocity_east)

    @property
    def course(self) -> float:
        """Direction of travel over the ground; the heading when standing still."""
        if self.ground_speed < 1e-6:
            return self.heading
        return math.atan2(self.velocity_east, self.velocity_north)

    @property
    def forward_speed(self) -> float:
        return self.velocity_north * math.cos(self.heading) + self.velocity_east * math.sin(self.heading)

    @property
    def right_speed(self) -> float:
        return self.velocity_east * math.cos(self.heading) - self.velocity_north * math.sin(self.heading)

    def through_air(self, wind: tuple[float, float]) -> tuple[float, float]:
        return self.velocity_north - wind[0], self.velocity_east - wind[1]

    def airspeed(self, wind: tuple[float, float]) -> float:
        return math.hypot(*self.through_air(wind))

    def body_rates(self) -> tuple[float, float, float]:
        """What the gyros read (p, q, r): not the rates of the angles once the vehicle is tilted."""
        sin_roll, cos_roll = math.sin(self.roll), math.cos(self.roll)
        sin_pitch, cos_pitch = math.sin(self.pitch), math.cos(self.pitch)
        return (
            self.roll_rate - self.turn_rate * sin_pitch,
            self.pitch_rate * cos_roll + self.turn_rate * sin_roll * cos_pitch,
            self.turn_rate * cos_roll * cos_pitch - self.pitch_rate * sin_roll,
        )

    def from_earth(self, vector: Vector) -> Vector:
        """A vector in NED as it is seen from the vehicle: forward, right, down."""
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        cp, sp = math.cos(self.pitch), math.sin(self.pitch)
        cy, sy = math.cos(self.heading), math.sin(self.heading)
        north, east, down = vector
        level, right = north * cy + east * sy, east * cy - north * sy
        forward, below = level * cp - down * sp, level * sp + down * cp
        return forward, right * cr + below * sr, below * cr - right * sr

    def quaternion(self) -> tuple[float, float, float, float]:
        """Attitude, w first."""
        cr, sr = math.cos(self.roll / 2), math.sin(self.roll / 2)
        cp, sp = math.cos(self.pitch / 2), math.sin(self.pitch / 2)
        cy, sy = math.cos(self.heading / 2), math.sin(self.heading / 2)
        return (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )


def to_earth(forward: float, right: float, heading: float) -> tuple[float, float]:
    """A horizontal vector seen from the nose as north and east."""
    cos, sin = math.cos(heading), math.sin(heading)
    return forward * cos - right * sin, forward * sin + right * cos


def within(value: float, limit: float) -> float:
    """The nearest value from -limit to limit."""
    return max(-limit, min(limit, value))


def at_most(first: float, second: float, most: float) -> tuple[float, float]:
    """A vector, no longer than that."""
    size = math.hypot(first, second)
    share = min(1.0, most / size) if size > 0 else 1.0
    return first * share, second * share


def lean(north: float, east: float, heading: float) -> tuple[float, float]:
    """The roll and pitch of a copter whose thrust accelerates it so, m/s^2."""
    cos, sin = math.cos(heading), math.sin(heading)
    return math.atan((east * cos - north * sin) / GRAVITY), -math.atan((north * cos + east * sin) / GRAVITY)


def euler(q: tuple[float, ...]) -> tuple[float, float, float]:
    """Roll, pitch and heading of a unit quaternion, w first."""
    w, x, y, z = q
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(within(2 * (w * y - z * x), 1.0)),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def pieces(dt: float, longest: float) -> list[float]:
    """A time step cut into equal ones."""
    count = max(1, math.ceil(dt / longest - 1e-9))
    return [dt / count] * count


def through_line(line: Line, command: float, dead_time: float, h: float) -> Line:
    """The line `h` seconds later, with a command put in now; what comes out is the value of its first entry."""
    line = tuple((left - h, value) for left, value in line)
    if not line or line[-1][1] != command:
        line += ((dead_time, command),)
    while len(line) > 1 and line[1][0] < h / 2:
        line = line[1:]
    return line


def second_order(error: float, rate: float, frequency: float, damping: float, h: float) -> float:
    """The rate of change `h` seconds later of a loop that takes `error` to zero; frequency in rad/s."""
    return rate + (frequency**2 * error - 2 * damping * frequency * rate) * h
