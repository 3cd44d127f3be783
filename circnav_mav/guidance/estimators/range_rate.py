"""`kalman`: constant-velocity Kalman filter on (r, r').

The flight in the air is filtered by filterpy; B flights at once by the same equations as arrays, held to it by a test.

State (r, r') in m and m/s, driven by an unknown acceleration that is constant over a sample interval. Its standard
deviation is a third of the physical bound |r''| <= V^2/r + V omega_max. The first sample starts the filter with r' = 0
and variance V^2/2: what -V cos(theta_b) has for a bearing nobody knows.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from importlib import import_module
from math import sqrt
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from circnav_mav.guidance import maths
from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings, Fused
from circnav_mav.guidance.laws import max_range_acceleration
from circnav_mav.guidance.maths import Flag, Number, logical_not, magnitude, where
from circnav_mav.guidance.types import RangeEstimate, RangeSample, RateSample

ACCELERATION_SIGMAS = 3.0
"""The physical bound on |r''| is taken as this many standard deviations of the process noise."""
STEPS = 500
"""Samples after which the filter counts as settled."""
Covariance = tuple[Number, Number, Number]
"""rr, rv, vv of (r, r')."""
Belief = tuple[Number, Number, Number, Number, Number]
"""r (m), r_dot (m/s) and their covariance."""
Filtered = tuple[Belief, Belief, Number]
"""Before a measurement and after it, and its innovation squared over the variance of that."""
STATISTICS = "filterpy.stats"
RANGE, RATE = 0, 1
"""What was measured: which component of the state."""


class RangeRate(NamedTuple):
    """The filter at its newest sample, floats or arrays (B,). rr, rv, vv: covariance of (r, r').

    samples: taken in since the start; 0: not started, and rr is only there to divide by. refused: samples in a row
    outside the gate that agree with each other; refused_r, refused_sigma: the newest of them. nis: normalised
    innovation squared of the newest sample.
    """

    r: Number = 0.0
    r_dot: Number = 0.0
    rr: Number = 1.0
    rv: Number = 0.0
    vv: Number = 0.0
    samples: Number = 0
    refused: Number = 0
    refused_r: Number = 0.0
    refused_sigma: Number = 0.0
    nis: Number = 0.0

    def ready(self, settings: EstimatorSettings) -> Flag:
        """Whether it may steer: enough samples, and r' better known than before them (a deviation of V/sqrt 2)."""
        return (self.samples >= settings.min_samples) & (self.vv < settings.speed**2 / 4)


def acceleration_variance(settings: EstimatorSettings, r: Number) -> Number:
    """Variance of the unknown acceleration at range r (m), m^2/s^4."""
    return (max_range_acceleration(settings.speed, settings.max_turn_rate, r) / ACCELERATION_SIGMAS) ** 2


def carried(P: Covariance, h: Number, q: Number) -> Covariance:
    """The covariance after h seconds of an unknown acceleration with variance q."""
    rr, rv, vv = P
    return rr + 2 * h * rv + h**2 * vv + q * h**4 / 4, rv + h * vv + q * h**3 / 2, vv + q * h**2


def fused(P: Covariance, gain_r: Number, gain_v: Number, of: int = RANGE) -> Covariance:
    """The covariance after a range or a range rate was taken in with these gains."""
    rr, rv, vv = P
    seen = (rr, rv) if of == RANGE else (rv, vv)
    return rr - gain_r * seen[0], rv - gain_r * seen[1], vv - gain_v * seen[1]


def filtered(before: RangeRate, h: Number, q: Number, z: Number, sigma: Number, of: int = RANGE) -> Filtered:
    """The equations, of floats or arrays (B,): h seconds of an acceleration with variance q, then a range z, or a range
    rate."""
    P = carried((before.rr, before.rv, before.vv), h, q)
    r, r_dot = before.r + before.r_dot * h, before.r_dot
    S, nu = P[2 * of] + sigma**2, z - (r, r_dot)[of]
    gain_r, gain_v = P[of] / S, P[1 + of] / S
    return (r, r_dot, *P), (r + gain_r * nu, r_dot + gain_v * nu, *fused(P, gain_r, gain_v, of)), nu**2 / S


@cache
def load_filterpy() -> Any:
    """filterpy's filters, without its statistics: of those they want one function, which nothing here calls, and which
    loads scipy.stats, half a second of computing and 40 MB. It does so once somebody calls it.

    A flight loads them while it waits for its vehicle."""
    if STATISTICS in sys.modules:
        return import_module("filterpy.kalman")
    sys.modules[STATISTICS] = later = ModuleType(STATISTICS)
    later.__dict__["logpdf"] = lambda *given, **named: import_module(STATISTICS).logpdf(*given, **named)
    try:
        return import_module("filterpy.kalman")
    finally:
        del sys.modules[STATISTICS]


def filtered_by_filterpy(before: RangeRate, h: float, q: float, z: float, sigma: float, of: int = RANGE) -> Filtered:
    """`filtered` by filterpy."""
    filterpy = load_filterpy()
    x, P = np.array([before.r, before.r_dot]), np.array([[before.rr, before.rv], [before.rv, before.vv]])
    g = h * h / 2
    Q = np.array([[q * g * g, q * g * h], [q * h * g, q * h * h]])
    x, P = filterpy.predict(x, P, F=np.array([[1.0, h], [0.0, 1.0]]), Q=Q)
    # all that it could return costs twice as much again
    after = filterpy.update(x, P, z, sigma**2, np.eye(2)[of : of + 1])
    nis = (z - x.tolist()[of]) ** 2 / (float(P[of, of]) + sigma**2)
    upper = (0, 0, 1), (0, 1, 1)
    return (*x.tolist(), *P[upper].tolist()), (*after[0].tolist(), *after[1][upper].tolist()), nis


Filter = Callable[..., Filtered]


def observe(
    before: RangeRate, settings: EstimatorSettings, *, h: Number, z: Number, sigma: Number, by: Filter = filtered
) -> RangeRate:
    """The filter after a range z (m) of deviation sigma (m), measured h seconds after the sample before.

    A run of samples outside the gate that agree with each other means that the filter is the outlier: it starts anew.
    """
    ahead, after, nis = by(before, h, acceleration_variance(settings, before.r), z, sigma)
    started = before.samples > 0
    taken = started & (nis <= settings.gate**2)
    # of one motion: no farther apart than twice the speed carries, plus noise
    reach = 2 * settings.speed * h + settings.gate * maths.sqrt(before.refused_sigma**2 + sigma**2)
    agree = (before.refused == 0) | (magnitude(z - before.refused_r) <= reach)
    refused = where(taken, 0, where(agree, before.refused + 1, 1))
    starts = logical_not(started) | (refused >= settings.restart_after)
    at_start = z, 0.0, sigma**2, 0.0, settings.speed**2 / 2
    r, r_dot, rr, rv, vv = (
        where(starts, a, where(taken, b, c)) for a, b, c in zip(at_start, after, ahead, strict=True)
    )
    samples, refused = where(starts, 1, before.samples + taken), where(starts, 0, refused)
    return RangeRate(r, r_dot, rr, rv, vv, samples, refused, refused_r=z, refused_sigma=sigma, nis=nis)


def observe_rate(
    before: RangeRate, settings: EstimatorSettings, *, h: Number, z: Number, sigma: Number, by: Filter = filtered
) -> RangeRate:
    """The filter h seconds after the sample before, with a measured range rate z (m/s) of deviation sigma. Outside the
    gate it is left out: the ranges tell who is wrong. Before the first range nothing of it counts."""
    ahead, after, nis = by(before, h, acceleration_variance(settings, before.r), z, sigma, RATE)
    taken = nis <= settings.gate**2
    r, r_dot, rr, rv, vv = (where(taken, new, old) for new, old in zip(after, ahead, strict=True))
    return before._replace(r=r, r_dot=r_dot, rr=rr, rv=rv, vv=vv)


class KalmanRangeRate(Estimator):
    """The filter in flight. The time step is the difference of two sensor stamps: jitter on the way costs nothing.

    filterpy's step costs as much as all the rest of a setpoint. So the setpoint is made from the same equations in
    floats, which differ in the last bits, and what the filter goes on from is filterpy's, worked out behind it.
    """

    def __init__(self, settings: EstimatorSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        self._state, self._newest, self._unsettled = RangeRate(), None, None

    _newest: RangeSample | RateSample | None
    _unsettled: Callable[[], RangeRate] | None
    """What filterpy makes of the newest range, until it is asked."""

    @property
    def ready(self) -> bool:
        return bool(self._state.ready(self._settings))

    @property
    def nis(self) -> float | None:
        """Normalised innovation squared of the newest sample, taken in or not; chi-square with 1 degree of freedom."""
        state = self._state
        begun = state.samples == 0 or (state.samples == 1 and state.refused == 0)
        return None if begun else float(state.nis)

    def observe(self, sample: RangeSample, *, at_leisure: bool = False) -> Fused:
        """Take one sample in, or refuse it at the gate. Stamps must rise from call to call. at_leisure: no setpoint
        waits for it."""
        self.settle()
        before, newest = self._state, self._newest
        h = 0.0 if newest is None else max(sample.stamp - newest.stamp, 0.0)  # a rate may have come before its range
        taken_in = partial(observe, before, self._settings, h=h, z=sample.r, sigma=sample.sigma)
        self._unsettled, self._newest = partial(taken_in, by=filtered_by_filterpy), sample
        if at_leisure:
            self.settle()
        else:
            self._state = taken_in()
        if sample.rate is not None:
            self.observe_rate(sample.rate)
        return Fused.GATED if self._state.refused else Fused.ACCEPTED

    def settle(self) -> None:
        """Let filterpy take the newest range in."""
        if self._unsettled is not None:
            self._state, self._unsettled = self._unsettled(), None

    def observe_rate(self, sample: RateSample) -> None:
        """Take in a range rate, unless it is older than the newest sample."""
        self.settle()
        if self._newest is None or sample.stamp < self._newest.stamp:
            return
        h = sample.stamp - self._newest.stamp
        self._state = observe_rate(
            self._state, self._settings, h=h, z=sample.r_dot, sigma=sample.sigma, by=filtered_by_filterpy
        )
        self._newest = sample

    def restamp(self) -> None:
        """Start anew: the steps of this filter are those of the sensor's clock."""
        self.reset()

    def at(self, time: float) -> RangeEstimate | None:
        if self._newest is None:
            return None
        state, ahead = self._state, max(time - self._newest.time, 0.0)
        rr, _, vv = carried((state.rr, state.rv, state.vv), ahead, acceleration_variance(self._settings, state.r))
        r, r_dot = float(state.r), float(state.r_dot)
        return RangeEstimate(time, r + r_dot * ahead, r_dot, sqrt(rr), sqrt(vv))


@dataclass(frozen=True, slots=True)
class SteadyState:
    """r_dot_sigma: standard deviation of the estimated range rate, m/s. lag: its delay under acceleration, s."""

    r_dot_sigma: float
    lag: float


@lru_cache(maxsize=1024)
def steady_state(settings: EstimatorSettings, *, r: float, sigma: float, period: float) -> SteadyState:
    """What the filter settles to after many samples of noise sigma (m) every `period` (s) at range r.

    The lag is that of an alpha-beta filter under constant acceleration, T (2 alpha - beta)/(2 beta).
    """
    q = acceleration_variance(settings, r)
    P: Covariance = (sigma**2, 0.0, settings.speed**2 / 2)
    alpha = beta = 0.0
    for _ in range(STEPS):
        rr, rv, _ = P = carried(P, period, q)
        alpha, beta = float(rr / (rr + sigma**2)), float(rv / (rr + sigma**2))
        P = fused(P, alpha, beta)
    return SteadyState(float(np.sqrt(P[2])), period * (2 * alpha - beta * period) / (2 * beta * period))
