"""Published laws and the published estimator on an ideal vehicle with exact ranges."""

from math import cos, hypot, pi, sin

import pytest

from circnav_mav.extras.bench.published_laws import SlidingMode, bounded, three_circles
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate, RangeSample

STEP = 0.01


def flown(law, x, heading, seconds=150.0):
    """Return the ranges of a vehicle that turns exactly as the law demands, with a start at (x, 0)
    and the target at (0, 0)."""
    y = 0.0
    ranges = []
    for step in range(round(seconds / STEP)):
        r = hypot(x, y)
        ranges.append(r)
        r_dot = 15.0 * (x * cos(heading) + y * sin(heading)) / r
        heading += STEP * law(RangeEstimate(step * STEP, r, r_dot, 0.0, 0.0))
        x += STEP * 15.0 * cos(heading)
        y += STEP * 15.0 * sin(heading)
    return ranges


@pytest.mark.parametrize("direction", Direction)
@pytest.mark.parametrize(("x", "heading"), [(400.0, pi), (120.0, pi), (90.0, 0.9 * pi), (55.0, pi)])
def test_three_circles_law_stays_outside_safety_circle(direction, x, heading):
    orbit = Orbit(100.0, direction, 15.0, 5.0)
    ranges = flown(three_circles(orbit), x, direction.turn_sign * heading)
    assert min(ranges) > 50.0
    assert ranges[-1] == pytest.approx(100.0, abs=0.5)
    assert min(flown(bounded(orbit), 55.0, pi)) < 50.0


def test_three_circles_law_leaves_safety_circle_from_inside():
    ranges = flown(three_circles(Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)), 20.0, 2.0)
    assert ranges[-1] == pytest.approx(100.0, abs=0.5)


def test_sliding_mode_estimator_finds_range_rate_without_noise():
    estimator = SlidingMode(EstimatorSettings(15.0, 0.35))
    errors = []
    for step in range(2000):
        now = step * STEP
        estimator.observe(RangeSample(now, now, 100.0 + 10.0 * sin(0.5 * now), 0.1))
        errors.append(abs(estimator.at(now).r_dot - 5.0 * cos(0.5 * now)))
    assert max(errors[500:]) < 0.3
    assert estimator.ready
    estimator.observe(RangeSample(25.0, 25.0, 300.0, 0.1))
    assert estimator.at(25.0).r == 300.0
