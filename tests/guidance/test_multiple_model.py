"""The multiple-model filter keeps finite numbers, even if its ranges claim an impossible
accuracy."""

from copy import deepcopy
from math import hypot

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.multiple_model import MultipleModelFilter, Stage
from circnav_mav.guidance.estimators.relative_ekf import CLOSEST, KAPPA, LEFT, STATES, B, R, update
from circnav_mav.guidance.maths import chord
from tests.guidance.relative import hypothesis, noise

V = 15.0
TURN = 0.15
STEP = 0.05
WIND = (3.0, -2.0)
TARGET = (150.0, 80.0)
ROUNDING = 1e-9
"""Rounding error of an eigenvalue of a matrix whose diagonal is 1."""


class Flown:
    """A multiple-model filter and the vehicle that it observes, which turns steadily in the
    wind."""

    def __init__(self, flights=1):
        self.bank = MultipleModelFilter(EstimatorSettings(V, 0.35), flights)
        self.t = 0.0
        self.p = np.array(TARGET)

    def hear(self, dt, sigma, r=None, error=0.0, valid=True):
        """Fly on for dt (s) and observe a range of standard deviation sigma (m): r, or the true
        range plus its error (m)."""
        path = np.array(chord(V, TURN * self.t, TURN * dt, dt))
        self.t = self.t + dt
        self.p = self.p + path + dt * np.array(WIND)
        z = hypot(*self.p) + error if r is None else r
        all_ = np.ones(self.bank.stage.size)
        self.bank.step(dt * all_, path[:, None] * all_, z * all_, sigma * all_, valid * all_ > 0)

    def listen(self, seconds):
        """Observe ordinary ranges for some time."""
        rng = np.random.default_rng(0)
        for _ in range(round(seconds / STEP)):
            self.hear(STEP, 0.5, error=rng.normal(0, 0.5))
        return self

    @property
    def off(self):
        """Error of the estimated position, m."""
        r, theta = self.bank.mean[:2, 0]
        return hypot(*(r * np.array([np.cos(theta), np.sin(theta)]) - self.p))


@pytest.fixture(scope="module")
def tracking():
    flown = Flown().listen(25.0)
    assert flown.bank.stage[0] == Stage.TRACKING
    return flown


def test_a_track_begins_with_the_spread_of_what_the_search_does_not_show():
    """Half of the sigma for the drifting error of a range, 0.02 V for a gust, 0.2 m/s^2 for the
    accelerometer."""
    flown = Flown()
    while flown.bank.stage[0] != Stage.TRACKING:
        flown.hear(STEP, 0.5)
    spread = np.sqrt(np.diag(flown.bank.covariance[..., 0]))
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
def test_no_sequence_of_ranges_leaves_numbers_that_are_none_or_covariances_that_cannot_be(
    tracking, sequence
):
    flown = deepcopy(tracking)
    for one in sequence:
        flown.hear(*one)
        bank = flown.bank
        assert np.isfinite(bank.mean).all()
        assert np.isfinite(bank.covariance).all()
        x = bank.mean[:, 0]
        P = bank.covariance[..., 0]
        spread = (
            hypot(np.sqrt(P[R, R]) / x[R], np.sqrt(P[1, 1]))
            if bank.stage[0] == Stage.TRACKING
            else np.inf
        )
        assert bank.spread[0] == pytest.approx(spread)
        P = (
            np.moveaxis(bank._tracks.P[..., 0], -1, 0)
            if bank._tracks.P.size
            else np.eye(STATES)[None]
        )
        assert np.array_equal(P, P.swapaxes(1, 2))
        deviation = np.sqrt(np.einsum("nii->ni", P))
        deviation[deviation == 0] = 1.0  # noise of the nose, in models that use no acceleration
        assert (
            np.linalg.eigvalsh(P / deviation[:, :, None] / deviation[:, None, :]).min() > -ROUNDING
        )


@pytest.mark.parametrize("sigma", [4294967.294, 1e-4, 0.0])
def test_after_ranges_that_claim_what_none_can_the_target_is_known_again(tracking, sigma):
    """4294967.294 m is the largest range_accuracy that RANGING_BEACON can encode. The search may
    restart or not."""
    flown = deepcopy(tracking)
    for _ in range(200):
        flown.hear(STEP, sigma)
    flown.listen(30.0)
    assert flown.bank.trusted[0]
    assert flown.off < 5.0


@pytest.mark.parametrize("part", ["x", "P"])
def test_a_track_that_is_no_number_any_more_is_searched_anew_and_takes_no_other_flight_with_it(
    part,
):
    """Two flights in one filter receive the same ranges. The track of the first becomes nan."""
    broken = Flown(flights=2).listen(25.0)
    whole = Flown(flights=2).listen(25.0)
    assert (broken.bank.stage == Stage.TRACKING).all()
    getattr(broken.bank._tracks, part)[KAPPA, ..., 0] = np.nan
    for flown in (broken, whole):
        flown.hear(STEP, 0.5)
    assert broken.bank.stage.tolist() == [Stage.SEARCH, Stage.TRACKING]
    assert broken.bank.trusted.tolist() == [False, True]
    assert np.isfinite(broken.bank.mean).all() and np.isfinite(broken.bank.covariance).all()
    assert np.array_equal(broken.bank.mean[:, 1], whole.bank.mean[:, 1])
    assert np.array_equal(broken.bank.covariance[..., 1], whole.bank.covariance[..., 1])
    broken.listen(30.0)
    assert broken.bank.trusted.all()
    assert broken.off < 5.0


def test_a_variance_that_rounding_has_made_negative_is_none():
    """The range is much more accurate than the state: rounding can make the remaining variance
    slightly negative."""
    x = np.zeros(STATES)
    P = 1e-3 * np.eye(STATES)
    x[R] = 100.0
    x[KAPPA] = 1.0
    P[R, R] = -2e-9
    P[5, 5] = 1e-9
    one = np.array([100.0]), np.array([1e-6]), np.array([True])
    after, nis, _ = update(hypothesis(x, P), noise(1e-2, 0.0, 1.0, 0.0), *one, 5.0)
    assert np.isfinite(after.P).all() and np.isfinite(after.log_weight).all()
    assert nis[0, 0] >= 0.0
    assert after.x[R, 0, 0] >= CLOSEST


def test_what_steers_steers_on_until_it_is_much_worse_and_again_only_when_it_is_good(tracking):
    """Otherwise law changes follow rounding errors. PX4's copter around a moving target changed 29
    times in a flight."""
    flown = deepcopy(tracking)
    bank = flown.bank
    worst = 0.0
    while worst < 0.55:
        flown.hear(4 * STEP, 0.5, valid=False)
        worst = max(worst, bank.spread[0])
        assert bank.trusted[0] == (worst < 0.5)
    between = False
    for _ in range(200):
        flown.hear(STEP, 0.5)
        between |= 0.25 < bank.spread[0] < 0.5
        assert bank.stage[0] == Stage.TRACKING and bank.trusted[0] == (bank.spread[0] < 0.25)
        if bank.trusted[0]:
            break
    assert between and bank.trusted[0]
