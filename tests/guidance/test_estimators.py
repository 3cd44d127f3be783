"""The estimators `unicycle` and `measured`, and the use of a measured range rate by all
estimators."""

from copy import deepcopy
from dataclasses import replace
from math import cos, hypot, pi

import numpy as np
import pytest

from circnav_mav import Direction, Guidance, Orbit
from circnav_mav.guidance.estimators.relative_motion import DriftEstimator
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.estimators.unicycle import UnicycleEstimator, UnicycleFilter
from circnav_mav.guidance.types import RangeSample, RateSample
from tests.guidance.relative import (
    RADIUS,
    SETTINGS,
    WIND,
    Circling,
    V,
    listen,
    listened,
    silent,
    still,
)


@pytest.mark.parametrize("rate_first", [True, False])
@pytest.mark.parametrize("name", ["kalman", "unicycle", "drift"])
def test_a_measured_rate_sharpens_every_estimate_before_or_after_its_range(name, rate_first):
    wind = (0.0, 0.0) if name == "unicycle" else WIND

    def error(with_rates):
        rng = np.random.default_rng(4)
        world = Circling(wind=wind)
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


def test_measured_is_the_paper_with_no_filter_in_between():
    guidance = Guidance(Orbit(100.0, Direction.CLOCKWISE, V, 0.35), "smooth", "measured")
    guidance.observe(RangeSample(1.0, 1.0, 150.0, 0.5))
    assert guidance.command(1.0) is None
    guidance.observe(RangeSample(1.1, 1.1, 148.0, 0.5, r_dot=-9.0))
    assert (guidance.estimate(1.15).r, guidance.estimate(1.15).r_dot) == (148.0, -9.0)
    assert guidance.command(1.15) is not None
    guidance.observe(RangeSample(1.2, 1.2, 147.0, 0.5))
    assert guidance.estimate(1.2).r_dot == -9.0
    for i in range(1, 4):
        guidance.observe(RangeSample(1.2 + i / 10, 1.2 + i / 10, 147.0, 0.5))
    assert guidance.command(1.5) is None  # the rate is old


@pytest.mark.parametrize("make", [DriftEstimator, UnicycleEstimator])
def test_where_it_went_in_a_hole_of_its_own_motion_nobody_guesses(make):
    """For four seconds no motion is reported: nothing is predicted over them, and the next range
    restarts the estimator."""
    world, estimator = listened(make, 30.0, still)
    assert estimator.ready and estimator.at(30.0) is not None
    for t in (34.0, 34.05, 34.1):
        estimator.move(world.motion(t))
        assert estimator.at(t) is None
    estimator.observe(world.range(34.1))
    assert not estimator.ready
    listen(estimator, world, 34.15, 65.0)
    assert estimator.ready
    assert estimator.at(64.95).r == pytest.approx(RADIUS, abs=1.0)


def test_unicycle_knows_the_angle_to_the_target_in_still_air():
    world = Circling(wind=(0.0, 0.0))
    estimator = UnicycleEstimator(SETTINGS)
    listen(estimator, world, 0.0, 15.0)
    x, y = world.offset(14.95)
    true = (np.arctan2(-y, -x) - world.heading(14.95) + pi) % (2 * pi) - pi
    assert estimator.ready
    assert estimator.at(14.95).eta == pytest.approx(true, abs=0.05)
    assert estimator.at(14.95).r_dot == pytest.approx(-V * cos(true), abs=0.5)


@pytest.mark.parametrize("measured", ["range", "rate"])
def test_both_hypotheses_of_unicycle_are_textbook_filters_of_the_exact_motion(measured):
    """The target in body axes, moved by the chord and turned, with Jacobians by differences."""
    dt = 0.1
    turned = 0.03
    one = np.array([True])
    unicycle = UnicycleFilter(5.0)

    def moved(x):
        place = (x[0] * np.exp(1j * x[1]) - V * dt * np.exp(0.5j * turned)) * np.exp(-1j * turned)
        return np.array([abs(place), np.angle(place)])

    def expected(x):
        return x[0] if measured == "range" else -V * np.cos(x[1])

    def derivatives(function, x):
        return np.array([(function(x + h) - function(x - h)) / 2e-6 for h in 1e-6 * np.eye(2)]).T

    unicycle.update(np.array([100.0]), np.array([0.5]), one)
    unicycle.predict(np.array([V]), np.array([turned]), dt)
    predicted = deepcopy(unicycle)
    likelihood = []
    z, sigma = (
        (np.array([101.0]), np.array([0.4]))
        if measured == "range"
        else (np.array([2.0]), np.array([0.3]))
    )
    if measured == "range":
        unicycle.update(z, sigma, one)
    else:
        unicycle.update_rate(z, sigma, np.array([V]), one)
    for side, eta in enumerate((pi / 2, -pi / 2)):
        x = np.array([100.0, eta])
        F = derivatives(moved, x)
        x = moved(x)
        P = F @ np.diag([0.25, 1.0]) @ F.T + np.diag([0.05**2, 0.03**2]) * dt
        assert predicted.x[:, side, 0] == pytest.approx(x, abs=2e-3)
        assert predicted.P[..., side, 0] == pytest.approx(P, rel=0.01, abs=1e-3)
        x = predicted.x[:, side, 0]
        P = predicted.P[..., side, 0]
        H = derivatives(expected, x)
        nu = z[0] - expected(x)
        S = H @ P @ H + sigma[0] ** 2
        assert unicycle.x[:, side, 0] == pytest.approx(x + P @ H / S * nu, abs=1e-6)
        assert unicycle.P[..., side, 0] == pytest.approx(P - np.outer(P @ H, P @ H) / S, abs=1e-6)
        likelihood.append(-0.5 * nu**2 / S - 0.5 * np.log(S))
    assert np.diff(unicycle.log_weight[:, 0]) == pytest.approx(np.diff(likelihood), abs=1e-6)
    assert unicycle.likelier[0][1, 0] == unicycle.x[1, np.argmax(likelihood), 0]


@pytest.mark.parametrize("gap", [15.0, 60.0])
def test_after_a_gap_in_which_it_may_have_turned_anywhere_unicycle_is_ready_only_when_it_knows_the_angle_again(
    gap,
):
    """On its circle the range returns to its value at any assumed angle."""
    world, estimator = listened(UnicycleEstimator, 30.0, still)
    silent(estimator, world, 30.0, 30.0 + gap)
    errors = []
    for t in np.arange(30.0 + gap, 45.0 + gap, 0.05):
        listen(estimator, world, t, t + 0.04)
        if estimator.ready:
            errors.append(abs(estimator.at(float(t)).r_dot))
    assert len(errors) > 200
    assert max(errors) < 5.0


def test_unicycle_lives_on_a_slow_radio_while_the_vehicle_turns_slowly():
    """A range every 2.5 s, longer than a quarter turn at the limit takes, on a circle of 62 s per
    lap."""
    world = still()
    estimator = UnicycleEstimator(replace(SETTINGS, max_turn_rate=0.7))
    for step in range(1200):
        estimator.move(world.motion(0.05 * step))
        if step % 50 == 0:
            estimator.observe(world.range(0.05 * step))
    assert estimator.filter.samples == 24, "it never began anew"
    assert estimator.ready
