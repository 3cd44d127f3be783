"""The vehicle's own motion without position: attitude, heading rate, airspeed, height. Never a position or a velocity.

Read from ATTITUDE or ATTITUDE_QUATERNION, VFR_HUD (of which the ground speed is not read) and the IMU messages
(`accelerations`). A value that is missing or older than its bound is None; who needs it says so.
"""

from dataclasses import dataclass, replace
from math import hypot, inf, nan, tan

from circnav_mav.guidance.types import OwnMotion
from circnav_mav.mav.accelerations import Accelerations, Attitude
from circnav_mav.mav.clocks import BOOT_WRAP, RemoteClock, Slower, nobody_tells
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import (
    GRAVITY,
    YawRate,
    course_from_yaw,
    euler_from_quaternion,
    push_from_tilt,
    turn_rate_from_yaw_rate,
)

MOST_TILT = 1.2
"""Tilt, rad, beyond which no turn is coordinated and no thrust carries the weight any more."""
ATTITUDE_MAX_AGE = 0.5
AIR_MAX_AGE = 1.5
MOST_LATE = 0.4
"""Longest time on the way, s, that an attitude is believed to have had; less than ATTITUDE_MAX_AGE, so that a clock
that was set anew never takes the heading away."""
OVERTAKEN = 0.5
"""An attitude whose stamp is older than the newest by up to this, s, was overtaken; by more, the vehicle's clock may
have been set anew (its 32-bit milliseconds do so every 49.7 days), which the next one proves."""
MOST_ANGLE, MOST_RATE, MOST_AIRSPEED, MOST_ALTITUDE = 6.3, 50.0, 200.0, 1e5
"""Magnitudes, rad, rad/s, m/s and m, beyond which a value is no measurement of a vehicle that we steer, but rubbish."""
NO_ROTATION = 0.1
"""A quaternion whose length differs by more from 1 is no attitude."""
FLOWN_ALTITUDES = -500.0, 6_000.0
"""Altitudes, m, whose thin air is believed."""
REPEATED = 0.2
"""The same stamp again within this time, s, is the same attitude again; later, it is a clock that stands still."""


@dataclass(frozen=True, slots=True)
class Motion:
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


def coordinated_yaw_rate(roll: float, airspeed: float) -> YawRate:
    """Yaw rate of a coordinated turn, rad/s clockwise positive. roll: rad, right positive. airspeed: m/s."""
    return YawRate(GRAVITY * tan(roll) / max(airspeed, 1.0))


class OwnMotionSensor:
    """Keeps the newest own motion, and forgets what is stale.

    An attitude counts from when it was measured, by the vehicle's own clock: on the way it may have waited, or been
    overtaken, and a heading that is .2 s off in time is a path that nobody flew.
    """

    def __init__(self, slower: Slower = nobody_tells) -> None:
        """slower: tells of the vehicle's link."""
        self._body: Attitude | None = None
        self._attitude_at = float("-inf")
        self._air = Motion()
        self._air_at = float("-inf")
        self._accelerations = Accelerations()
        self._clock = RemoteClock(slower, wrap=BOOT_WRAP)

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
        self._body = Attitude(message.time_boot_ms / 1e3, *values)
        self._attitude_at = max(measured, self._attitude_at)
        return True

    def _measured(self, stamp_ms: int, now: float) -> float | None:
        """When an attitude was measured, in our time; None for one that is not newer than the newest."""
        clock = self._clock
        stamp = clock.unwrapped(stamp_ms / 1000)
        later = inf if clock.newest is None else stamp - clock.newest
        if later == 0:
            return now if now - clock.newest_at > REPEATED else None
        if later < 0:
            anew = clock.set_anew(stamp, now)
            if later >= -OVERTAKEN or not anew:
                return None
            clock.reset()
        measured = clock.local(stamp, now)
        if now - measured > MOST_LATE:
            clock.reset()
            measured = clock.local(stamp, now)
        clock.take(stamp, now)
        return measured

    def own(self, now: float, airspeed: float, *, banks: bool = False) -> OwnMotion | None:
        """The motion as guidance sees it, at a true airspeed (m/s) that the caller stands for; None without attitude.
        banks: whether the vehicle banks to turn; else it flies by its tilt."""
        motion = self.at(now)
        if motion.yaw is None or motion.yaw_rate is None:
            return None
        psi = course_from_yaw(motion.yaw)
        turn_rate = turn_rate_from_yaw_rate(motion.yaw_rate)
        own = OwnMotion(self._attitude_at, psi, turn_rate, airspeed, felt=self._accelerations.felt)
        if motion.roll is None or motion.pitch is None:
            return own
        roll, pitch = (min(max(angle, -MOST_TILT), MOST_TILT) for angle in (motion.roll, motion.pitch))
        if banks:
            return replace(own, bank_turn=turn_rate_from_yaw_rate(coordinated_yaw_rate(roll, airspeed)))
        return replace(own, push=push_from_tilt(roll, pitch, psi))

    def at(self, now: float) -> Motion:
        """The motion as far as it is known at a moment."""
        air = self._air if now - self._air_at <= AIR_MAX_AGE else Motion()
        body = self._body if now - self._attitude_at <= ATTITUDE_MAX_AGE else None
        if body is None:
            return air
        return replace(air, roll=body.roll, pitch=body.pitch, yaw=body.yaw, yaw_rate=body.yaw_rate)


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
