"""The range-rate filter for B flights, as arrays. A test compares it with `guidance.estimators.range_rate`."""

from typing import NamedTuple

from circnav_mav.guidance import maths
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import RANGE, RATE, acceleration_variance
from circnav_mav.guidance.maths import Flag, Number, logical_not, magnitude, where

Covariance = tuple[Number, Number, Number]
"""Covariance of (r, r'): rr, rv, vv."""
Belief = tuple[Number, Number, Number, Number, Number]
"""Mean r (m), r_dot (m/s) and their covariance."""
Filtered = tuple[Belief, Belief, Number]
"""Belief before and after a measurement, and its normalized innovation squared."""


class RangeRate(NamedTuple):
    """The filter at its newest sample, floats or arrays (B,). rr, rv, vv: covariance of (r, r').

    samples: number of accepted samples since the start; 0: not started, and rr is a placeholder. refused: number of
    successive samples outside the gate that agree with each other. refused_r, refused_sigma: range and
    standard deviation of the newest of them, m. nis: normalized innovation squared of the newest sample.
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
        """True if it may steer: enough samples, and a standard deviation of r' below V/2."""
        return (self.samples >= settings.min_samples) & (self.vv < settings.speed**2 / 4)


def predict(P: Covariance, h: Number, q: Number) -> Covariance:
    """Return the covariance after h seconds of an unknown acceleration with variance q."""
    rr, rv, vv = P
    return rr + 2 * h * rv + h**2 * vv + q * h**4 / 4, rv + h * vv + q * h**3 / 2, vv + q * h**2


def filtered(before: RangeRate, h: Number, q: Number, z: Number, sigma: Number, of: int = RANGE) -> Filtered:
    """Predict h seconds with an acceleration of variance q, then update with a range z or a range rate."""
    rr, rv, vv = P = predict((before.rr, before.rv, before.vv), h, q)
    r, r_dot = before.r + before.r_dot * h, before.r_dot
    S, nu = P[2 * of] + sigma**2, z - (r, r_dot)[of]
    gain_r, gain_v = P[of] / S, P[1 + of] / S
    seen = (rr, rv) if of == RANGE else (rv, vv)
    after = rr - gain_r * seen[0], rv - gain_r * seen[1], vv - gain_v * seen[1]
    return (r, r_dot, *P), (r + gain_r * nu, r_dot + gain_v * nu, *after), nu**2 / S


def observe(before: RangeRate, settings: EstimatorSettings, *, h: Number, z: Number, sigma: Number) -> RangeRate:
    """Return the filter after a range z (m) with standard deviation sigma (m), h seconds after the previous sample.

    If several successive samples outside the gate agree with each other, the filter is wrong and restarts.
    """
    ahead, after, nis = filtered(before, h, acceleration_variance(settings, before.r), z, sigma)
    started = before.samples > 0
    taken = started & (nis <= settings.gate**2)
    # two refused samples agree if their distance fits twice the speed, plus noise
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


def observe_rate(before: RangeRate, settings: EstimatorSettings, *, h: Number, z: Number, sigma: Number) -> RangeRate:
    """Return the filter after a range rate z (m/s) with standard deviation sigma, h seconds after the previous sample.

    A rate outside the gate is ignored: the ranges decide whether the filter or the rate is wrong.
    """
    ahead, after, nis = filtered(before, h, acceleration_variance(settings, before.r), z, sigma, RATE)
    taken = nis <= settings.gate**2
    r, r_dot, rr, rv, vv = (where(taken, new, old) for new, old in zip(after, ahead, strict=True))
    return before._replace(r=r, r_dot=r_dot, rr=rr, rv=rv, vv=vv)
