"""How a multicopter's velocity follows its nose, where its autopilot holds it by a velocity loop against drag.

    v' = P (u - v) + q - c v,   q' = I (u - v),   u = V (cos psi, sin psi)

A turning copter then flies slower than it is told and crabs: with PX4's gains and a drag of 1/s at 5 m/s and .1 rad/s
by 9 % and 11 deg, which a filter that takes nose and speed for the motion mistakes for a wind that turns along. The
drag c is learnt from the tilt: the thrust's horizontal part less the acceleration is what the air takes.
Source: PX4 PositionControl (MPC_XY_VEL_P_ACC, MPC_XY_VEL_I_ACC); compared with PX4's own flights in simulation.
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
FIRST_DRAG, PRIOR = 0.3, 50.0
"""Drag before the flight tells, 1/s (a bare quadrotor), and its weight, m^2/s."""
MOST_DRAG = 2.0
SLOW = 0.3
"""Share of the speed below which a velocity has no direction."""


@dataclass(frozen=True, slots=True)
class VelocityLoop:
    """Gains of the autopilot's velocity loop, P in 1/s and I in 1/s^2."""

    proportional: float
    integral: float


@dataclass(frozen=True, slots=True)
class CopterMotion:
    """What is known of the motion after a report. vx, vy: velocity, m/s; qx, qy: the loop's integrator, m/s^2; drag:
    1/s; course: of the velocity, rad. sums: of the drag's least squares (time, v, a, v v, v a)."""

    time: float | None = None
    vx: float = 0.0
    vy: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    drag: float = FIRST_DRAG
    sums: tuple[float, float, float, float, float, float, float] = (0.0,) * 7

    def follow(self, own: OwnMotion, loop: VelocityLoop) -> tuple["CopterMotion", OwnMotion]:
        """Take in a report; answers with the motion that the vehicle really has: course, course rate and speed in the
        place of heading, turn rate and the speed that it is told."""
        step = LONGEST_STEP + 1 if self.time is None else own.time - self.time
        if step <= 0:
            return self, self._as_motion(own, 0.0)
        ux, uy = own.airspeed * cos(own.heading), own.airspeed * sin(own.heading)
        if step > LONGEST_STEP:
            fresh = replace(self, time=own.time, vx=ux, vy=uy, qx=self.drag * ux, qy=self.drag * uy)
            return fresh, fresh._as_motion(own, own.turn_rate)
        vx, vy, qx, qy = self.vx, self.vy, self.qx, self.qy
        pieces = int(step / STEP) + 1
        h = step / pieces
        for _ in range(pieces):
            ex, ey = ux - vx, uy - vy
            vx += (loop.proportional * ex + qx - self.drag * vx) * h
            vy += (loop.proportional * ey + qy - self.drag * vy) * h
            qx += loop.integral * ex * h
            qy += loop.integral * ey * h
        moved = replace(self, time=own.time, vx=vx, vy=vy, qx=qx, qy=qy)
        learnt = moved._learn(own, (vx - self.vx) / step, (vy - self.vy) / step, step)
        turned = remainder(atan2(vy, vx) - atan2(self.vy, self.vx), 2 * pi)
        return learnt, learnt._as_motion(own, turned / step)

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
