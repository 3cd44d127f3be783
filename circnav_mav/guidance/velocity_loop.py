"""Model of a multicopter's velocity under its autopilot's velocity loop, with drag.

    v' = a - c v,   a + TILT a' = P (u - v) + q + f - D v',   q' = I (u - v)
    u = V (cos psi, sin psi)

v: velocity. a: acceleration by the tilt. u: commanded velocity. q: integrator. f: acceleration
feedforward. c: drag.

Without f a turning copter flies slower than commanded, and crabs. With PX4's gains and a drag of
1/s, at 5 m/s and 0.1 rad/s, it is slower by 9 % and crabs by 11 deg. Its course follows the nose 2
s late. With f = (1 + D) u' + c u the velocity follows u as fast as the tilt.
Source: PX4 PositionControl (MPC_XY_VEL_P_ACC, _I_ACC, _D_ACC); compared with PX4's own flights in
simulation.
"""

from cmath import phase, rect
from dataclasses import dataclass
from math import pi, remainder
from typing import NamedTuple

from circnav_mav.guidance.types import GRAVITY, LONGEST_REPORT_GAP, OwnMotion

MOST_FED = 0.5 * GRAVITY
"""Upper bound of the acceleration feedforward against drag, m/s^2. It requires a tilt of 27 deg."""
TILT = 0.25
"""Time constant of the tilt, s, as flown."""


class LoopMotion(NamedTuple):
    """Modeled motion, east + j north.

    velocity: v, m/s.
    tilt: a, acceleration by the tilt, m/s^2.
    integrator: q, m/s^2.
    """

    velocity: complex
    tilt: complex
    integrator: complex


AT_REST = LoopMotion(0j, 0j, 0j)


@dataclass(frozen=True, slots=True)
class VelocityLoop:
    """Gains of the autopilot's velocity loop: P in 1/s, I in 1/s^2, D (of the acceleration) without
    unit."""

    proportional: float
    integral: float
    derivative: float

    def fed(self, speed: float, turn_rate: float, drag: float) -> tuple[float, float]:
        """Return the acceleration feedforward (m/s^2), forward and to the left, that keeps the
        velocity along the nose.

        speed: commanded speed, m/s.
        turn_rate: turn rate of the nose, rad/s.
        drag: drag coefficient, 1/s.
        """
        return min(drag * speed, MOST_FED), (1 + self.derivative) * speed * turn_rate

    def update(
        self, motion: LoopMotion, own: OwnMotion, drag: float, step: float
    ) -> tuple[OwnMotion, LoopMotion]:
        """Return the actual motion after a report (course, course rate and speed instead of
        heading, turn rate and commanded speed), and the modeled motion.

        motion: modeled motion at the report before.
        drag: c, 1/s.
        step: time since the report before, s. After a gap the copter flies along its nose.
        """
        wanted = rect(own.airspeed, own.heading)
        before = motion.velocity
        course_rate = own.turn_rate
        if step > LONGEST_REPORT_GAP:
            motion = LoopMotion(wanted, drag * wanted, 0j)
        elif step > 0:
            fed = complex(*self.fed(own.airspeed, own.turn_rate, drag)) * rect(1.0, own.heading)
            # Step of the integration, s: a tenth of the loop's quickest time constant.
            pieces = int(step / 0.02) + 1
            for _ in range(pieces):
                motion = self._moved(motion, wanted, fed, drag, step / pieces)
            course_rate = remainder(phase(motion.velocity) - phase(before), 2 * pi) / step
        speed = abs(motion.velocity)
        # 0.3: modeled speed, as a share of the commanded speed, below which the direction of the
        # velocity is not used.
        if speed < 0.3 * own.airspeed:
            return own, motion
        course = phase(motion.velocity)
        return own._replace(heading=course, turn_rate=course_rate, airspeed=speed), motion

    def _moved(
        self, motion: LoopMotion, wanted: complex, fed: complex, drag: float, h: float
    ) -> LoopMotion:
        """Return the motion h (s) later, by the equations of the module."""
        v, a, q = motion
        error = wanted - v
        rate = a - drag * v
        thrust_acceleration = self.proportional * error + q + fed - self.derivative * rate
        return LoopMotion(
            v + rate * h, a + (thrust_acceleration - a) * h / TILT, q + self.integral * error * h
        )
