"""Model of a multicopter's velocity under its autopilot's velocity loop, with drag.

    v' = a - c v,   a + TILT a' = P (u - v) + q + f - D v',   q' = I (u - v)
    u = V (cos psi, sin psi)

v: velocity. a: acceleration by the tilt. u: commanded velocity. q: integrator. f: acceleration
feedforward. c: drag.

Without f a turning copter flies slower than commanded and crabs: by 9 % and 11 deg with PX4's gains
and a drag of 1/s at 5 m/s and 0.1 rad/s. Its course follows the nose 2 s late. With f = (1 + D) u'
+ c u the velocity follows u as fast as the tilt. The drag c is learned from the tilt: the
horizontal thrust minus the acceleration is the drag force.
Source: PX4 PositionControl (MPC_XY_VEL_P_ACC, _I_ACC, _D_ACC); compared with PX4's own flights in
simulation.
"""

from cmath import phase, rect
from dataclasses import dataclass
from math import exp, hypot, pi, remainder
from typing import NamedTuple

from circnav_mav.guidance.types import LONGEST_REPORT_GAP, OwnMotion

STEP = 0.02
"""Step of the integration, s: a tenth of the loop's quickest time constant."""
MEMORY = 60.0
"""Time constant of the drag's least squares, s: more than a lap, to separate wind from drag."""
FIRST_DRAG = 0.3
PRIOR = 10.0
"""Prior of the drag, 1/s (a bare quadrotor), and its weight, m^2/s."""
MOST_DRAG = 2.0
"""Bound of the learned drag, 1/s: seven times a bare quadrotor's; chosen."""
MOST_FED = 5.0
"""Bound of the feedforward against drag, m/s^2: 27 deg of tilt."""
TILT = 0.25
"""Time constant of the tilt, s, as flown."""
SLOW = 0.3
"""Share of the airspeed below which the direction of the velocity is not used."""


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

        speed: m/s. turn_rate: rad/s. drag: 1/s.
        """
        return min(drag * speed, MOST_FED), (1 + self.derivative) * speed * turn_rate


class CopterMotion(NamedTuple):
    """Estimated motion after a report, east and north as a complex number. v: velocity, m/s. a:
    acceleration by the tilt, m/s^2. q: the loop's integrator, m/s^2. drag: 1/s. sums: of the drag's
    least squares, of 1, v, p, v v and v p over time, p being push minus acceleration."""

    time: float | None = None
    v: complex = 0j
    a: complex = 0j
    q: complex = 0j
    drag: float = FIRST_DRAG
    sums: tuple[complex, ...] = (0.0,) * 5

    def follow(self, own: OwnMotion, loop: VelocityLoop) -> tuple["CopterMotion", OwnMotion]:
        """Return the state after a report, and the actual motion: course, course rate and speed
        instead of heading, turn rate and commanded speed."""
        if (
            self.time is None
        ):  # start at rest: a copter is handed over hovering, and how it accelerates shows the drag
            return self._replace(time=own.time), self._as_motion(own, 0.0)
        step = own.time - self.time
        if step <= 0:
            return self, self._as_motion(own, 0.0)
        u = rect(own.airspeed, own.heading)
        if step > LONGEST_REPORT_GAP:
            fresh = self._replace(time=own.time, v=u, a=self.drag * u, q=0j)
            return fresh, fresh._as_motion(own, own.turn_rate)
        f = complex(*loop.fed(own.airspeed, own.turn_rate, self.drag)) * rect(1.0, own.heading)
        v = self.v
        a = self.a
        q = self.q
        pieces = int(step / STEP) + 1
        h = step / pieces
        for _ in range(pieces):
            e = u - v
            rate = a - self.drag * v
            a += (loop.proportional * e + q + f - loop.derivative * rate - a) * h / TILT
            v += rate * h
            q += loop.integral * e * h
        moved = self._replace(time=own.time, v=v, a=a, q=q)
        learnt = moved._learn(own, (v - self.v) / step, step)
        return learnt, learnt._as_motion(own, remainder(phase(v) - phase(self.v), 2 * pi) / step)

    def stand(self) -> "CopterMotion":
        """Return the state at rest with the learned drag, for a copter that is not controlled from
        here."""
        return CopterMotion(drag=self.drag, sums=self.sums)

    def _learn(self, own: OwnMotion, acceleration: complex, step: float) -> "CopterMotion":
        """Fit push minus acceleration to the velocity by least squares. The intercept is the
        wind."""
        if own.push is None:
            return self
        push = complex(*own.push) - acceleration
        keep = exp(-step / MEMORY)
        now = (1.0, self.v, push, self.v.real**2 + self.v.imag**2, _dot(self.v, push))
        n, v, a, vv, va = (old * keep + new * step for old, new in zip(self.sums, now, strict=True))
        spread = (vv - _dot(v, v) / n).real
        product = (va - _dot(v, a) / n).real
        drag = (product + PRIOR * FIRST_DRAG) / (spread + PRIOR)
        return self._replace(drag=min(max(drag, 0.0), MOST_DRAG), sums=(n, v, a, vv, va))

    def _as_motion(self, own: OwnMotion, course_rate: float) -> OwnMotion:
        speed = hypot(self.v.real, self.v.imag)
        if speed < SLOW * own.airspeed:
            return own
        return own._replace(heading=phase(self.v), turn_rate=course_rate, airspeed=speed)


def _dot(a: complex, b: complex) -> float:
    """Return the scalar product of two vectors."""
    return a.real * b.real + a.imag * b.imag
