"""Published laws on range and range rate, a law after the idea of a paper, and a published
estimator, for comparison, written as user-defined laws (docs/api.md).

Each function here returns, for a circle, a function from an estimate to a turn rate (rad/s,
counter-clockwise positive). e is the radius error r - r_d, V the speed, and k the gain at `lag`,
the delay of the loop in s.
"""

from math import copysign, inf, sqrt, tanh

from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.guidance.laws import max_range_acceleration, rate_gain
from circnav_mav.guidance.types import Orbit, OwnLaw, RangeEstimate, RangeSample

LAG = 0.55
"""Delay of turn and filter, s, for which the gains are chosen."""


def bounded(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """omega = k [r' + V sqrt(1 - (r_s/r)^2)] outside r_s = sqrt(r_d^2 - 1/k^2), and
    k [r' - V sqrt(1 - (r/r_s)^2)] inside.

    k > 1/r_d, in 1/m. The vehicle settles on the exact radius, and |omega| <= 2 k V.

    Source: Cao, "UAV circumnavigating an unknown target under a GPS-denied environment with
    range-only measurements", Automatica 55 (2015). Inside r_s, the law's two-sided form is used.
    """
    V = orbit.speed
    k, r_s = _bounded_gain(orbit, lag)

    def law(estimate: RangeEstimate) -> float:
        r = max(estimate.r, 0.0)
        if r >= r_s:
            closing = V * sqrt(1 - (r_s / r) ** 2)
        else:
            closing = -V * sqrt(1 - (r / r_s) ** 2)
        return orbit.direction.turn_sign * k * (estimate.r_dot + closing)

    return law


def _bounded_gain(orbit: Orbit, lag: float) -> tuple[float, float]:
    """Return gain k (1/m) and inner radius r_s (m) of the law `bounded`."""
    k = max(0.5 * rate_gain(orbit.speed, orbit.radius, lag), 1.5 / orbit.radius)
    return k, sqrt(orbit.radius**2 - 1 / k**2)


def three_circles(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """omega = f(r) + k r' with f = k V sqrt(1 - (r_a/r)^2) outside the auxiliary circle r_a, and
    f = -k V (r_a - r)/(r - r_c) between the safety circle r_c and r_a.

    k and r_a are k and r_s of `bounded`; r_c = r_d/2. While the vehicle flies away from the target
    inside r_a, f is at least -k V.

    Not a published law: after the idea of Bhati, Vaishnavi, Jain, "Safe circumnavigation of a
    hostile target using range-based measurements", arXiv 2501.06528 (2025). Only its abstract was
    read: three circles (stabilizing, auxiliary, safety), a barrier Lyapunov function, and a gain
    inside the auxiliary circle. The equations are derived as follows. With the distance p from the
    target to the line of flight, p' = omega r r'/V. So E = 1/V int r f dr - p has the derivative
    E' = -k r r'^2/V <= 0. E is a barrier: it grows without bound towards r_c.

    Limits: the safety circle is kept only with exact ranges, without drift, and within the limit of
    the turn rate. A start inside r_c is outside the domain of E. There the law turns away from the
    target at the limit, until the vehicle flies away from the target.
    """
    V = orbit.speed
    k, r_a = _bounded_gain(orbit, lag)
    r_c = 0.5 * orbit.radius

    def law(estimate: RangeEstimate) -> float:
        r = estimate.r
        if r >= r_a:
            feedforward = k * V * sqrt(1 - (r_a / r) ** 2)
        else:
            push = (r_a - r) / (r - r_c) if r > r_c else inf
            # E decreases with any f that is larger while the range grows. A vehicle that leaves the
            # safety circle would otherwise turn back at its edge.
            if estimate.r_dot >= 0:
                push = min(push, 1.0)
            feedforward = max(-k * V * push, -orbit.max_turn_rate)
        return orbit.direction.turn_sign * (feedforward + k * estimate.r_dot)

    return law


class SlidingMode(Estimator):
    """Second-order sliding-mode estimator of range z and range rate v from the range alone, for
    `bounded`, whose paper replaces the measured range rate by such an estimate.

    z' = v - 1.5 sqrt(L |z - r|) sign(z - r), v' = -1.1 L sign(z - r).

    L: bound of |r''|, m/s^2, by `max_range_acceleration`. Without noise v is exact after a finite
    time. With range errors up to e the error of v is proportional to sqrt(L e).

    Source of the second step of `bounded`: Cao, Automatica 55 (2015), of which the abstract was
    read. Source of the equations and of 1.5 and 1.1: Levant, "Robust exact differentiation via
    sliding mode technique", Automatica 34 (1998), as in public implementations.

    Limits: the estimator has no gate for outliers, and does not use the sigma of a range.
    """

    nis = None

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        self._count = 0
        self._newest: RangeSample | None = None
        self._r = 0.0
        self._r_dot = 0.0

    @property
    def ready(self) -> bool:
        return self._count >= self._settings.min_samples

    def observe(self, sample: RangeSample) -> bool:
        # 1.0: longest Euler step, s, chosen. After a longer gap the estimate starts again.
        if self._newest is None or not 0 < sample.time - self._newest.time <= 1.0:
            self.reset()
            self._r = sample.r
        else:
            dt = sample.time - self._newest.time
            L = self._bound()
            miss = self._r - sample.r
            self._r += dt * (self._r_dot - copysign(1.5 * sqrt(L * abs(miss)), miss))
            self._r_dot -= copysign(1.1 * L * dt, miss)
        self._newest = sample
        self._count += 1
        return True

    def at(self, time: float) -> RangeEstimate | None:
        if self._newest is None:
            return None
        sigma = self._newest.sigma
        r = self._r + (time - self._newest.time) * self._r_dot
        return RangeEstimate(time, r, self._r_dot, sigma, sqrt(self._bound() * sigma))

    def _bound(self) -> float:
        settings = self._settings
        return max_range_acceleration(settings.speed, settings.max_turn_rate, self._r)


def relay(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """omega = k sat((r' + chi)/phi) + V/r_d with chi = clip(V e/r_d, -V/2, V/2): sliding on
    r' = -chi.

    k > V/r_d, rad/s. The boundary layer phi (m/s) avoids chattering: it limits the slope k/phi to
    `rate_gain`. Suitable for a moving target. Source: Matveev, Teimoori, Savkin, "Range-only
    measurements based target following for wheeled mobile robots", Automatica 47 (2011).
    """
    V = orbit.speed
    r_d = orbit.radius
    k = 1.33 * V / r_d
    phi = k / rate_gain(V, r_d, lag)

    def law(estimate: RangeEstimate) -> float:
        chi = min(max(V / r_d * (estimate.r - r_d), -0.5 * V), 0.5 * V)
        slide = min(max((estimate.r_dot + chi) / phi, -1.0), 1.0)
        return orbit.direction.turn_sign * (k * slide + V / r_d)

    return law


def pd(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """omega = V/r_d + k_p sat(e) + k r'. k in rad/m; k_p = k^2 V/4, for a damping of 1.

    Source: Dong, You, Xie, Hu, coordinate-free circumnavigation with range-based PD control. e is
    limited to +-e_max, with k_p e_max/k = V/2. Far out, the approach speed -r' settles to
    k_p e_max/k + V/(r_d k).
    """
    V = orbit.speed
    r_d = orbit.radius
    k = rate_gain(V, r_d, lag)
    k_p = k**2 * V / 4
    e_max = 0.5 * V * k / k_p

    def law(estimate: RangeEstimate) -> float:
        e = min(max(estimate.r - r_d, -e_max), e_max)
        return orbit.direction.turn_sign * (V / r_d + k_p * e + k * estimate.r_dot)

    return law


def pi(orbit: Orbit, lag: float = LAG) -> OwnLaw:
    """s = r' + c tanh(e/delta); omega = k s + k_i int s. A law with a state: the integral, m.

    c = V/2, delta = r_d/2, and k_i = k V/r_d, with which the integral acts ten times slower than
    the turn. The steady state of the integral is V/(r_d k_i). The limit of the integral is twice
    that value, which prevents windup while the turn saturates.

    Source: Dong, You, Wang, isoline tracking with PI control, for any field that decreases with
    range.
    """
    V = orbit.speed
    r_d = orbit.radius
    k = rate_gain(V, r_d, lag)
    k_i = k * V / r_d
    integral = 0.0
    before: float | None = None

    def law(estimate: RangeEstimate) -> float:
        nonlocal integral, before
        s = estimate.r_dot + 0.5 * V * tanh((estimate.r - r_d) / (0.5 * r_d))
        dt = 0.0 if before is None else estimate.time - before
        before = estimate.time
        integral = min(max(integral + s * dt, 0.0), 2 * V / (r_d * k_i))
        return orbit.direction.turn_sign * (k * s + k_i * integral)

    return law
