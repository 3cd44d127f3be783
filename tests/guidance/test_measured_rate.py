"""What the estimators make of a measured range rate, against textbook forms that stand in this file."""

from math import cos, hypot, sin

import numpy as np
import pytest

from circnav_mav import Direction, Guidance, Orbit
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_ekf import STATES, Hypotheses, Rates, update_rate
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.types import RangeSample, RateSample
from tests.guidance.test_relative_motion import WIND, Circling

V, TURN = 15.0, 0.35
SETTINGS = EstimatorSettings(V, TURN)


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
    wind = (0.0, 0.0) if name == "unicycle" else WIND

    def error(with_rates):
        rng, world, estimator, errors = np.random.default_rng(4), Circling(wind=wind), ESTIMATORS[name](SETTINGS), []
        for i in range(900):
            t = 0.05 * i
            estimator.move(world.motion(t))
            if i % 2 == 0:
                rate = (hypot(*world.offset(t + 1e-4)) - hypot(*world.offset(t - 1e-4))) / 2e-4
                measured = RateSample(t, t, rate + 0.1 * rng.normal(), 0.1)
                if with_rates and rate_first:
                    estimator.observe_rate(measured)
                estimator.observe(world.range(t))
                if with_rates and not rate_first:
                    estimator.observe_rate(measured)
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
