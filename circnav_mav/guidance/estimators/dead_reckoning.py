"""Dead reckoning: the path through the air from asynchronous reports of heading, turn rate and
airspeed.

`predict_mixture` predicts the estimate along this path beyond the newest range.
"""

from collections import deque
from collections.abc import Sequence
from math import cos, exp, sin
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.estimators import relative_ekf as ekf
from circnav_mav.guidance.estimators.acquisition import Estimate
from circnav_mav.guidance.maths import Vector, chord, wrap
from circnav_mav.guidance.types import IntegratedAcceleration, OwnMotion

EXTRAPOLATED = 0.5
"""Longest time, s, over which the newest report is extrapolated by its turn rate."""
RARE = 1.6
"""Longest extrapolation of the newest report, in intervals of the reports, if reports are rare. The
same number is an upper bound in seconds."""
HOLE = 3.0
"""Longest gap between reports, s, within a piece of path. After a longer gap the displacement is
unknown, and a new piece begins."""


class PathPoint(NamedTuple):
    """A point of the path.

    motion: own motion at this point.
    x, y: path integrated so far, m, at the measured airspeed.
    piece: number of gaps before this point.
    nose_x, nose_y: integral of the unit vector of the heading, s.
    report: newest report, from which a point is extrapolated; None for other points. It supplies
        the accelerations, which are not extrapolated.
    """

    motion: OwnMotion
    x: float = 0.0
    y: float = 0.0
    piece: int = 0
    nose_x: float = 0.0
    nose_y: float = 0.0
    report: OwnMotion | None = None

    def carried(
        self, motion: OwnMotion, airspeed: float, turned: float, step: float
    ) -> "PathPoint":
        """Return the point `step` seconds later, at the end of an arc.

        motion: own motion at the new point.
        airspeed: mean airspeed on the arc, m/s.
        turned: turn of the arc, rad.
        """
        heading = self.motion.heading
        x, y = chord(airspeed, heading, turned, step)
        nose_x, nose_y = _along(heading + turned / 2, step)  # midpoint rule
        return PathPoint(
            motion, self.x + x, self.y + y, self.piece, self.nose_x + nose_x, self.nose_y + nose_y
        )

    def velocity_change_since(self, before: "PathPoint") -> ekf.VelocityChange | None:
        """Return the accelerations measured since an earlier point, or None if they do not cover
        this interval."""
        new = self.report or self.motion
        old = before.report or before.motion
        if (
            new.acceleration is None
            or old.acceleration is None
            or new.acceleration.since != old.acceleration.since
        ):
            return None
        (x, y), (old_x, old_y) = (_along(m.heading, m.airspeed) for m in (new, old))
        return ekf.VelocityChange(
            (new.acceleration.x - old.acceleration.x, new.acceleration.y - old.acceleration.y),
            (x - old_x, y - old_y),
            (self.nose_x - before.nose_x, self.nose_y - before.nose_y),
            new.airspeed * new.turn_rate,
        )


class FlownPath:
    """Integrates arcs between reports. Late and repeated reports are ignored. A gap starts a new
    piece of path."""

    def __init__(self) -> None:
        # Number of points: more than 1 s at the highest rate of the reports. Ranges arrive with
        # less delay.
        self._points: deque[PathPoint] = deque(maxlen=100)
        self._longest = EXTRAPOLATED

    def move(self, motion: OwnMotion) -> None:
        """Add a report of own motion."""
        if not self._points:
            self._points.append(PathPoint(motion))
            return
        last = self._points[-1]
        step = motion.time - last.motion.time
        if step > 0:
            self._longest = min(max(RARE * step, EXTRAPOLATED), RARE)
        if step > HOLE:
            self._points.append(PathPoint(motion, last.x, last.y, last.piece + 1))
        elif step > 0:
            turned = float(wrap(motion.heading - last.motion.heading))
            self._points.append(
                last.carried(motion, (last.motion.airspeed + motion.airspeed) / 2, turned, step)
            )

    def at(self, time: float) -> PathPoint | None:
        """Return the point of the path at a time (s), interpolated or extrapolated. Return None
        before the oldest point, in a gap, and beyond the longest extrapolation."""
        if not self._points:
            return None
        newest = self._points[-1]
        last = newest.motion
        ahead = time - newest.motion.time
        if ahead > self._longest:
            return None
        if ahead >= 0:
            turned = last.turn_rate * ahead
            motion = OwnMotion(
                last.time + ahead, last.heading + turned, last.turn_rate, last.airspeed
            )
            carried = newest.carried(motion, last.airspeed, turned, ahead)
            return carried._replace(nose_x=newest.nose_x, nose_y=newest.nose_y, report=last)
        for after, before in zip(reversed(self._points), list(self._points)[-2::-1], strict=False):
            if before.motion.time <= time:
                return _between(before, after, time) if before.piece == after.piece else None
        return None


def _between(before: PathPoint, after: PathPoint, time: float) -> PathPoint:
    old = before.motion
    new = after.motion
    step = time - old.time
    share = step / (new.time - old.time)
    turned = float(wrap(new.heading - old.heading)) * share
    airspeed = (old.airspeed + new.airspeed) / 2
    turn_rate = new.turn_rate * share + old.turn_rate * (1 - share)
    acceleration = None
    if (
        new.acceleration is not None
        and old.acceleration is not None
        and new.acceleration.since == old.acceleration.since
    ):
        x, y = (
            old.acceleration.x + share * (new.acceleration.x - old.acceleration.x),
            old.acceleration.y + share * (new.acceleration.y - old.acceleration.y),
        )
        acceleration = IntegratedAcceleration(x, y, new.acceleration.since)
    motion = OwnMotion(
        old.time + step, old.heading + turned, turn_rate, airspeed, acceleration=acceleration
    )
    return before.carried(motion, airspeed, turned, step)


def _along(angle: float, length: float) -> tuple[float, float]:
    return length * cos(angle), length * sin(angle)


class Prediction(NamedTuple):
    """Predicted relative motion.

    r: range, m.
    x, y: vehicle minus target, m.
    drift: wind minus target velocity, m/s.
    airspeed: true airspeed, m/s.
    r_dot: range rate, m/s.
    r_variance: variance of r, m^2.
    direction_variance: variance of the direction from target to vehicle, rad^2.
    r_dot_variance: variance of r_dot, m^2/s^2.
    """

    r: float
    x: float
    y: float
    drift: tuple[float, float]
    airspeed: float
    r_dot: float
    r_variance: float
    direction_variance: float
    r_dot_variance: float


def predict_mixture(
    estimate: Estimate,
    dt: float,
    path: Vector,
    heading: float,
    airspeed: float,
    change: ekf.VelocityChange | None,
) -> Prediction:
    """Return the estimate predicted by dt (s) along an air path (m, at the measured airspeed).

    heading (rad) and measured airspeed (m/s): at the end of the path.
    change: measured accelerations, from `PathPoint.velocity_change_since`.
    """
    mean = estimate.mean
    distance, direction, J = ekf.motion(mean, dt, path)
    r = distance.item()
    theta = direction.item()
    n = (cos(theta), sin(theta))
    t = (-n[1], n[0])
    d = _drift(mean.tolist(), dt, estimate.acceleration_weight, change)
    kappa = float(mean[ekf.KAPPA])
    air = _along(heading, airspeed)
    v = (kappa * air[0] + d[0], kappa * air[1] + d[1])
    across = t[0] * v[0] + t[1] * v[1]
    ahead = n[0] * air[0] + n[1] * air[1]
    # Rows: derivatives of range, direction and range rate by the state. The range rate is n.v, and
    # a direction error rotates n.
    rows = np.empty((3, ekf.STATES))
    rows[:2] = J
    rows[2] = across * rows[1]
    rows[2, ekf.KAPPA] += ahead
    calm = exp(-dt / ekf.GUST_TIME)
    for axis, along in enumerate(n):
        rows[2, ekf.DX + axis] += along
        rows[2, ekf.GX + axis] += calm * along
        if change is not None:
            rows[2, ekf.EX + axis] += along
    r_variance, direction_variance, rate_variance = (
        (rows @ estimate.covariance * rows).sum(axis=1).tolist()
    )
    grown = estimate.drift_psd * dt + (1 - calm**2) * estimate.gust**2
    wander = grown * (dt**2 / 3)
    turned = wander / r**2
    added = across**2 * turned + grown + ekf.KAPPA_PSD * dt * ahead**2
    return Prediction(
        r=r,
        x=r * n[0],
        y=r * n[1],
        drift=d,
        airspeed=kappa * airspeed,
        r_dot=n[0] * v[0] + n[1] * v[1],
        r_variance=r_variance + wander,
        direction_variance=direction_variance + turned,
        r_dot_variance=rate_variance + added,
    )


def _drift(
    mean: Sequence[float], dt: float, weight: float, change: ekf.VelocityChange | None
) -> Vector:
    """Return the drift after dt (s), m/s. The measured change of velocity replaces the assumed
    decay of gusts. weight: probability of the noise models that use accelerations, 0 to 1."""
    _, _, dx, dy, kappa, _, gx, gy, forward, left, ex, ey = mean
    calm = exp(-dt / ekf.GUST_TIME)
    if change is None:
        return dx + calm * gx, dy + calm * gy
    c, s = change.nose
    keep = calm + weight * (1 - calm)
    error = (c * forward - s * left, s * forward + c * left)
    return (
        dx + keep * gx + ex - error[0] + weight * (change.change[0] - kappa * change.air[0]),
        dy + keep * gy + ey - error[1] + weight * (change.change[1] - kappa * change.air[1]),
    )
