"""The accelerations that an autopilot measures, as the change of the horizontal velocity.

Never a position or a velocity that the autopilot worked out.

HIGHRES_IMU (PX4), RAW_IMU and SCALED_IMU (ArduPilot sends milli-g in both): specific force in the body frame (forward,
right, down). Turned level by the newest attitude, carried on to the moment of the measurement by its own rates, for
1 deg of attitude is .17 m/s^2.
"""

from dataclasses import dataclass
from math import cos, isfinite, sin, tan

from circnav_mav.guidance.types import FeltVelocity
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import GRAVITY, YawRate, course_from_yaw, level_from_body, vector_from_level

MILLI_G = GRAVITY / 1000
UNITS = {"HIGHRES_IMU": 1.0, "RAW_IMU": MILLI_G, "SCALED_IMU": MILLI_G}
"""Message types by preference, and what their numbers are multiplied by, m/s^2."""
LONGEST_STEP = 0.2
"""Longest time between two measurements, s, over which they are integrated: 5 Hz. After a longer one it begins anew."""
OLDEST_ATTITUDE = 0.2
"""Oldest attitude that turns them level, s."""
MOST_FORCE = 16 * GRAVITY
"""Full scale of autopilots' accelerometers, m/s^2."""
OTHER_SOURCE = 2.0
"""Time, s, after which another message type is taken when the first one has ended."""


@dataclass(frozen=True, slots=True)
class Attitude:
    """As in an ATTITUDE: time (s, the vehicle's clock), roll, pitch, yaw (rad, NED), body rates p, q, r (rad/s)."""

    time: float
    roll: float
    pitch: float
    yaw: float
    p: float
    q: float
    r: float

    @property
    def yaw_rate(self) -> YawRate:
        """Heading rate, rad/s clockwise positive: (q sin(roll) + r cos(roll))/cos(pitch).

        ATTITUDE.yawspeed is the body z rate r: taking it for the heading rate cost 7 m of radius in flight.
        """
        return YawRate((self.q * sin(self.roll) + self.r * cos(self.roll)) / max(cos(self.pitch), 0.1))

    def at(self, time: float) -> tuple[float, float, float]:
        """Roll, pitch and yaw at another moment, by the rates."""
        dt, up = time - self.time, tan(min(max(self.pitch, -1.2), 1.2))
        roll_rate = self.p + (self.q * sin(self.roll) + self.r * cos(self.roll)) * up
        pitch_rate = self.q * cos(self.roll) - self.r * sin(self.roll)
        return self.roll + roll_rate * dt, self.pitch + pitch_rate * dt, self.yaw + self.yaw_rate * dt


class Accelerations:
    """Integrates the measured accelerations. After a gap, or what cannot be, it begins anew: `felt` says since when."""

    def __init__(self) -> None:
        self._type, self._heard_at = "", float("-inf")
        self._time: float | None = None
        self.felt: FeltVelocity | None = None

    def receive(self, message: Message, attitude: Attitude | None, now: float) -> None:
        """Take in one message of the vehicle, if it is one of accelerations."""
        type_ = message.get_type()
        if type_ not in UNITS or (type_ != self._type and now - self._heard_at < OTHER_SOURCE):
            return
        if type_ != self._type:
            self._type, self.felt = type_, None
        self._heard_at = now
        x, y, z = (UNITS[type_] * value for value in (message.xacc, message.yacc, message.zacc))
        time = message.time_boot_ms / 1e3 if type_ == "SCALED_IMU" else message.time_usec / 1e6
        before, self._time = self._time, time
        step = LONGEST_STEP + 1 if before is None else time - before
        sound = isfinite(x + y + z) and max(abs(x), abs(y), abs(z)) < MOST_FORCE
        if (
            not sound
            or attitude is None
            or abs(time - attitude.time) > OLDEST_ATTITUDE
            or not 0 <= step <= LONGEST_STEP
        ):
            self.felt = None
            return
        roll, pitch, yaw = attitude.at(time)
        ax, ay = vector_from_level(*level_from_body((x, y, z), roll, pitch), course_from_yaw(yaw))
        was = self.felt or FeltVelocity(0.0, 0.0, now)
        self.felt = FeltVelocity(was.x + ax * step, was.y + ay * step, was.since)
