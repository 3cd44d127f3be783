"""What the estimators make of a measured range rate, against textbook forms that stand in this file."""

from math import cos, hypot, sin

import numpy as np
import pytest

from circnav_mav import Direction, Guidance, Orbit
from circnav_mav.experiments.batch.estimators import Kalman, Seen
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.estimators.relative_ekf import STATES, Hypotheses, Rates, update_rate
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.types import OwnMotion, RangeSample, RateSample
from tests.guidance.test_range_rate import MatrixKalman

V, TURN = 15.0, 0.35
SETTINGS = EstimatorSettings(V, TURN)


class Circling:
    """A vehicle on a circle of 100 m round the origin in wind, heading and airspeed as reported."""

    def __init__(self, wind=(3.0, -2.0)):
        self.wind, self.turn = wind, V / 100.0

    def motion(self, t):
        return OwnMotion(t, self.turn * t, self.turn, V)

    def at(self, t):
        """Range and range rate: the air path is a circle, and the wind adds its way."""
        x = 140.0 + V / self.turn * sin(self.turn * t) + self.wind[0] * t
        y = -80.0 - V / self.turn * cos(self.turn * t) + self.wind[1] * t
        vx, vy = V * cos(self.turn * t) + self.wind[0], V * sin(self.turn * t) + self.wind[1]
        return hypot(x, y), (x * vx + y * vy) / hypot(x, y)


def test_the_kalman_filter_takes_rates_as_its_matrix_form_does():
    chance, kalman = np.random.default_rng(1), KalmanRangeRate(SETTINGS)
    kalman.observe_rate(RateSample(0.0, 0.0, 5.0, 0.1))  # before any range it is nothing
    assert kalman.at(0.0) is None
    kalman.observe(RangeSample(0.0, 0.0, 300.0, 0.5))
    reference, t = MatrixKalman(300.0, 0.5), 0.0
    for i in range(200):
        step = float(chance.uniform(0.02, 0.1))
        t += step
        r, rate = 300.0 - 6.0 * t + 0.3 * chance.normal(), -6.0 + 0.3 * chance.normal()
        if i % 3:
            kalman.observe_rate(RateSample(t, t, rate, 0.3))
            reference.H = np.array([[0.0, 1.0]])
            reference.step(step, rate, 0.3)
        else:
            kalman.observe(RangeSample(t, t, r, 0.5))
            reference.H = np.array([[1.0, 0.0]])
            reference.step(step, r, 0.5)
        assert (kalman.at(t).r, kalman.at(t).r_dot) == pytest.approx(tuple(reference.x), rel=1e-6, abs=1e-6)
        assert kalman.at(t).r_dot_sigma == pytest.approx(float(np.sqrt(reference.P[1, 1])), rel=1e-5)
    kalman.observe_rate(RateSample(t + 0.1, t + 0.1, 40.0, 0.3))  # an outlier
    assert kalman.at(t + 0.1).r_dot == pytest.approx(-6.0, abs=0.5)


def test_many_flights_take_rates_as_the_one_in_the_air_does():
    chance, alone, many = np.random.default_rng(2), KalmanRangeRate(SETTINGS), Kalman(SETTINGS, 3)
    for i in range(100):
        t, r, rate = 0.05 * i, 200 - 0.3 * i + chance.normal(), -6.0 + 0.1 * chance.normal()
        alone.observe(RangeSample(t, t, r, 0.5, r_dot=rate, r_dot_sigma=0.2))
        all_, zero = np.ones(3, bool), np.zeros(3)
        seen = Seen(0.05 if i else 0.0, zero, zero, zero, zero + r, zero + 0.5, all_, all_, rate=(zero + rate, 0.2))
        many.observe(seen, None)
        assert (many.r[1], many.r_dot[1]) == pytest.approx((alone.at(t).r, alone.at(t).r_dot), abs=1e-9)


def test_a_rate_corrects_the_relative_motion_by_the_derivatives_of_its_equation():
    """h(x) = n.(kappa V u + d + g + e), its Jacobian by differences; textbook update in full matrices."""
    chance = np.random.default_rng(3)
    x = chance.normal(size=STATES) * 0.3 + np.array([120.0, 0.7, 2.0, -1.0, 1.0, *[0.0] * 7])
    root = 0.1 * chance.normal(size=(STATES, STATES))
    P, air = root @ root.T, np.array([9.0, 12.0])

    def h(x):
        return np.array([cos(x[1]), sin(x[1])]) @ (x[4] * air + x[2:4] + x[6:8] + x[10:12])

    H = np.array([(h(x + 1e-6 * unit) - h(x - 1e-6 * unit)) / 2e-6 for unit in np.eye(STATES)])
    S, z = H @ P @ H + 0.3**2, h(x) + 0.4
    rates = Rates(np.array([z]), np.array([0.3]), np.array([True]), air[:, None])
    after = update_rate(Hypotheses(x[:, None, None], P[:, :, None, None], np.zeros((1, 1))), rates, 5.0)
    assert after.x[:, 0, 0] == pytest.approx(x + P @ H / S * 0.4, abs=1e-6)
    assert after.P[:, :, 0, 0] == pytest.approx(P - np.outer(P @ H, H @ P) / S, abs=1e-7)


@pytest.mark.parametrize("rate_first", [True, False])
@pytest.mark.parametrize("name", ["kalman", "unicycle", "drift"])
def test_a_measured_rate_sharpens_every_estimate_before_or_after_its_range(name, rate_first):
    wind = (0.0, 0.0) if name == "unicycle" else (3.0, -2.0)

    def error(with_rates):
        chance, world, estimator, errors = np.random.default_rng(4), Circling(wind), ESTIMATORS[name](SETTINGS), []
        for i in range(900):
            t = 0.05 * i
            estimator.move(world.motion(t))
            if i % 2 == 0:
                r, rate = world.at(t)
                range_, r_dot = r + 0.5 * chance.normal(), rate + 0.1 * chance.normal()
                if with_rates and rate_first:
                    estimator.observe_rate(RateSample(t, t, r_dot, 0.1))
                estimator.observe(RangeSample(t, t, range_, 0.5))
                if with_rates and not rate_first:
                    estimator.observe_rate(RateSample(t, t, r_dot, 0.1))
                if t > 25.0:
                    errors.append(estimator.at(t).r_dot - rate)
        return float(np.sqrt(np.mean(np.square(errors))))

    assert error(True) < (0.5 if name == "kalman" else 0.97) * error(False)


def test_measured_is_the_paper_with_no_filter_in_between():
    guidance = Guidance(Orbit(100.0, Direction.CLOCKWISE, V, TURN), "smooth", "measured")
    guidance.observe(RangeSample(1.0, 1.0, 150.0, 0.5))
    assert guidance.command(1.0) is None
    guidance.observe(RangeSample(1.1, 1.1, 148.0, 0.5, r_dot=-9.0))
    assert (guidance.estimate(1.15).r, guidance.estimate(1.15).r_dot) == (148.0, -9.0)
    assert guidance.command(1.15) is not None
    for i in range(4):
        guidance.observe(RangeSample(1.2 + i / 10, 1.2 + i / 10, 147.0, 0.5))
    assert guidance.command(1.5) is None  # the rate is old
