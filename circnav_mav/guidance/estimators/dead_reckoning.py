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
from circnav_mav.guidance.maths import Vector, chord, wrap
from circnav_mav.guidance.types import IntegratedAcceleration, OwnMotion

EXTRAPOLATED = 0.5
RARE = 1.6
"""Longest time over which the newest report is extrapolated by its turn rate: s, or for rare
reports in units of their interval and in s."""
HOLE = 3.0
"""Longest gap between reports, s, in a continuous path. After a longer one the displacement is
unknown."""


class PathPoint(NamedTuple):
    """A point of the path: own motion there, and the path (x, y) integrated so far, m, at the
    measured airspeed.

    piece: number of gaps before this point.
    nose_x, nose_y: integral of the unit vector of the heading, s.
    report: the newest report that an extrapolated point is based on. It supplies the accelerations,
        which are not extrapolated.
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
        """Return the point with this motion, `step` seconds later, after an arc that turns by
        `turned` (rad)."""
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
    """Integrates arcs between reports. Drops late and repeated reports. A gap starts a new piece of
    path."""

    def __init__(self) -> None:
        # Reports kept: more than 1 s at the highest rate. Ranges are newer than that.
        self._points: deque[PathPoint] = deque(maxlen=64)
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
        """Return the point of the path at a time (s), interpolated or extrapolated, or None outside
        of the path."""
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
    """Predicted p = vehicle - target = (x, y), m, at range r (m).

    drift: m/s.
    airspeed: true, m/s.
    r_dot: m/s. Variances of r (m^2), of the direction (rad^2) and of r_dot (m^2/s^2).
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
    mean: ekf.Array,
    covariance: ekf.Array,
    assumed: ekf.Array,
    dt: float,
    path: Vector,
    heading: float,
    airspeed: float,
    change: ekf.VelocityChange | None,
) -> Prediction:
    """Return the estimate predicted by dt (s) along an air path (m, at the measured airspeed).

    mean (12,), covariance (12, 12): of the state of `relative_ekf`.
    assumed (3,): drift_psd (m^2/s^3), gust (m/s) and acceleration_weight (0 to 1), averages of the
        noise models.
    heading (rad) and measured airspeed (m/s): at the end of the path.
    change: measured accelerations, from `PathPoint.velocity_change_since`.
    """
    drift_psd, gust, weight = assumed
    distance, theta, place = ekf.motion(mean, dt, path)
    r = float(distance)
    n = (cos(theta), sin(theta))
    t = (-n[1], n[0])
    d = _drift(mean.tolist(), dt, weight, change)
    kappa = float(mean[ekf.KAPPA])
    air = _along(heading, airspeed)
    v = (kappa * air[0] + d[0], kappa * air[1] + d[1])
    across = t[0] * v[0] + t[1] * v[1]
    ahead = n[0] * air[0] + n[1] * air[1]
    # Derivatives of range, direction and range rate by the state: r' = n.v, and a direction error
    # rotates n.
    rows = np.empty((3, ekf.STATES))
    rows[0] = place.real
    rows[1] = place.imag / r
    rows[2] = across * rows[1]
    rows[2, ekf.KAPPA] += ahead
    calm = exp(-dt / ekf.GUST_TIME)
    for axis, along in enumerate(n):
        rows[2, ekf.DX + axis] += along
        rows[2, ekf.GX + axis] += calm * along
        if change is not None:
            rows[2, ekf.EX + axis] += along
    r_variance, direction_variance, rate_variance = (rows @ covariance * rows).sum(axis=1).tolist()
    steady, gusty = ekf.steps(drift_psd, gust, dt)
    wander = ekf.wandered(steady, gusty, dt)
    turned = wander / r**2
    added = across**2 * turned + steady + gusty + ekf.KAPPA_PSD * dt * ahead**2
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
    """Return the drift after dt, m/s. The measured change of velocity replaces the assumed decay of
    gusts, weighted by the probability of the noise models that use accelerations (`weight`)."""
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
