"""A user-defined estimator, entered in the table of estimators: filterpy's unscented Kalman filter
of range and range rate."""

from math import cos, hypot, sin, sqrt

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from circnav_mav import Direction, Guidance, Orbit
from circnav_mav.guidance.estimators.interface import Estimator
from circnav_mav.guidance.estimators.range_rate import acceleration_variance, motion_model
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RangeSample


class Unscented(Estimator):
    """State (r, r'), m and m/s. The measurements are r and, if the radio measures it, r'."""

    nis = None

    def __init__(self, settings):
        self._settings = settings
        self.reset()

    def reset(self):
        points = MerweScaledSigmaPoints(2, alpha=0.1, beta=2.0, kappa=1.0)
        self._filter = UnscentedKalmanFilter(2, 1, 1.0, lambda x: x[:1], _moved, points)
        self._time = None

    @property
    def ready(self):
        return self._time is not None and self._filter.P[1, 1] < self._settings.speed**2 / 4

    def observe(self, sample):
        if self._time is None:
            self._filter.x = np.array([sample.r, 0.0])
            self._filter.P = np.diag([sample.sigma**2, self._settings.speed**2 / 2])
            self._time = sample.time
        self._measure(sample.time, 0, sample.r, sample.sigma)
        if sample.rate is not None:
            self.observe_rate(sample.rate)
        return True

    def observe_rate(self, sample):
        self._measure(sample.time, 1, sample.r_dot, sample.sigma)

    def _measure(self, time, component, z, sigma):
        step = time - self._time
        variance = acceleration_variance(self._settings, self._filter.x[0])
        self._filter.Q = motion_model(step, variance)[1]
        self._filter.predict(dt=step)
        self._filter.update(z, R=sigma**2, hx=lambda x: x[[component]])
        self._time = time

    def at(self, time):
        if self._time is None:
            return None
        r, r_dot = _moved(self._filter.x, time - self._time)
        return RangeEstimate(time, r, r_dot, *(sqrt(one) for one in np.diag(self._filter.P)))


def _moved(x, dt):
    return np.array([x[0] + dt * x[1], x[1]])


@pytest.mark.parametrize("measures_rate", [False, True])
def test_user_estimator_in_table_flies_circle(monkeypatch, measures_rate):
    monkeypatch.setitem(ESTIMATORS, "unscented", Unscented)
    orbit = Orbit(80.0, Direction.COUNTERCLOCKWISE, 12.0, 0.4)
    guidance = Guidance(orbit, "feedforward", "unscented")
    rng = np.random.default_rng(1)
    x, y, heading, turn_rate = 200.0, 0.0, 2.0, 0.0
    for step in range(1400):
        now = 0.05 * step
        guidance.update_motion(OwnMotion(now, heading, turn_rate, orbit.speed))
        r = hypot(x, y)
        r_dot = orbit.speed * (x * cos(heading) + y * sin(heading)) / r
        rate = r_dot + rng.normal(0, 0.2) if measures_rate else None
        guidance.update_range(RangeSample(now, now, r + rng.normal(0, 0.3), 0.3, "", rate, 0.2))
        command = guidance.command(now)
        turn_rate = orbit.steady_turn_rate if command is None else command.turn_rate
        heading += 0.05 * turn_rate
        x += 0.05 * orbit.speed * cos(heading)
        y += 0.05 * orbit.speed * sin(heading)
    assert hypot(x, y) == pytest.approx(orbit.radius, abs=2.0)
