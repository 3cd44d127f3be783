"""The estimator `measured`, and the use of a measured range rate by all estimators."""

from math import hypot

import numpy as np
import pytest

from circnav_mav import Direction, Guidance, Orbit
from circnav_mav.guidance.estimators.relative_motion import DriftEstimator
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.types import RangeSample, RateSample
from tests.guidance.relative import (
    RADIUS,
    SETTINGS,
    WIND,
    Circling,
    V,
    converged,
    observe,
    still,
)


@pytest.mark.parametrize("rate_first", [True, False])
@pytest.mark.parametrize("name", ["kalman", "drift"])
def test_measured_range_rate_improves_every_estimator(name, rate_first):
    def error(with_rates):
        rng = np.random.default_rng(4)
        world = Circling(wind=WIND)
        estimator = ESTIMATORS[name](SETTINGS)
        errors = []
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


def test_estimator_measured_passes_range_and_rate_unfiltered():
    guidance = Guidance(Orbit(100.0, Direction.CLOCKWISE, V, 0.35), "smooth", "measured")
    guidance.update_range(RangeSample(1.0, 1.0, 150.0, 0.5))
    assert guidance.command(1.0) is None
    guidance.update_range(RangeSample(1.1, 1.1, 148.0, 0.5, r_dot=-9.0))
    assert (guidance.estimate(1.15).r, guidance.estimate(1.15).r_dot) == (148.0, -9.0)
    assert guidance.command(1.15) is not None
    for time in (1.2, 1.3):
        guidance.update_range(RangeSample(time, time, 147.0, 0.5))
        assert guidance.command(time) is not None
    assert guidance.estimate(1.2).r_dot == -9.0
    for i in range(1, 4):
        guidance.update_range(RangeSample(1.2 + i / 10, 1.2 + i / 10, 147.0, 0.5))
    assert guidance.command(1.5) is None  # the range rate is too old


def test_drift_estimate_stops_in_gap_of_own_motion():
    """The estimator predicts for less than 4 s without reports of own motion. The next range
    restarts the estimator."""
    world, estimator = converged(DriftEstimator, 30.0, still)
    assert estimator.ready and estimator.at(30.0) is not None
    for t in (34.0, 34.05, 34.1):
        estimator.move(world.motion(t))
        assert estimator.at(t) is None
    estimator.observe(world.range(34.1))
    assert not estimator.ready
    observe(estimator, world, 34.15, 65.0)
    assert estimator.ready
    assert estimator.at(64.95).r == pytest.approx(RADIUS, abs=1.0)
