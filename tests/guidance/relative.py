"""Helpers of the guidance tests.

By default a vehicle flies at 15 m/s, 100 m east of the target, and its relative motion is trusted.
`hypothesis` builds a single hypothesis for the multiple-model filter. `Circling` turns steadily in
wind, and estimators receive its ranges and motion.
"""

from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache, partial
from math import cos, hypot, pi, sin

import numpy as np

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_ekf import Hypotheses, Noise
from circnav_mav.guidance.estimators.relative_motion import DriftEstimator
from circnav_mav.guidance.types import OwnMotion, RangeSample, RelativeMotion

V = 15.0
OMEGA = 0.15
WIND = (3.0, -2.0)
SETTINGS = EstimatorSettings(speed=V, max_turn_rate=0.35)
RADIUS = V / OMEGA

known = partial(
    RelativeMotion,
    x=100.0,
    y=0.0,
    sigma=1.0,
    drift_x=0.0,
    drift_y=0.0,
    heading=0.0,
    turn_rate=0.0,
    airspeed=15.0,
    scale=1.0,
    trusted=True,
)
untrusted = partial(known, trusted=False, trial=4)


def hypothesis(x, P):
    """Return a filter state of one hypothesis, with mean (12,) and covariance (12, 12)."""
    return Hypotheses(np.array(x)[None], P[None], np.zeros(1))


def noise(psd, gust, white, drifting, nose=0.0, acceleration_weight=0.0):
    """Return the noise that one hypothesis assumes."""
    values = (psd, gust, white, drifting, nose, acceleration_weight)
    arrays = (np.array([value]) for value in values)
    return Noise(*arrays, SETTINGS.scale_bounds)


@dataclass
class Circling:
    """A vehicle that turns at a constant rate and drifts with the wind, so its circle is not around
    the target. A test may move the target at once."""

    target: tuple[float, float] = (150.0, 80.0)
    wind: tuple[float, float] = WIND
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(3))

    def heading(self, t):
        return OMEGA * t

    def offset(self, t):
        x = RADIUS * sin(OMEGA * t) + self.wind[0] * t - self.target[0]
        y = RADIUS * (1 - cos(OMEGA * t)) + self.wind[1] * t - self.target[1]
        return x, y

    def range(self, t, sigma=0.5):
        return RangeSample(t, t, hypot(*self.offset(t)) + self.rng.normal(0, sigma), sigma)

    def motion(self, t):
        return OwnMotion(t, (self.heading(t) + pi) % (2 * pi) - pi, OMEGA, V)


def observe(estimator, world, start, end, every=0.05, motion_every=0.05, motion_delay=0.0):
    """Pass ranges and own motion to the estimator until `end` (s), each at its own rate. Own motion
    arrives `motion_delay` s late."""
    events = [(t, "range") for t in np.arange(start, end, every)]
    events += [(t + motion_delay, "motion") for t in np.arange(start, end, motion_every)]
    for t, kind in sorted(events, key=lambda event: (event[0], event[1] == "range")):
        if kind == "range":
            estimator.observe(world.range(float(t)))
        else:
            estimator.move(world.motion(float(t - motion_delay)))


def error(estimator, world, t):
    relative = estimator.at(t).relative
    x, y = world.offset(t)
    return hypot(relative.x - x, relative.y - y)


@cache
def _converged(make, seconds, world):
    there = world()
    estimator = make(SETTINGS)
    observe(estimator, there, 0.0, seconds)
    return there, estimator


def converged(make=DriftEstimator, seconds=30.0, world=Circling):
    """Return a world and an estimator that has observed it for some seconds."""
    return deepcopy(_converged(make, seconds, world))


def move_only(estimator, world, start, end):
    """Pass own motion to the estimator, but no ranges."""
    for t in np.arange(start, end, 0.05):
        estimator.move(world.motion(t))


def still():
    """Return a world without wind. Its vehicle is on the circle, at constant range."""
    return Circling(target=(0.0, RADIUS), wind=(0.0, 0.0))
