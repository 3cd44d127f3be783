"""What the estimators make of a measured range rate."""

from math import hypot

import numpy as np
import pytest

from circnav_mav import Direction, Guidance, Orbit
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.types import RangeSample, RateSample
from tests.guidance.test_relative_motion import WIND, Circling

V, TURN = 15.0, 0.35
SETTINGS = EstimatorSettings(V, TURN)


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
