"""The vehicle's own motion without position: attitude, heading rate, airspeed, height, measured accelerations. Never a
position or a velocity that the autopilot worked out.

Read from ATTITUDE or ATTITUDE_QUATERNION, VFR_HUD (of which the ground speed is not read) and the IMU messages. A value
that is missing or older than its bound is None; who needs it says so.
"""

from collections import deque
from math import cos, hypot, nan, remainder, sin, tan, tau
from typing import NamedTuple

from circnav_mav.guidance.types import FeltVelocity, OwnMotion
from circnav_mav.mav.clocks import BOOT_WRAP, Order, Slower, StampFilter, nobody_tells
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import (
    GRAVITY,
    YawRate,
    course_from_yaw,
    euler_from_quaternion,
    level_from_body,
    push_from_tilt,
    turn_rate_from_yaw_rate,
    vector_from_level,
)

MOST_TILT = 1.2
"""Tilt, rad, beyond which no turn is coordinated and no thrust carries the weight any more."""
ATTITUDE_MAX_AGE = 0.5
"""Age, s, from which on an attitude is none: the age of a stale range, ten messages at 20 Hz."""
AIR_MAX_AGE = 1.5
"""Age, s, from which on an airspeed is none; chosen, it comes more seldom than the attitude."""
MOST_LATE = 0.4
"""Longest time on the way, s, that an attitude is believed to have had; less than ATTITUDE_MAX_AGE, so that a clock
that was set anew never takes the heading away."""
JUMP = 0.5
"""Step back of the vehicle's clock, s, that shows that it was set anew. At most ATTITUDE_MAX_AGE: a single stamp of the
future makes all others older than the newest."""
MOST_ANGLE, MOST_RATE, MOST_AIRSPEED, MOST_ALTITUDE = 6.3, 50.0, 200.0, 1e5
"""Magnitudes, rad, rad/s, m/s and m, beyond which a value is no measurement of a vehicle that we steer, but rubbish."""
NO_ROTATION = 0.1
"""A quaternion whose length differs by more from 1 is no attitude."""
FLOWN_ALTITUDES = -500.0, 6_000.0
"""Altitudes, m, whose thin air is believed."""
YAW_JUMP = 0.35
"""Difference, rad, between a yaw and the one before carried on by the turn rates, from which on the autopilot has set
its yaw anew. Real turns stay far below: a change by 90 deg/s within 0.1 s makes 0.08 rad."""
LONGEST_CARRIED = 0.5
"""Longest time, s, over which a yaw is carried on for this comparison."""
FEWEST, FEWEST_WITHIN = 4, 3.0
"""Fewer attitudes than so many within so many seconds are too few: circnav asks for ten and more per second."""
REPEATED = 0.2
"""The same stamp again within this time, s, is the same attitude again; later, it is a clock that stands still."""
ACCELERATIONS = {"HIGHRES_IMU": 1.0, "RAW_IMU": GRAVITY / 1000, "SCALED_IMU": GRAVITY / 1000}
"""Message types by preference, and what their numbers are multiplied by, m/s^2."""
LONGEST_STEP = 0.2
"""Longest time between two measurements, s, over which they are integrated: 5 Hz. After a longer one it begins anew."""
OLDEST_ATTITUDE = 0.2
"""Oldest attitude that turns them level, s."""
MOST_FORCE = 16 * GRAVITY
"""Full scale of autopilots' accelerometers, m/s^2."""
OTHER_SOURCE = 2.0
"""Time, s, after which another message type is taken when the first one has ended."""


class Motion(NamedTuple):
    """roll, pitch, yaw: rad, NED (yaw clockwise from north). yaw_rate: heading rate, rad/s, clockwise positive.
    airspeed: m/s, indicated. altitude: m above sea level. climb: m/s, up positive. None: not known now."""

    roll: float | None = None
    pitch: float | None = None
    yaw: float | None = None
    yaw_rate: YawRate | None = None
    airspeed: float | None = None
    altitude: float | None = None
    climb: float | None = None

    def true_airspeed(self, indicated: float) -> float:
        """Of an indicated one, m/s: by the density of the standard atmosphere (ISO 2533) at this altitude; the
        indicated one where the altitude is not known."""
        if self.altitude is None:
            return indicated
        lowest, highest = FLOWN_ALTITUDES
        root_of_density: float = (1 - 2.25577e-5 * min(max(self.altitude, lowest), highest)) ** 2.12794
        return indicated / root_of_density


class Attitude(NamedTuple):
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


class OwnMotionSensor:
    """Keeps the newest own motion, and forgets what is stale.

    An attitude counts from when it was measured, by the vehicle's own clock: on the way it may have waited, or been
    overtaken, and a heading that is .2 s off in time is a path that nobody flew.
    """

    def __init__(self, slower: Slower = nobody_tells) -> None:
        """slower: tells of the vehicle's link."""
        self._body: Attitude | None = None
        """The newest attitude, its yaw without the jumps that do not count."""
        self._turned = Motion()
        """Of the newest attitude."""
        self._attitude_at = float("-inf")
        self._received: deque[float] = deque([float("-inf")] * FEWEST, maxlen=FEWEST)
        """Times at which the newest attitudes arrived, s."""
        self.keeps_heading = False
        """True while the vehicle is steered: then a jump of the yaw is no turn."""
        self.jumped = 0.0
        """Sum of the jumps of the yaw that do not count, rad, clockwise positive."""
        self._air = Motion()
        self._air_at = float("-inf")
        self._accelerations = Accelerations()
        self._clock = StampFilter(slower, wrap=BOOT_WRAP, jump=JUMP)

    def receive(self, message: Message, now: float) -> bool:
        """Take one message of the pinned vehicle in; tells whether it was a usable attitude, newer than all before."""
        if message.get_type() == "VFR_HUD":
            self._air = Motion(
                airspeed=_real(message.airspeed, MOST_AIRSPEED, above=0.0),
                altitude=_real(message.alt, MOST_ALTITUDE),
                climb=_real(message.climb, MOST_AIRSPEED),
            )
            self._air_at = now
            return False
        angles = _angles(message)
        if angles is None:
            self._accelerations.receive(message, self._body, now)
            return False
        values = (*angles, message.rollspeed, message.pitchspeed, message.yawspeed)
        bounds = (MOST_ANGLE, MOST_ANGLE, MOST_ANGLE, MOST_RATE, MOST_RATE, MOST_RATE)
        if not all(abs(value) <= bound for value, bound in zip(values, bounds, strict=True)):  # NaN is not, either
            return False
        measured = self._measured(message.time_boot_ms, now)
        if measured is None:
            return False
        body = Attitude(message.time_boot_ms / 1e3, *values)
        self._turned = Motion(body.roll, body.pitch, body.yaw, body.yaw_rate)
        self._watch_yaw(body, now)
        self._body = body._replace(yaw=remainder(body.yaw - self.jumped, tau))
        self._attitude_at = max(measured, self._attitude_at)
        self._received.append(now)
        return True

    def seldom(self, now: float) -> bool:
        """True if no attitudes come, or too few to know how the vehicle turns."""
        return now - self._received[0] > FEWEST_WITHIN

    def _watch_yaw(self, body: Attitude, now: float) -> None:
        """Find out whether the yaw has jumped. The EKF of an autopilot sets its yaw anew in flight, by up to 180 deg,
        when compass and GPS disagree. The vehicle has not turned: its path through the air goes on as before."""
        before, step = self._body, now - self._received[-1]
        if before is not None and body.time > before.time:
            step = body.time - before.time
        if before is None or not self.keeps_heading or step > LONGEST_CARRIED:
            return
        carried = before.yaw + (before.yaw_rate + body.yaw_rate) / 2 * step
        jump = remainder(body.yaw - self.jumped - carried, tau)
        if abs(jump) > YAW_JUMP:
            self.jumped = remainder(self.jumped + jump, tau)

    def _measured(self, stamp_ms: int, now: float) -> float | None:
        """When an attitude was measured, in our time; None for one that is not newer than the newest."""
        clock = self._clock
        stamp = clock.unwrapped(stamp_ms / 1000)
        order = clock.order(stamp, now)
        if order is Order.REPEATED:
            return now if now - clock.newest_at > REPEATED else None
        if order in (Order.OLDER, Order.JUMPED):
            return None
        measured = clock.local(stamp, now)
        if now - measured > MOST_LATE:
            clock.reset()
            measured = clock.local(stamp, now)
        clock.take(stamp, now)
        return measured

    def own(self, now: float, airspeed: float, *, banks: bool = False) -> OwnMotion | None:
        """The motion as guidance sees it, at a true airspeed (m/s) that the caller stands for; None without attitude.
        banks: whether the vehicle banks to turn; else it flies by its tilt."""
        body = self._attitude(now)
        if body is None:
            return None
        psi, turn_rate = course_from_yaw(body.yaw), turn_rate_from_yaw_rate(body.yaw_rate)
        own = OwnMotion(self._attitude_at, psi, turn_rate, airspeed, felt=self._accelerations.felt)
        roll, pitch = (min(max(angle, -MOST_TILT), MOST_TILT) for angle in (body.roll, body.pitch))
        if banks:
            coordinated = YawRate(GRAVITY * tan(roll) / max(airspeed, 1.0))
            above = pitch - (self.at(now).climb or 0.0) / max(airspeed, 1.0)
            return own._replace(bank_turn=turn_rate_from_yaw_rate(coordinated), bank=-roll, pitch=above)
        return own._replace(push=push_from_tilt(roll, pitch, psi))

    def at(self, now: float) -> Motion:
        """The motion as far as it is known at a moment."""
        air = self._air if now - self._air_at <= AIR_MAX_AGE else Motion()
        if self._attitude(now) is None:
            return air
        roll, pitch, yaw, yaw_rate, *_ = self._turned
        return Motion(roll, pitch, yaw, yaw_rate, air.airspeed, air.altitude, air.climb)

    def _attitude(self, now: float) -> Attitude | None:
        return self._body if now - self._attitude_at <= ATTITUDE_MAX_AGE else None


def _angles(message: Message) -> tuple[float, float, float] | None:
    """Roll, pitch and yaw of an attitude, of either message; None of any other. A vehicle may send both: one of a
    stamp is enough. A quaternion that is none gives NaN."""
    if message.get_type() == "ATTITUDE":
        return message.roll, message.pitch, message.yaw
    if message.get_type() != "ATTITUDE_QUATERNION":
        return None
    q = message.q1, message.q2, message.q3, message.q4
    return euler_from_quaternion(q) if abs(hypot(*q) - 1) < NO_ROTATION else (nan, nan, nan)


def _real(value: float, most: float, above: float = float("-inf")) -> float | None:
    """A value that can be, above a bound, else None: PX4's copter sends NaN airspeed, ArduPilot 0 before take-off."""
    return value if abs(value) <= most and value > above else None


class Accelerations:
    """Integrates the specific force in the body frame (ArduPilot sends it in milli-g), turned level by the newest
    attitude, carried on to the moment of the measurement: 1 deg of attitude is .17 m/s^2. After a gap, or what cannot
    be, it begins anew: `felt` says since when."""

    def __init__(self) -> None:
        self._type, self._heard_at, self._time = "", float("-inf"), float("-inf")
        self.felt: FeltVelocity | None = None

    def receive(self, message: Message, attitude: Attitude | None, now: float) -> None:
        """Take in one message of the vehicle, if it is one of accelerations."""
        kind = message.get_type()
        if kind not in ACCELERATIONS or (kind != self._type and now - self._heard_at < OTHER_SOURCE):
            return
        if kind != self._type:
            self._type, self.felt = kind, None
        self._heard_at = now
        unit = ACCELERATIONS[kind]
        force = unit * message.xacc, unit * message.yacc, unit * message.zacc
        time = message.time_boot_ms / 1e3 if kind == "SCALED_IMU" else message.time_usec / 1e6
        step, self._time = time - self._time, time
        sound = 0 <= step <= LONGEST_STEP and all(abs(value) < MOST_FORCE for value in force)  # NaN is not
        if not sound or attitude is None or abs(time - attitude.time) > OLDEST_ATTITUDE:
            self.felt = None
            return
        roll, pitch, yaw = attitude.at(time)
        ax, ay = vector_from_level(*level_from_body(force, roll, pitch), course_from_yaw(yaw))
        was = self.felt or FeltVelocity(0.0, 0.0, now)
        self.felt = FeltVelocity(was.x + ax * step, was.y + ay * step, was.since)
