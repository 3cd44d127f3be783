"""The tracker keeps finite numbers, even if the reported sigma of its ranges is
impossible."""

from copy import deepcopy
from math import asin, cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_ekf import (
    CLOSEST,
    KAPPA,
    LEFT,
    STATES,
    B,
    R,
    VelocityChange,
    range_measurement,
    update,
)
from circnav_mav.guidance.estimators.relative_filter import RelativeFilter
from circnav_mav.guidance.maths import chord
from tests.guidance.relative import hypothesis, noise

V = 15.0
TURN = 0.15
STEP = 0.05
WIND = (3.0, -2.0)
TARGET = (150.0, 80.0)
ROUNDING = 1e-9
"""Largest rounding error of an eigenvalue of a correlation matrix."""


class Flown:
    """A relative-motion filter and the vehicle that it observes, which turns steadily in the
    wind."""

    def __init__(self):
        self.filter = RelativeFilter(EstimatorSettings(V, 0.35))
        self.t = 0.0
        self.p = np.array(TARGET)

    def observe(self, dt, sigma, r=None, error=0.0, valid=True):
        """Fly for dt (s), then pass a range with the reported standard deviation sigma (m) to the
        filter. The range is r, or the true range plus an error (m)."""
        path = np.array(chord(V, TURN * self.t, TURN * dt, dt))
        self.t = self.t + dt
        self.p = self.p + path + dt * np.array(WIND)
        z = hypot(*self.p) + error if r is None else r
        self.filter.observe(dt, path, z if valid else None, sigma)
        self.filter.search()

    def observe_for(self, seconds):
        """Pass ranges with valid sigma to the filter for some time."""
        rng = np.random.default_rng(0)
        for _ in range(round(seconds / STEP)):
            self.observe(STEP, 0.5, error=rng.normal(0, 0.5))
        return self

    @property
    def off(self):
        """Error of the estimated position, m."""
        r, theta = self.filter.estimate.mean[:2]
        return hypot(*(r * np.array([np.cos(theta), np.sin(theta)]) - self.p))


@pytest.fixture(scope="module")
def tracking():
    flown = Flown().observe_for(25.0)
    assert flown.filter.tracker
    return flown


def test_tracking_starts_with_prior_sigma_of_unobserved_states():
    """Expected prior sigma: 0.25 m for the slow range error (half of the range sigma), 0.3 m/s
    (0.02 V) for a gust, and 0.2 m/s^2 for the accelerometer bias."""
    flown = Flown()
    while not flown.filter.tracker:
        flown.observe(STEP, 0.5)
    spread = np.sqrt(np.diag(flown.filter.estimate.covariance))
    assert spread[B : LEFT + 1] == pytest.approx([0.25, 0.3, 0.3, 0.2, 0.2])


received = st.lists(
    st.tuples(
        st.one_of(st.just(STEP), st.floats(-3, 1.3).map(lambda power: 10**power)),
        st.one_of(
            st.sampled_from([0.0, 1e-4, 0.5, 1e7, 4294967.294]),
            st.floats(-12, 12).map(lambda power: 10**power),
        ),
        st.one_of(st.none(), st.floats(0.0, 1e6)),
        st.floats(-5, 5),
    ),
    min_size=1,
    max_size=60,
)


@given(received)
def test_filter_state_stays_finite_and_covariance_valid(tracking, sequence):
    flown = deepcopy(tracking)
    for one in sequence:
        flown.observe(*one)
        estimate = flown.filter.estimate
        if estimate is None:
            continue
        x = estimate.mean
        P = estimate.covariance
        assert estimate.finite
        if flown.filter.tracker is None:
            assert estimate.spread == np.inf
            continue
        assert estimate.spread == pytest.approx(hypot(np.sqrt(P[R, R]) / x[R], np.sqrt(P[1, 1])))
        P = flown.filter.tracker.tracks.P
        assert np.array_equal(P, P.swapaxes(1, 2))
        deviation = np.sqrt(np.einsum("nii->ni", P))
        deviation[deviation == 0] = (
            1.0  # a variance is 0 in models without accelerations: the accelerometer's error
        )
        assert (
            np.linalg.eigvalsh(P / deviation[:, :, None] / deviation[:, None, :]).min() > -ROUNDING
        )


@pytest.mark.parametrize("sigma", [4294967.294, 1e-4, 0.0])
def test_filter_finds_target_after_ranges_with_impossible_sigma(tracking, sigma):
    """4294967.294 m is the largest range_accuracy that RANGING_BEACON can encode. The filter may
    restart its search meanwhile."""
    flown = deepcopy(tracking)
    for _ in range(200):
        flown.observe(STEP, sigma)
    flown.observe_for(30.0)
    assert flown.filter.trusted
    assert flown.off < 5.0


@pytest.mark.parametrize("part", ["x", "P"])
def test_filter_with_nan_state_restarts_search(part, tracking):
    flown = deepcopy(tracking)
    getattr(flown.filter.tracker.tracks, part)[:, KAPPA] = np.nan
    flown.observe(STEP, 0.5)
    assert flown.filter.estimate.hypothesis is not None
    assert not flown.filter.trusted
    assert flown.filter.estimate.finite
    flown.observe_for(30.0)
    assert flown.filter.trusted
    assert flown.off < 5.0


def test_kalman_update_tolerates_negative_variance_from_rounding():
    """If a range is much more accurate than the predicted state, rounding can make the remaining
    variance slightly negative."""
    x = np.zeros(STATES)
    P = 1e-3 * np.eye(STATES)
    x[R] = 100.0
    x[KAPPA] = 1.0
    P[R, R] = -2e-9
    P[5, 5] = 1e-9
    before = hypothesis(x, P)
    assumed = noise(1e-2, 0.0, 1.0, 0.0)
    after, nis, _ = update(before, assumed, range_measurement(before, assumed, 100.0, 1e-6), 5.0)
    assert np.isfinite(after.P).all() and np.isfinite(after.log_weight).all()
    assert nis[0] >= 0.0
    assert after.x[0, R] >= CLOSEST


def test_trust_in_relative_motion_has_hysteresis(tracking):
    """Trust begins below a relative sigma of 0.25 and ends at 0.5. Without hysteresis, small
    changes of sigma change the law: PX4's copter around a moving target changed it 29 times in a
    flight."""
    flown = deepcopy(tracking)
    worst = 0.0
    while worst < 0.55:
        flown.observe(4 * STEP, 0.5, valid=False)
        worst = max(worst, flown.filter.estimate.spread)
        assert flown.filter.trusted == (worst < 0.5)
    assert flown.filter.tracker is not None
    between = False
    for _ in range(200):
        flown.observe(STEP, 0.5)
        spread = flown.filter.tracker.estimate.spread
        between |= 0.25 < spread < 0.5
        assert flown.filter.trusted == (spread < 0.25)
        if flown.filter.trusted:
            break
    assert between and flown.filter.trusted


def test_search_begins_again_when_position_is_uncertain(tracking):
    flown = deepcopy(tracking)
    spread = 0.0
    while flown.filter.tracker is not None:
        spread = flown.filter.estimate.spread
        flown.observe(4 * STEP, 0.5, valid=False)
    assert 0.55 < spread < 0.65


def test_tracker_keeps_airspeed_scale_when_wind_turns():
    """The plane stays on its circle. The wind of 3 m/s from the north becomes 9 m/s from the east
    within 3 s. The nose swings by 1.7 deg at 0.85 Hz while the path is smooth: ArduPlane's roll
    loop rings at this frequency, and a roll turns the nose. To models that use accelerations, a
    wrong airspeed scale explains such a swing."""
    airspeed = 22.0
    radius = 150.0
    scale = 1.03
    dt = 0.1
    rng = np.random.default_rng(1)
    filter_ = RelativeFilter(EstimatorSettings(airspeed, 0.44))
    direction = 0.0
    before = None
    scales = []
    for t in np.arange(0.0, 165.0, dt):
        turned = np.clip((t - 90.0) / 3.0, 0.0, 1.0)
        wind = np.array((-9.0 * turned, -3.0 * (1 - turned)))
        course = direction - pi / 2
        along = np.array((cos(course), sin(course)))
        crab = asin((along[0] * wind[1] - along[1] * wind[0]) / (scale * airspeed))
        speed = scale * airspeed * cos(crab) + along @ wind
        nose = course - crab + 0.03 * sin(2 * pi * 0.85 * t)
        air = airspeed * np.array((cos(nose), sin(nose)))
        velocity = speed * along + rng.normal(0, 0.03, 2)
        if before is not None:
            mean = (air + before[1]) / 2
            change = VelocityChange(
                velocity - before[0],
                air - before[1],
                mean * dt / airspeed,
                airspeed * (nose - before[2]) / dt,
            )
            filter_.observe(dt, mean * dt, radius + rng.normal(0, 0.5), 0.5, change)
            filter_.search()
        before = velocity, air, nose
        direction -= speed * dt / radius
        if t > 60.0:
            scales.append(filter_.estimate.mean[KAPPA])
    assert scales == pytest.approx([scale] * len(scales), abs=0.01)
