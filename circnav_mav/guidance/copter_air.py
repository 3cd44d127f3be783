"""Air of a multicopter: its drag, the wind, its velocity through the air, and the horizontal
acceleration by the thrust that holds its airspeed.

    a - v' = drag (v - wind),    drag along the nose = c V (1 + V/v_2)

a: thrust acceleration. v: velocity over the ground. V: speed through the air. c: drag coefficient.
v_2: speed at which the quadratic drag of the airframe equals the linear drag of the rotors. All
vectors are complex: east + j north, or forward + j left.

While the autopilot holds the speed over the ground, v is known and the tilt shows the thrust
acceleration. One least squares of this line gives drag and wind. Without GPS, the accelerometer
measures the drag, because the thrust of a multicopter has no component along its forward and left
axes. So the drag gives airspeed and side-slip, in straight flight and in turns, independent of the
attitude.

Source: Martin and Salaun, "The true role of accelerometer feedback in quadrotor control" (2010).
v_2 was measured on ArduCopter's simulated quadrotor, straight and in turns.
"""

from cmath import rect
from math import atan2, exp, hypot, sqrt

from circnav_mav.guidance.limits import LeanLimit
from circnav_mav.guidance.maths import clip
from circnav_mav.guidance.recursive_least_squares import RecursiveLeastSquares
from circnav_mav.guidance.types import LONGEST_REPORT_GAP, OwnMotion
from circnav_mav.guidance.velocity_loop import AT_REST, VelocityLoop
from circnav_mav.timers import LowPass

EQUAL_DRAG_SPEED = 8.0
"""v_2, m/s: speed at which the quadratic drag equals the linear drag."""
MAX_TRIM = 1.5
"""Bound of each integral (forward and left) of the thrust acceleration, m/s^2. It corrects an
attitude estimate that is wrong by 9 deg."""
SCALE_BOUNDS = (0.5, 2.0)
"""Bounds of the estimated airspeed scale (true over measured airspeed) of a copter without GPS. The
drag coefficients of copters are between 0.2/s and 1/s."""
DRAG_BOUNDS = (0.05, 2.0)
"""Lower and upper bound of the drag per airspeed, learned or of the mission, 1/s."""
SCALE_SIGMA = 0.25
"""Standard deviation of the airspeed scale before the drag is learned."""
PRIOR = 10.0
"""Weight of the drag of the mission in the least squares, m^2/s. A circle at 2 m/s adds the same
weight in 2.5 s."""


def drag_force(speed: float, coefficient: float) -> float:
    """Return the drag per mass, m/s^2, at a speed along one axis, m/s. Both have the same sign.

    coefficient: c, 1/s.
    """
    return coefficient * speed * (1 + abs(speed) / EQUAL_DRAG_SPEED)


def speed_of_drag(force: float, coefficient: float) -> float:
    """Return the speed along one axis, m/s, at a drag per mass, m/s^2: the inverse of
    `drag_force`."""
    root = sqrt(1 + 4 * abs(force) / (coefficient * EQUAL_DRAG_SPEED))
    speed = EQUAL_DRAG_SPEED / 2 * (root - 1)
    return speed if force >= 0 else -speed


def coefficient_at(ratio: float, speed: float) -> float:
    """Return the drag coefficient c, 1/s. ratio: drag per mass over airspeed, 1/s, as measured at
    the airspeed `speed`, m/s."""
    return ratio / (1 + speed / EQUAL_DRAG_SPEED)


class CopterAir:
    """Drag, wind, air velocity and limit of the lean of one copter.

    lean: limit of the lean while the autopilot holds the speed over the ground.
    scale: airspeed scale in use without GPS. It follows the estimated scale slowly.
    """

    def __init__(self, coefficient: float, speed: float, loop: VelocityLoop | None = None) -> None:
        """coefficient: c of the mission, 1/s.
        speed: V of the mission, m/s.
        loop: velocity loop of the autopilot; None if the copter flies along its nose.
        """
        self.lean = LeanLimit()
        self.scale = 1.0
        self._loop = loop
        self._motion = AT_REST
        self._speed = speed
        self._drag_of_mission = drag_force(speed, coefficient) / speed
        # 60.0: time constant of the least squares, s: more than a lap, to separate wind from drag.
        self._fit = RecursiveLeastSquares(60.0)
        # The first pair, at rest in calm air, keeps the fit defined. It is soon forgotten.
        self._fit.add(0j, 0j, 0.0, 1e-3)
        self._time = float("-inf")
        # 20.0: time constant of the mean error of the accelerometer, s: about half a lap.
        self._errors = RecursiveLeastSquares(20.0)
        """Mean error of the measured force, forward + j left, m/s^2."""
        # 0.5: time constant of the low-pass on the speed along the nose, s. A shorter one would
        # pass gusts and vibration.
        # 1.0: time constant of the low-pass on the speed to the left, s. The low-pass is slower,
        # because this speed changes the heading of the path, and so the turn command.
        self._speeds = (LowPass(0.5), LowPass(1.0))
        """Measured speed through the air, forward and left, m/s, at an airspeed scale of 1."""
        self._trim = 0j
        """Integrals of the thrust acceleration, m/s^2."""

    # --- learned while the autopilot holds the speed over the ground

    @property
    def _known(self) -> float:
        """Share of the measurements in the drag, 0 to 1. The rest is the drag of the mission."""
        spread: float = self._fit.spread()
        return spread / (spread + PRIOR)

    @property
    def drag(self) -> complex:
        """Drag per mass over airspeed, 1/s. Its imaginary part is a thrust acceleration that turns
        with the nose (a trimmed attitude)."""
        fit = self._fit
        drag = (fit.product() + PRIOR * self._drag_of_mission) / (fit.spread() + PRIOR)
        return complex(clip(drag.real, *DRAG_BOUNDS), drag.imag)

    @property
    def coefficient(self) -> float:
        """c, 1/s."""
        return coefficient_at(self.drag.real, self._speed)

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the airspeed scale."""
        return max(SCALE_SIGMA * (1 - self._known), 0.03)

    @property
    def wind(self) -> complex:
        """Wind, m/s, east + j north."""
        fit = self._fit
        return complex(fit.x / fit.n - fit.y / fit.n / self.drag)

    @property
    def wind_sigma(self) -> float:
        """Standard deviation of each component of the wind, m/s."""
        # 3: the wind is the difference of the velocities over the ground and through the air. Its
        # error is that of the airspeed, and the gusts.
        return 3 * self._speed * self.scale_sigma

    def over_ground(
        self,
        own: OwnMotion,
        thrust_acceleration: complex,
        force: complex | None,
        *,
        steering: bool,
        settled: bool,
    ) -> OwnMotion:
        """Learn from a report, while the autopilot holds the commanded speed over the ground.
        Return the motion over the ground.

        own: heading of the nose and commanded speed.
        thrust_acceleration: horizontal acceleration by the tilt, forward + j left, m/s^2.
        force: specific force by the drag, forward + j left, m/s^2, or None.
        settled: True if the copter has followed its commands for long enough to have this speed.
        """
        step = own.time - self._time
        self._time = own.time
        thrust = thrust_acceleration * rect(1.0, own.heading)
        if not steering:
            # At a handover the copter hovers, and its acceleration then shows the drag.
            self._motion = AT_REST
            self._compare(thrust_acceleration, force, step)
            return own
        before = self._motion.velocity
        if self._loop is None:
            # ArduCopter flies along its nose. Its measured accelerations contain the lag of the
            # velocity behind the nose. Guidance would compensate this lag as drift, which made the
            # emulated copter oscillate until its gains were lowered.
            flown = own._replace(acceleration=None)
            v = rect(own.airspeed, own.heading)
            acceleration = 1j * own.turn_rate * v
        else:
            flown, self._motion = self._loop.update(self._motion, own, self.drag.real, step)
            v = self._motion.velocity
            acceleration = (v - before) / step if step > 0 else 0j
        if not 0 < step <= LONGEST_REPORT_GAP:
            return flown
        if settled:
            self.lean.update(
                own.time, step, abs(thrust_acceleration), self._required(v, acceleration)
            )
        # A limited acceleration does not show drag and wind.
        limited = settled and self.lean.short
        if not limited and (settled or self._loop is not None):
            self._fit.add(v, thrust - acceleration, step, step)
            self._compare((thrust - acceleration) * rect(1.0, -own.heading), force, step)
        return flown

    def _compare(self, drag: complex, force: complex | None, step: float) -> None:
        """Learn the error of the accelerometer from the drag by the attitude, forward + j left,
        m/s^2. While circnav does not steer, the thrust balances the drag on average."""
        if force is not None and 0 < step <= LONGEST_REPORT_GAP:
            self._errors.add(0j, force + drag, step, step)

    @property
    def error(self) -> complex:
        """Error of the accelerometer, forward + j left, m/s^2."""
        # 1.0: weight of the prior, an error of 0, s. The accelerations are noisy.
        return complex(self._errors.y / (self._errors.n + 1.0))

    def _required(self, v: complex, acceleration: complex) -> float | None:
        """Return the thrust acceleration that a velocity over the ground requires, m/s^2, or None
        while drag and wind cannot be separated."""
        fit = self._fit
        # 0.7: share of the spread of v in its square. On a straight path it is 0, after a turn of
        # 240 deg 0.8.
        if fit.spread() <= 0.7 * fit.xx:
            return None
        return float(abs(fit.y / fit.n + self.drag * (v - fit.x / fit.n) + acceleration))

    def feed(self, speed: float, turn_rate: float) -> tuple[float, float]:
        """Return the acceleration feedforward of the velocity loop, forward and to the left,
        m/s^2."""
        assert self._loop is not None
        return self._loop.fed(speed, turn_rate, self.drag.real)

    # --- without GPS

    def lose_ground_speed(self) -> None:
        """Hold the airspeed from now on. Before, the autopilot held the speed over the ground."""
        self.lean = LeanLimit()

    def through_air(
        self,
        own: OwnMotion,
        force: complex | None,
        *,
        steering: bool,
        scale: float | None,
    ) -> OwnMotion:
        """Measure the air velocity by a report. Return the motion along the path through the air.

        own: heading of the nose and commanded airspeed.
        force: as in `over_ground`. Without a force, `own` is returned.
        steering: True while circnav steers. The integrals of the thrust acceleration are then
            updated.
        scale: estimated airspeed scale, or None while it is not trusted.
        """
        step = own.time - self._time
        self._time = own.time
        if not steering:
            self._trim = 0j
        if force is None:
            return own
        drag = self.error - force
        step = max(step, 0.0)
        forward = self._speeds[0].update(speed_of_drag(drag.real, self.coefficient), step)
        left = self._speeds[1].update(speed_of_drag(drag.imag, self.coefficient), step)
        if steering and 0 < step <= LONGEST_REPORT_GAP:
            self._hold(own.airspeed, scale, step)
        # Side-slip angles above 45 deg occur only near standstill, where they have no meaning.
        slip = atan2(left, max(forward, abs(left), 1e-3))
        return own._replace(heading=own.heading + slip, airspeed=hypot(forward, left))

    def thrust_acceleration(self, speed: float) -> complex:
        """Return the thrust acceleration, forward + j left, m/s^2, that holds a true airspeed, m/s,
        along the nose.

        The thrust acceleration that balances the drag at this airspeed is commanded at once.
        Without GPS, the attitude estimate is wrong by some degrees in turns. An integral of the
        missing drag corrects the forward part. An integral of the side-slip corrects the part to
        the left. Without the second integral, the path through the air turned by up to 1.7 deg/s
        more or less than the nose.
        """
        if speed <= 0:
            return 0j
        wanted, _, slip = self._errors_of(speed)
        # 0.4: acceleration to the right per speed to the left, 1/s. It reduces the side-slip.
        return complex(wanted, -0.4 * slip) + self._trim

    def _hold(self, speed: float, scale: float | None, step: float) -> None:
        """Update the airspeed scale and the integrals of the thrust acceleration. speed: true
        airspeed to hold, m/s."""
        if scale is not None:
            # 10.0: time constant with which the held airspeed follows the estimated scale, s.
            self.scale += (scale - self.scale) * (1 - exp(-step / 10.0))
        _, missing, slip = self._errors_of(speed)
        # 0.15: rate of the forward integral, 1/s. The integral is slower than the response of the
        # airspeed by the drag (0.25 to 0.5/s), so that the airspeed does not oscillate. The same
        # rate, 1/s^2, applies to the integral of the speed to the left.
        trim = self._trim + 0.15 * step * complex(missing, -slip)
        self._trim = complex(
            clip(trim.real, -MAX_TRIM, MAX_TRIM), clip(trim.imag, -MAX_TRIM, MAX_TRIM)
        )

    def _errors_of(self, speed: float) -> tuple[float, float, float]:
        """Return the drag at a true airspeed (m/s), the part of it that is missing (m/s^2), and the
        speed to the left, m/s."""
        forward, left = (part.value or 0.0 for part in self._speeds)
        wanted = drag_force(speed / self.scale, self.coefficient)
        missing = wanted - drag_force(forward, self.coefficient)
        # If more than this share of the drag is missing, the copter still accelerates to the
        # airspeed. Such a difference does not show a wrong attitude, so the integrals wait.
        if abs(missing) > 0.4 * wanted:
            return wanted, 0.0, 0.0
        return wanted, missing, clip(left, -2.0, 2.0)
