"""How a multicopter's velocity follows its nose, where its autopilot holds it by a velocity loop against drag.

    v' = a - c v,   a + TILT a' = P (u - v) + q + f - D v',   q' = I (u - v),   u = V (cos psi, sin psi)

Without the fed acceleration f a turning copter flies slower than it is told and crabs: with PX4's gains and a drag of
1/s at 5 m/s and .1 rad/s by 9 % and 11 deg, and changes of its course follow the nose two seconds late. With
f = (1 + D) u' + c u the velocity follows u as the tilt does. The drag c is learnt from the tilt: the thrust's
horizontal part less the acceleration is what the air takes.
Source: PX4 PositionControl (MPC_XY_VEL_P_ACC, _I_ACC, _D_ACC); compared with PX4's own flights in simulation.
"""

from dataclasses import dataclass, replace
from math import atan2, cos, exp, hypot, pi, remainder, sin

from circnav_mav.guidance.types import OwnMotion

LONGEST_STEP = 0.5
"""Gap between two reports, s, after which the velocity begins anew along the nose."""
STEP = 0.02
"""Step of the integration, s: a tenth of the loop's quickest time constant."""
MEMORY = 60.0
"""Time constant of the drag's least squares, s: more than a lap tells wind from drag."""
FIRST_DRAG, PRIOR = 0.3, 10.0
"""Drag before the flight tells, 1/s (a bare quadrotor), and its weight, m^2/s."""
MOST_DRAG = 2.0
MOST_FED = 5.0
"""Acceleration along the nose, m/s^2, that is fed against drag at most: 27 deg of tilt."""
TILT = 0.25
"""Time constant, s, in which the thrust leans as the loop asks, as flown."""
SLOW = 0.3
"""Share of the speed below which a velocity has no direction."""


@dataclass(frozen=True, slots=True)
class VelocityLoop:
    """Gains of the autopilot's velocity loop: P in 1/s, I in 1/s^2, D (of the acceleration) without unit."""

    proportional: float
    integral: float
    derivative: float

    def fed(self, speed: float, turn_rate: float, drag: float) -> tuple[float, float]:
        """The acceleration, m/s^2, along the nose and to the side of the turn that the velocity needs to stay along the
        nose at a speed (m/s), turn rate (rad/s) and drag (1/s)."""
        return min(drag * speed, MOST_FED), (1 + self.derivative) * speed * turn_rate


@dataclass(frozen=True, slots=True)
class CopterMotion:
    """What is known of the motion after a report. vx, vy: velocity, m/s; ax, ay: what the leaning thrust pushes, m/s^2;
    qx, qy: the loop's integrator, m/s^2; drag: 1/s. sums: of the drag's least squares (time, v, a, v v, v a)."""

    time: float | None = None
    vx: float = 0.0
    vy: float = 0.0
    ax: float = 0.0
    ay: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    drag: float = FIRST_DRAG
    sums: tuple[float, float, float, float, float, float, float] = (0.0,) * 7

    def follow(self, own: OwnMotion, loop: VelocityLoop) -> tuple["CopterMotion", OwnMotion]:
        """Take in a report; answers with the motion that the vehicle really has: course, course rate and speed in the
        place of heading, turn rate and the speed that it is told."""
        if self.time is None:  # from rest: a copter is handed over hovering, and how it gets to speed tells its drag
            return replace(self, time=own.time), self._as_motion(own, 0.0)
        step = own.time - self.time
        if step <= 0:
            return self, self._as_motion(own, 0.0)
        ux, uy = own.airspeed * cos(own.heading), own.airspeed * sin(own.heading)
        if step > LONGEST_STEP:
            fresh = replace(self, time=own.time, vx=ux, vy=uy, ax=self.drag * ux, ay=self.drag * uy, qx=0.0, qy=0.0)
            return fresh, fresh._as_motion(own, own.turn_rate)
        along, left = loop.fed(own.airspeed, own.turn_rate, self.drag)
        nose_x, nose_y = cos(own.heading), sin(own.heading)
        fx, fy = along * nose_x - left * nose_y, along * nose_y + left * nose_x
        vx, vy, ax, ay, qx, qy = self.vx, self.vy, self.ax, self.ay, self.qx, self.qy
        pieces = int(step / STEP) + 1
        h = step / pieces
        for _ in range(pieces):
            ex, ey = ux - vx, uy - vy
            rate_x, rate_y = ax - self.drag * vx, ay - self.drag * vy
            ax += (loop.proportional * ex + qx + fx - loop.derivative * rate_x - ax) * h / TILT
            ay += (loop.proportional * ey + qy + fy - loop.derivative * rate_y - ay) * h / TILT
            vx += rate_x * h
            vy += rate_y * h
            qx += loop.integral * ex * h
            qy += loop.integral * ey * h
        moved = replace(self, time=own.time, vx=vx, vy=vy, ax=ax, ay=ay, qx=qx, qy=qy)
        learnt = moved._learn(own, (vx - self.vx) / step, (vy - self.vy) / step, step)
        turned = remainder(atan2(vy, vx) - atan2(self.vy, self.vx), 2 * pi)
        return learnt, learnt._as_motion(own, turned / step)

    def stand(self) -> "CopterMotion":
        """Not ours to fly: only what was learnt stays."""
        return CopterMotion(drag=self.drag, sums=self.sums)

    def _learn(self, own: OwnMotion, ax: float, ay: float, step: float) -> "CopterMotion":
        """Least squares of what the tilt pushes beyond the acceleration on the velocity, with the wind as intercept."""
        if own.push is None:
            return self
        px, py, keep = own.push[0] - ax, own.push[1] - ay, exp(-step / MEMORY)
        now = (1.0, self.vx, self.vy, px, py, self.vx**2 + self.vy**2, self.vx * px + self.vy * py)
        n, sx, sy, bx, by, vv, va = (old * keep + new * step for old, new in zip(self.sums, now, strict=True))
        spread, product = vv - (sx * sx + sy * sy) / n, va - (sx * bx + sy * by) / n
        drag = (product + PRIOR * FIRST_DRAG) / (spread + PRIOR)
        return replace(self, drag=min(max(drag, 0.0), MOST_DRAG), sums=(n, sx, sy, bx, by, vv, va))

    def _as_motion(self, own: OwnMotion, course_rate: float) -> OwnMotion:
        speed = hypot(self.vx, self.vy)
        if speed < SLOW * own.airspeed:
            return own
        return replace(own, heading=atan2(self.vy, self.vx), turn_rate=course_rate, airspeed=speed)
