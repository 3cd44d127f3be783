"""Model of a multicopter's velocity under its autopilot's velocity loop, with drag.

    v' = a - c v,   a + TILT a' = P (u - v) + q + f - D v',   q' = I (u - v)
    u = V (cos psi, sin psi)

v: velocity. a: acceleration by the tilt. u: commanded velocity. q: integrator. f: acceleration
feedforward. c: drag.

Without f a turning copter flies slower than commanded, and crabs. With PX4's gains and a drag of
1/s, at 5 m/s and 0.1 rad/s, it is slower by 9 % and crabs by 11 deg. Its course follows the nose 2
s late. With f = (1 + D) u' + c u the velocity follows u as fast as the tilt. The drag c is learned
from the tilt: the horizontal thrust minus the acceleration is the drag force.
Source: PX4 PositionControl (MPC_XY_VEL_P_ACC, _I_ACC, _D_ACC); compared with PX4's own flights in
simulation.
"""

from cmath import phase, rect
from dataclasses import dataclass
from math import pi, remainder

from circnav_mav.guidance.recursive_least_squares import RecursiveLeastSquares
from circnav_mav.guidance.types import LONGEST_REPORT_GAP, OwnMotion

MEMORY = 60.0
"""Time constant of the drag's least squares, s: more than a lap, to separate wind from drag."""
FIRST_DRAG = 0.3
"""Prior of the drag, 1/s: that of a bare quadrotor."""
PRIOR = 10.0
"""Weight of the prior FIRST_DRAG in the least squares of the drag, m^2/s."""
MOST_FED = 5.0
"""Upper bound of the acceleration feedforward against drag, m/s^2. It requires a tilt of 27 deg."""
TILT = 0.25
"""Time constant of the tilt, s, as flown."""
SLOW = 0.3
"""Modeled speed, as a share of the commanded speed, below which the direction of the velocity is
not used."""


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


class CopterMotion:
    """Estimated motion of a copter, east and north as a complex number.

    drag: drag coefficient, learned from the tilt, 1/s.
    """

    def __init__(self) -> None:
        self.drag = FIRST_DRAG
        self._fit = RecursiveLeastSquares(MEMORY)
        self.stop()

    def stop(self) -> None:
        """Start again at rest with the learned drag. Call while circnav does not control the
        copter. At a handover the copter hovers, and its acceleration then shows the drag."""
        self._time: float | None = None
        self._v = 0j
        """Velocity, m/s."""
        self._a = 0j
        """Acceleration by the tilt, m/s^2."""
        self._q = 0j
        """Integrator of the loop, m/s^2."""

    def follow(self, own: OwnMotion, loop: VelocityLoop) -> OwnMotion:
        """Update with a report. Return the actual motion: course, course rate and speed instead of
        heading, turn rate and commanded speed."""
        before = self._v
        step = 0.0 if self._time is None else own.time - self._time
        if self._time is None:
            self._time = own.time
        if step <= 0:
            return self._as_motion(own, 0.0)
        self._time = own.time
        wanted = rect(own.airspeed, own.heading)
        if step > LONGEST_REPORT_GAP:
            self._v = wanted
            self._a = self.drag * wanted
            self._q = 0j
            return self._as_motion(own, own.turn_rate)
        fed = complex(*loop.fed(own.airspeed, own.turn_rate, self.drag)) * rect(1.0, own.heading)
        # Step of the integration, s: a tenth of the loop's quickest time constant.
        pieces = int(step / 0.02) + 1
        for _ in range(pieces):
            self._integrate(wanted, fed, loop, step / pieces)
        self._learn(own, (self._v - before) / step, step)
        turned = remainder(phase(self._v) - phase(before), 2 * pi)
        return self._as_motion(own, turned / step)

    def _integrate(self, wanted: complex, fed: complex, loop: VelocityLoop, h: float) -> None:
        """Advance the equations of the module by h (s)."""
        error = wanted - self._v
        rate = self._a - self.drag * self._v
        push = loop.proportional * error + self._q + fed - loop.derivative * rate
        self._a += (push - self._a) * h / TILT
        self._v += rate * h
        self._q += loop.integral * error * h

    def _learn(self, own: OwnMotion, acceleration: complex, step: float) -> None:
        """Learn the drag: push minus acceleration is linear in the velocity. The wind changes only
        the intercept of this line."""
        if own.push is None:
            return
        fit = self._fit
        fit.add(self._v, complex(*own.push) - acceleration, step, step)
        drag = (fit.product().real + PRIOR * FIRST_DRAG) / (fit.spread() + PRIOR)
        # Upper bound of the learned drag, 1/s: seven times that of a bare quadrotor, by choice.
        self.drag = min(max(drag, 0.0), 2.0)

    def _as_motion(self, own: OwnMotion, course_rate: float) -> OwnMotion:
        speed = abs(self._v)
        if speed < SLOW * own.airspeed:
            return own
        return own._replace(heading=phase(self._v), turn_rate=course_rate, airspeed=speed)
