"""Airspeed and side-slip of a multicopter from its accelerometer, and the horizontal acceleration
by the thrust ("push") that holds the airspeed.

The thrust of a multicopter has no component along its forward and left axes. So the accelerometers
of these axes measure the drag of the air alone, in straight flight and in turns. They do not depend
on the attitude estimate:

    force = -c v (1 + |v|/v_2)        for each of the two axes

v: speed through the air along the axis. c: drag coefficient, from the mission. v_2: speed at which
the quadratic drag of the airframe equals the linear drag of the rotors. The ratio of the true to
the measured airspeed is the airspeed scale. The relative-motion estimator learns this scale from
the ranges. `ScaleFit` learns the scale from accelerations, while GPS is available.

Source: Martin and Salaun, "The true role of accelerometer feedback in quadrotor control" (2010).
v_2 was measured on ArduCopter's simulated quadrotor, straight and in turns.
"""

from cmath import rect
from math import atan2, exp, hypot, sqrt
from typing import NamedTuple

from circnav_mav.guidance.recursive_least_squares import RecursiveLeastSquares
from circnav_mav.guidance.types import LONGEST_REPORT_GAP, OwnMotion

EQUAL_DRAG_SPEED = 8.0
"""v_2, m/s: speed at which the quadratic drag equals the linear drag."""
MAX_SLIP = 0.6
"""Largest side-slip angle, rad; a larger measured angle is clipped. Such angles occur only near
standstill, where they have no meaning."""


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


class AirVelocity(NamedTuple):
    """Measured velocity through the air after a report.

    time: of the report, s.
    forward, left: speeds along the nose and to the left, m/s, for an airspeed scale of 1.
    """

    time: float = float("-inf")
    forward: float = 0.0
    left: float = 0.0

    def follow(self, own: OwnMotion, coefficient: float) -> "AirVelocity":
        """Return the velocity after a report of own motion. It is unchanged if the report has no
        measured drag. coefficient: c, 1/s."""
        if own.drag is None:
            return self
        forward = speed_of_drag(-own.drag[0], coefficient)
        left = speed_of_drag(-own.drag[1], coefficient)
        step = own.time - self.time
        if not 0 <= step <= LONGEST_REPORT_GAP:
            return AirVelocity(own.time, forward, left)
        # 0.5: time constant of the low-pass on the speed along the nose, s. A shorter one would
        # pass gusts and vibration.
        # 1.0: time constant of the low-pass on the speed to the left, s. The low-pass is slower,
        # because this speed changes the heading of the path, and so the turn command.
        return AirVelocity(
            own.time,
            forward + (self.forward - forward) * exp(-step / 0.5),
            left + (self.left - left) * exp(-step / 1.0),
        )

    def motion(self, own: OwnMotion) -> OwnMotion:
        """Return own motion along the path through the air. The heading is the direction of this
        path, and the airspeed is measured."""
        slip = atan2(self.left, max(self.forward, 1e-3))
        slip = min(max(slip, -MAX_SLIP), MAX_SLIP)
        return own._replace(heading=own.heading + slip, airspeed=hypot(self.forward, self.left))


PRIOR_WEIGHT = 20.0
"""Weight of the prior, a scale of 1, in `ScaleFit`, m^2/s. Flying a circle at 2 m/s adds the same
weight in 10 s."""
SCALE_BOUNDS = (0.5, 2.0)
"""Bounds of the learned airspeed scale, which is clipped to them. The drag coefficients of copters
are between 0.2/s and 1/s."""
SCALE_SIGMA = 0.25
"""Standard deviation of the airspeed scale before it is learned."""


class ScaleFit:
    """Least squares of the airspeed scale from accelerations. The fit is valid while GPS keeps the
    attitude estimate of the autopilot exact.

    Within a few seconds the wind is constant, so the velocity through the air changes by the
    integrated acceleration:

        change of measured air velocity = change of velocity / scale

    Velocities are complex: east + j north.
    """

    def __init__(self) -> None:
        # Time constant of the least squares, s.
        self._fit = RecursiveLeastSquares(120.0)
        self._time = float("-inf")
        self._since = float("nan")
        """Beginning of the integral of the acceleration, s."""
        self._last = (0j, 0j)
        """Newest integrated acceleration, and newest measured air velocity at a scale of 1, m/s."""
        self._velocity = 0j
        self._measured = 0j
        """Integrated acceleration, and measured air velocity, after the high-pass, m/s."""

    @property
    def scale(self) -> float:
        """Airspeed scale: true over measured airspeed."""
        square = self._fit.xx + PRIOR_WEIGHT
        product = self._fit.xy.real + PRIOR_WEIGHT
        scale = square / max(product, 1e-6)
        return float(min(max(scale, SCALE_BOUNDS[0]), SCALE_BOUNDS[1]))

    @property
    def sigma(self) -> float:
        """Standard deviation of the airspeed scale."""
        return float(max(SCALE_SIGMA * PRIOR_WEIGHT / (self._fit.xx + PRIOR_WEIGHT), 0.03))

    def follow(self, own: OwnMotion, air: AirVelocity) -> None:
        """Update with a report. air: velocity through the air in body axes, measured at this
        report."""
        if own.acceleration is None:
            self._time = float("-inf")
            return
        step = own.time - self._time
        goes_on = 0 < step <= LONGEST_REPORT_GAP and own.acceleration.since == self._since
        integral = complex(own.acceleration.x, own.acceleration.y)
        velocity = complex(air.forward, air.left) * rect(1.0, own.heading)
        last = self._last
        self._time = own.time
        self._since = own.acceleration.since
        self._last = (integral, velocity)
        if not goes_on:
            self._velocity = 0j
            self._measured = 0j
            return
        # Time constant of the high-pass in `ScaleFit`, s. It removes a steady wind, and keeps turns
        # and accelerations.
        keep = exp(-step / 5.0)
        self._velocity = keep * (self._velocity + integral - last[0])
        self._measured = keep * (self._measured + velocity - last[1])
        self._fit.add(self._velocity, self._measured, step, step)


class MeanWind(NamedTuple):
    """Mean of the wind, from a copter that holds its speed over the ground and measures its
    velocity through the air.

    time: of the report, s.
    x, y: wind, m/s.
    share: weight of the reports in the mean. 0: no report yet, 1: many reports.
    """

    time: float = float("-inf")
    x: float = 0.0
    y: float = 0.0
    share: float = 0.0

    @property
    def sigma(self) -> float:
        """Standard deviation of each component of the mean wind, m/s."""
        # 0.4: standard deviation of each component of a learned wind, m/s.
        # 4.0: standard deviation of each component of the wind before it is learned, m/s.
        return hypot(0.4, 4.0 * (1 - self.share))

    def follow(self, own: OwnMotion, air: AirVelocity, scale: float) -> "MeanWind":
        """Return the mean wind after a report.

        own: heading and speed over the ground.
        air: velocity through the air.
        scale: airspeed scale.
        """
        step = own.time - self.time
        if not 0 < step <= LONGEST_REPORT_GAP:
            return self._replace(time=own.time)
        ground = rect(own.airspeed, own.heading)
        wind = ground - scale * complex(air.forward, air.left) * rect(1.0, own.heading)
        # Time constant of the mean of the wind, s: about half a lap.
        kept = exp(-step / 20.0)
        share = 1 - (1 - self.share) * kept
        weight = (1 - kept) / share
        x = self.x + (wind.real - self.x) * weight
        y = self.y + (wind.imag - self.y) * weight
        return MeanWind(own.time, x, y, share)


MAX_TRIM = 1.5
"""Bound of each integral (forward and left) of `AirspeedHold`, m/s^2. This push corrects an
attitude estimate that is wrong by 9 deg."""


class AirspeedHold:
    """Push (horizontal acceleration by the thrust) that holds an airspeed without side-slip.

    The push that balances the drag at this airspeed is commanded at once. Without GPS, the attitude
    estimate is wrong by some degrees in turns. An integral of the missing drag corrects the forward
    push. An integral of the side-slip corrects the push to the left. Without the second integral,
    the path through the air turned by up to 1.7 deg/s more or less than the nose.
    """

    def __init__(self, coefficient: float) -> None:
        """coefficient: c of the mission, 1/s."""
        self._coefficient = coefficient
        self.reset()

    def reset(self, scale: float = 1.0) -> None:
        """Set the integrals to 0, and the airspeed scale to a known value."""
        self.scale = scale
        """Airspeed scale in use. It follows the estimated scale slowly."""
        self._forward_trim = 0.0
        self._left_trim = 0.0
        self._slip_speed = 0.0
        self._time = float("-inf")

    def push(self, speed: float) -> tuple[float, float]:
        """Return the push forward and to the left, m/s^2, that holds a true airspeed, m/s, along
        the nose."""
        if speed <= 0:
            return 0.0, 0.0
        forward = drag_force(speed / self.scale, self._coefficient) + self._forward_trim
        # 0.4: push to the right per speed to the left, 1/s. It reduces the side-slip.
        return forward, self._left_trim - 0.4 * self._slip_speed

    def follow(self, air: AirVelocity, speed: float, scale: float | None) -> None:
        """Update the integrals and the airspeed scale with a report, while circnav steers.

        air: measured velocity through the air.
        speed: true airspeed to hold, m/s.
        scale: estimated airspeed scale, or None while it is not trusted.
        """
        step = air.time - self._time
        self._time = air.time
        if not 0 < step <= LONGEST_REPORT_GAP:
            return
        if scale is not None:
            # Time constant with which the held airspeed follows the estimated scale, s.
            self.scale += (scale - self.scale) * (1 - exp(-step / 10.0))
        wanted = drag_force(speed / self.scale, self._coefficient)
        missing = wanted - drag_force(air.forward, self._coefficient)
        self._slip_speed = 0.0
        # If more than this share of the drag is missing, the copter still accelerates to the
        # airspeed. Such a difference does not show a wrong attitude, so the integrals wait.
        if abs(missing) < 0.4 * wanted:
            self._slip_speed = min(max(air.left, -2.0), 2.0)
            # Rate of the forward integral, 1/s. The integral is slower than the response of the
            # airspeed by the drag (0.25 to 0.5/s), so that the airspeed does not oscillate.
            self._forward_trim = _bounded(self._forward_trim + 0.15 * missing * step)
            # Push to the right per integral of the speed to the left, 1/s^2.
            self._left_trim = _bounded(self._left_trim - 0.15 * self._slip_speed * step)


def _bounded(trim: float) -> float:
    return min(max(trim, -MAX_TRIM), MAX_TRIM)
