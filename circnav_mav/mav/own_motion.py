"""The vehicle's own motion without position: attitude, heading rate, airspeed, height and measured
accelerations.

The position and the velocity that the autopilot estimates are never used. Sources: ATTITUDE or
ATTITUDE_QUATERNION, VFR_HUD (except its ground speed), the relative altitude of GLOBAL_POSITION_INT
and the IMU messages. A value that is missing, old or no longer updated is None.
"""

from collections import deque
from math import cos, hypot, isinf, nan, remainder, sin, tan, tau
from typing import NamedTuple

from circnav_mav.guidance.types import GRAVITY, IntegratedAcceleration, OwnMotion
from circnav_mav.mav.clocks import BOOT_WRAP, Order, Slower, StampFilter, no_link_delay
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import (
    YawRate,
    drag_from_body,
    euler_from_quaternion,
    heading_enu_from_yaw_ned,
    level_from_body,
    thrust_acceleration_from_tilt,
    turn_rate_from_yaw_rate,
    vector_from_level,
)
from circnav_mav.timers import Hysteresis, LowPass, Report

MOST_TILT = 1.2
"""Largest tilt, rad, used in calculations. Beyond it turns are not coordinated and thrust does not
hold the weight."""
ATTITUDE_MAX_AGE = 0.5
"""Largest age of an attitude that is used, s: equal to the default `max_age` of a range, and ten
message intervals at 20 Hz."""
AIR_MAX_AGE = 1.5
"""Largest age of airspeed, altitude and climb rate that is used, s. VFR_HUD is sent less often than
the attitude."""
# Largest plausible angle (rad), body rate (rad/s), airspeed and climb rate (m/s), and altitude (m).
# Larger values are discarded.
MOST_ANGLE = 6.3
MOST_RATE = 50.0
MOST_AIRSPEED = 200.0
MOST_ALTITUDE = 1e4
MOST_CLIMB = 20.0
"""Largest plausible climb or sink rate, m/s, more than any supported vehicle has. A faster change
of an altitude is a reset of its zero."""
BUNCHED = 0.25
"""Least time, s, assumed between two altitude measurements, because a link may deliver several at
once."""
FROZEN_ALTITUDE = 2.0
"""Time, s, for which an altitude may stay the same while the vehicle climbs or sinks. Afterwards
the altitude is treated as missing. ArduCopter repeats VFR_HUD.alt from 15 s after a loss of GPS."""
FROZEN_AIRSPEED = 3.0
"""Time, s, for which a measured airspeed may stay the same while the climb rate changes. Afterwards
the airspeed is treated as missing. A healthy sensor is noisy, so its reports differ."""
FROZEN_ACCELERATIONS = 2.0
"""Time, s, for which accelerations may stay the same while the tilt changes. Afterwards they are
treated as missing."""
MOVES = 0.5
"""Climb rate, m/s, or change of the relative altitude, m, that shows that the vehicle climbs or
sinks. The reported altitude must then change, too."""
FEWEST = 4
"""Least number of attitudes within FEWEST_WITHIN that suffices to follow the vehicle's turns.
circnav requests 20 attitudes per second."""
FEWEST_WITHIN = 3.0
"""Time in which attitudes are counted, s."""
REPEATED = 0.2
"""Largest age of the newest stamp, s, at which an equal stamp is a repeated message. At a larger
age, the vehicle's clock has stopped."""
ACCELERATIONS = {
    "HIGHRES_IMU": 1.0,
    "RAW_IMU": GRAVITY / 1000,
    "SCALED_IMU": GRAVITY / 1000,
    "SCALED_IMU2": GRAVITY / 1000,
    "SCALED_IMU3": GRAVITY / 1000,
}
"""Unit of the raw acceleration, m/s^2, by message type, in the order of preference."""
MOST_FORCE = 16 * GRAVITY
"""Full scale of autopilots' accelerometers, m/s^2."""


class Motion(NamedTuple):
    """Newest attitude and air data. None: unknown now.

    roll, pitch, yaw: rad, NED (yaw clockwise from north).
    yaw_rate: heading rate, rad/s, clockwise positive.
    airspeed: indicated, m/s.
    altitude: m above sea level.
    climb: m/s, up positive.
    above_home: altitude above home, m.
    """

    roll: float | None = None
    pitch: float | None = None
    yaw: float | None = None
    yaw_rate: YawRate | None = None
    airspeed: float | None = None
    altitude: float | None = None
    climb: float | None = None
    above_home: float | None = None

    @property
    def home_altitude(self) -> float | None:
        """Altitude of home above sea level, m."""
        if self.altitude is None or self.above_home is None:
            return None
        return self.altitude - self.above_home

    def true_airspeed(self, indicated: float) -> float:
        """Return the true airspeed for an indicated airspeed, m/s, from the standard atmosphere's
        density (ISO 2533).

        Without an altitude, return the indicated airspeed.
        """
        if self.altitude is None:
            return indicated
        root_of_density: float = (1 - 2.25577e-5 * self.altitude) ** 2.12794
        return indicated / root_of_density


class Attitude(NamedTuple):
    """Fields of an ATTITUDE: time (s, the vehicle's clock), roll, pitch, yaw (rad, NED), body rates
    p, q, r (rad/s)."""

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

        ATTITUDE.yawspeed is the body z rate r. Used as the heading rate, it caused a radius error
        of 7 m in flight.
        """
        return YawRate(
            (self.q * sin(self.roll) + self.r * cos(self.roll)) / max(cos(self.pitch), 0.1)
        )

    def at(self, time: float) -> tuple[float, float, float]:
        """Return roll, pitch and yaw at another time, extrapolated with the rates."""
        dt = time - self.time
        up = tan(_tilt(self)[1])
        roll_rate = self.p + (self.q * sin(self.roll) + self.r * cos(self.roll)) * up
        pitch_rate = self.q * cos(self.roll) - self.r * sin(self.roll)
        return (
            self.roll + roll_rate * dt,
            self.pitch + pitch_rate * dt,
            self.yaw + self.yaw_rate * dt,
        )


class OwnMotionSensor:
    """Newest own motion of the vehicle, without stale values.

    The age of an attitude counts from its measurement, by the vehicle's own clock. On the link a
    message may be delayed or reordered, and a heading with a time error of 0.2 s distorts the
    reconstructed path.
    """

    def __init__(self, slower: Slower = no_link_delay) -> None:
        """slower: delay increase of the vehicle's link."""
        self._body: Attitude | None = None
        """Newest attitude, its yaw without resets by the autopilot."""
        self._turned = Motion()
        """Roll, pitch, yaw and yaw rate of the newest attitude, as reported."""
        self._newest: tuple[float, Motion] | None = None
        """Time and result of the newest call of `at` since the newest message."""
        self._attitude_at = float("-inf")
        self._received: deque[float] = deque([float("-inf")] * FEWEST, maxlen=FEWEST)
        """Arrival times of the newest attitudes, s."""
        self.keeps_heading = False
        """True while the vehicle is steered: a yaw jump is then a reset, not a turn."""
        self.jumped = 0.0
        """Sum of the autopilot's yaw resets while steered, rad, clockwise positive."""
        self._airspeed: Report[float | None] = Report()
        self._climb: Report[float | None] = Report()
        self._altitude: Report[float | None] = Report()
        """VFR_HUD.alt. `_above_home` at its newest change is `_above_home_then`."""
        self._above_home: Report[float | None] = Report()
        self._above_home_then: float | None = None
        # 1.0: time, s, for which attitudes must be rare before this is reported. A stream that
        # begins at the engagement is given this time: at 10 Hz, four attitudes take 0.4 s.
        self._rare = Hysteresis(raise_after=1.0, clear_after=10.0)
        self.accelerations = Accelerations()
        # 0.5: backward step of the vehicle's clock, s, that is taken as a clock reset. After a
        # stamp that is wrongly ahead by less, later stamps look older and are rejected for up to
        # this time. So this step must not exceed ATTITUDE_MAX_AGE.
        self._clock = StampFilter(slower, wrap=BOOT_WRAP, jump=0.5)

    def receive(self, message: Message, now: float) -> bool:
        """Process one message of the pinned vehicle. Return True if it was a usable attitude, newer
        than all earlier attitudes."""
        self._newest = None
        if message.get_type() == "VFR_HUD":
            self._on_air_data(message, now)
            return False
        if message.get_type() == "GLOBAL_POSITION_INT":
            self._on_above_home(_real(message.relative_alt / 1000, MOST_ALTITUDE), now)
            return False
        angles = _angles(message)
        if angles is None:
            self.accelerations.receive(message, self._body, now)
            return False
        values = (*angles, message.rollspeed, message.pitchspeed, message.yawspeed)
        bounds = (MOST_ANGLE, MOST_ANGLE, MOST_ANGLE, MOST_RATE, MOST_RATE, MOST_RATE)
        if not all(
            abs(value) <= bound for value, bound in zip(values, bounds, strict=True)
        ):  # false for NaN, too
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

    def _on_above_home(self, above_home: float | None, now: float) -> None:
        """Process an altitude above home. If it changes faster than a vehicle can climb, a ground
        station has moved home: the altitude above sea level has stayed the same."""
        before = self._above_home.value
        waited = max(self._above_home.age(now), BUNCHED)
        self._above_home.update(above_home, now)
        if above_home is None or before is None or self._above_home_then is None:
            return
        if abs(above_home - before) > MOST_CLIMB * waited:
            self._above_home_then += above_home - before

    def _on_air_data(self, message: Message, now: float) -> None:
        """Process a VFR_HUD."""
        climb = _real(message.climb, MOST_AIRSPEED)
        altitude = _real(message.alt, MOST_ALTITUDE)
        airspeed = _real(message.airspeed, MOST_AIRSPEED, above=0.0)
        self._airspeed.update(airspeed, now, must_change=climb != self._climb.value)
        self._climb.update(climb, now)
        # Without a position ArduPilot repeats the altitude of its last position. The climb rate and
        # the altitude above home come from the barometer and go on.
        moved = 0.0
        above_home = self._above_home.live(now, AIR_MAX_AGE)
        if above_home is not None and self._above_home_then is not None:
            moved = above_home - self._above_home_then
        must_change = max(abs(climb or 0.0), abs(moved)) > MOVES
        # Without any position since its start, ArduPilot sends 0: the altitude is unknown.
        if not altitude:
            return
        if altitude != self._altitude.value or self._above_home_then is None:
            self._above_home_then = above_home
        self._altitude.update(altitude, now, must_change=must_change)

    def _altitude_at(self, now: float) -> float | None:
        """Return the altitude above sea level, m, or None without a report that is updated."""
        altitude = self._altitude.live(now, AIR_MAX_AGE)
        above_home = self._above_home.live(now, AIR_MAX_AGE)
        if altitude is not None and above_home is not None and self._above_home_then is not None:
            return altitude + above_home - self._above_home_then
        return self._altitude.live(now, AIR_MAX_AGE, FROZEN_ALTITUDE)

    def seldom(self, now: float) -> bool:
        """True if attitudes are missing, or too few to follow the vehicle's turns. While the
        vehicle is steered, it is then True until they have been frequent for 10 s."""
        rare = now - self._received[0] > FEWEST_WITHIN
        # Before the autopilot has answered the stream requests, attitudes are rare. This is over at
        # the engagement.
        if isinf(self._received[0]) or not self.keeps_heading:
            self._rare.clear()
            return rare
        return self._rare.update(rare, now)

    def _watch_yaw(self, body: Attitude, now: float) -> None:
        """Detect a yaw reset. An autopilot's EKF resets its yaw in flight, by up to 180 deg, when
        compass and GPS disagree. The vehicle itself has not turned."""
        before = self._body
        step = now - self._received[-1]
        if before is not None and body.time > before.time:
            step = body.time - before.time
        # 0.5: longest time, s, over which a yaw is predicted for this comparison.
        if before is None or not self.keeps_heading or step > 0.5:
            return
        carried = before.yaw + (before.yaw_rate + body.yaw_rate) / 2 * step
        jump = remainder(body.yaw - self.jumped - carried, tau)
        # 0.35: difference between the reported and the predicted yaw, rad, above which the
        # autopilot has reset its yaw. Real turns stay far below: a yaw rate that changes by 90
        # deg/s within 0.1 s gives 0.08 rad.
        if abs(jump) > 0.35:
            self.jumped = remainder(self.jumped + jump, tau)

    def _measured(self, stamp_ms: int, now: float) -> float | None:
        """Return the local time at which an attitude was measured, s, or None if it is not newer
        than the newest attitude."""
        clock = self._clock
        stamp = clock.unwrapped(stamp_ms / 1000)
        order = clock.order(stamp, now)
        # A stopped clock repeats its stamp. After REPEATED, use the arrival time instead.
        if order is Order.REPEATED:
            return now if now - clock.newest_at > REPEATED else None
        if order in (Order.OLDER, Order.JUMPED):
            return None
        measured = clock.local(stamp, now)
        # 0.4: longest plausible link delay of an attitude, s. A longer delay indicates a reset of
        # the vehicle's clock: restart the filter. The limit is below ATTITUDE_MAX_AGE, so that the
        # heading stays available after the reset.
        if now - measured > 0.4:
            clock.reset()
            measured = clock.local(stamp, now)
        clock.take(stamp, now)
        return measured

    def own(self, now: float, airspeed: float, *, banks: bool = False) -> OwnMotion | None:
        """Return the motion in guidance's frame, or None without an attitude.

        airspeed: true airspeed, m/s, measured or commanded. banks: True for a vehicle that banks to
        turn.
        """
        body = self._attitude(now)
        if body is None:
            return None
        psi = heading_enu_from_yaw_ned(body.yaw)
        turn_rate = turn_rate_from_yaw_rate(body.yaw_rate)
        own = OwnMotion(
            self._attitude_at,
            psi,
            turn_rate,
            airspeed,
            acceleration=self.accelerations.acceleration,
        )
        if banks:
            roll, _ = _tilt(body)
            turn = turn_rate_from_yaw_rate(YawRate(GRAVITY * tan(roll) / max(airspeed, 1.0)))
            return own._replace(bank_turn=turn)
        return own

    def forces(self, now: float) -> tuple[complex, complex | None]:
        """Return the horizontal acceleration by the tilt of a copter's thrust, and the specific
        force by its drag, or None if it is not measured: forward + j left, m/s^2."""
        body = self._attitude(now)
        roll, pitch = (0.0, 0.0) if body is None else _tilt(body)
        force = self.accelerations.across_thrust(now)
        drag = None if force is None else drag_from_body(force, roll, pitch)
        return thrust_acceleration_from_tilt(roll, pitch), drag

    def at(self, now: float) -> Motion:
        """Return the motion at this time, stale values as None."""
        # In each step this method is called eight times with the same `now`: compute the motion
        # once.
        if self._newest is None or self._newest[0] != now:
            turned = Motion() if self._attitude(now) is None else self._turned
            motion = turned._replace(
                airspeed=self._airspeed.live(now, AIR_MAX_AGE, FROZEN_AIRSPEED),
                altitude=self._altitude_at(now),
                climb=self._climb.live(now, AIR_MAX_AGE),
                above_home=self._above_home.live(now, AIR_MAX_AGE),
            )
            self._newest = (now, motion)
        return self._newest[1]

    def _attitude(self, now: float) -> Attitude | None:
        # Attitudes that arrive rarely, but at least every 1.3 s on average, stay valid for 1.6
        # intervals and are extrapolated by their body rates. Otherwise the heading of a vehicle
        # that refuses stream requests (1 Hz) would be lost every second.
        interval = (self._received[-1] - self._received[0]) / (FEWEST - 1)
        oldest = max(1.6 * interval, ATTITUDE_MAX_AGE) if interval < 1.3 else ATTITUDE_MAX_AGE
        return self._body if now - self._attitude_at <= oldest else None


def _tilt(body: Attitude) -> tuple[float, float]:
    """Return roll and pitch for calculations, rad."""
    return min(max(body.roll, -MOST_TILT), MOST_TILT), min(max(body.pitch, -MOST_TILT), MOST_TILT)


def _angles(message: Message) -> tuple[float, float, float] | None:
    """Return roll, pitch and yaw of either attitude message, or None for another message.

    An invalid quaternion gives NaN. If a vehicle sends both messages with the same stamp, only the
    first is used.
    """
    if message.get_type() == "ATTITUDE":
        return message.roll, message.pitch, message.yaw
    if message.get_type() != "ATTITUDE_QUATERNION":
        return None
    q = message.q1, message.q2, message.q3, message.q4
    # 0.1: largest deviation of the norm of a quaternion from 1. A quaternion with a larger
    # deviation is discarded.
    return euler_from_quaternion(q) if abs(hypot(*q) - 1) < 0.1 else (nan, nan, nan)


def _real(value: float, most: float, above: float = float("-inf")) -> float | None:
    """Return a value within the bounds, or None. PX4's copter sends a NaN airspeed, ArduPilot 0
    before take-off."""
    return value if abs(value) <= most and value > above else None


class Accelerometer:
    """Accelerations of one IMU message type, and a check that this accelerometer works.

    After a failure the autopilot flies on with its next IMU, but still reports the failed one:
    ArduPilot's RAW_IMU is always the first IMU.
    """

    def __init__(self) -> None:
        self._force: Report[tuple[float, float, float]] = Report()
        self._tilt: tuple[float, float] | None = None
        """Roll and pitch at the newest change of the accelerations, rad."""
        self._tilted = False
        """True if the tilt has changed since then, so that the accelerations must change, too."""
        # 1.0: time, s, for which an accelerometer may show less than half of gravity before it has
        # failed. A vehicle that really lost half of its lift for 1 s would sink with 5 m/s.
        self._no_gravity = Hysteresis(raise_after=1.0)
        # ArduPilot sends zeros for an IMU that does not exist.
        self._no_gravity.on = True

    def update(
        self, force: tuple[float, float, float], attitude: Attitude | None, now: float
    ) -> None:
        """Process the accelerations of a message, m/s^2."""
        self._no_gravity.update(not hypot(*force) > GRAVITY / 2, now)
        tilt = None if attitude is None else (attitude.roll, attitude.pitch)
        if force != self._force.value or self._tilt is None:
            self._tilt = tilt
            self._tilted = False
        elif tilt is not None:
            # 0.02: change of roll and pitch, rad, from which the accelerations must change. They
            # are sent in steps of 0.01 m/s^2, and an accelerometer is noisier than one step.
            self._tilted |= hypot(tilt[0] - self._tilt[0], tilt[1] - self._tilt[1]) > 0.02
        self._force.update(force, now, must_change=self._tilted)

    @property
    def failed(self) -> bool:
        """True if the accelerations are frozen, or contain no gravity."""
        return self._force.unchanged > FROZEN_ACCELERATIONS or self._no_gravity.on

    def works(self, now: float, max_age: float) -> bool:
        """True if the accelerations are received and can be used. max_age: s."""
        return self._force.age(now) <= max_age and not self.failed


class Accelerations:
    """Integral of the measured specific force, rotated to the horizontal (ArduPilot sends milli-g
    in the body frame).

    The first IMU that works is used, in the order of ACCELERATIONS. The newest attitude is
    extrapolated to the time of the measurement: an attitude error of 1 deg causes an acceleration
    error of 0.17 m/s^2. After a gap or an implausible value the integral restarts. `acceleration`
    contains the start time of the integral.
    """

    def __init__(self) -> None:
        self._imus: dict[str, Accelerometer] = {}
        """IMUs by message type."""
        self.used = ""
        """Message type of the IMU in use, empty while no IMU works."""
        self._time = float("-inf")
        """Time of the newest acceleration in use, s, the vehicle's clock."""
        self.acceleration: IntegratedAcceleration | None = None
        # 0.1: time constant of the low-pass on the specific force, s, which averages vibration
        # between two attitudes.
        self._forward = LowPass(0.1)
        self._right = LowPass(0.1)

    @property
    def failed(self) -> str:
        """Message type of the vehicle's first IMU if its accelerometer has failed, else empty."""
        first = next((kind for kind in ACCELERATIONS if kind in self._imus), "")
        return first if first and self._imus[first].failed else ""

    def receive(self, message: Message, attitude: Attitude | None, now: float) -> None:
        """Process one message of the vehicle. Messages without accelerations are ignored."""
        kind = message.get_type()
        if kind not in ACCELERATIONS:
            return
        unit = ACCELERATIONS[kind]
        force = unit * message.xacc, unit * message.yacc, unit * message.zacc
        self._imus.setdefault(kind, Accelerometer()).update(force, attitude, now)
        used = self._first_that_works(now)
        if used != self.used:
            self.used = used
            self._restart()
        if kind == used:
            self._integrate(message, force, attitude, now)

    def _first_that_works(self, now: float) -> str:
        for kind in ACCELERATIONS:
            # 2.0: silence, s, after which another IMU is used.
            if kind in self._imus and self._imus[kind].works(now, 2.0):
                return kind
        return ""

    def _integrate(
        self,
        message: Message,
        force: tuple[float, float, float],
        attitude: Attitude | None,
        now: float,
    ) -> None:
        """Update the integral and `across_thrust`. force: specific force, m/s^2."""
        scaled = message.get_type().startswith("SCALED")
        time = message.time_boot_ms / 1e3 if scaled else message.time_usec / 1e6
        step = time - self._time
        self._time = time
        # 0.2: longest gap between two accelerations, s, that is integrated over (5 Hz). After a
        # longer gap the integral restarts.
        if not 0 <= step <= 0.2 or not all(
            abs(value) < MOST_FORCE for value in force
        ):  # true for NaN
            self._restart()
            return
        self._forward.update(force[0], step)
        self._right.update(force[1], step)
        # 0.2: largest time between an acceleration and the attitude that rotates it to the
        # horizontal, s.
        if attitude is None or abs(time - attitude.time) > 0.2:
            self.acceleration = None
            return
        roll, pitch, yaw = attitude.at(time)
        ax, ay = vector_from_level(
            *level_from_body(force, roll, pitch), heading_enu_from_yaw_ned(yaw)
        )
        was = self.acceleration or IntegratedAcceleration(0.0, 0.0, now)
        self.acceleration = IntegratedAcceleration(was.x + ax * step, was.y + ay * step, was.since)

    def across_thrust(self, now: float) -> tuple[float, float] | None:
        """Return the low-passed specific force along the body's forward and right axes, m/s^2.
        Return None without a recent measurement."""
        imu = self._imus.get(self.used)
        forward = self._forward.value
        right = self._right.value
        if imu is None or not imu.works(now, ATTITUDE_MAX_AGE) or forward is None or right is None:
            return None
        return forward, right

    def _restart(self) -> None:
        """Restart the integral and the low-pass."""
        self.acceleration = None
        self._forward.clear()
        self._right.clear()
