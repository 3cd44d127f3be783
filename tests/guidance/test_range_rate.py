"""The range-rate filter, which is filterpy's in flight, against a matrix-form one that stands in this file."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest

from circnav_mav.guidance.estimators.interface import EstimatorSettings, Fused
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate, RangeRate, observe, steady_state
from circnav_mav.guidance.types import RangeSample

V, TURN = 15.0, 0.35
SETTINGS = EstimatorSettings(speed=V, max_turn_rate=TURN)
EPOCH = 1_700_000_000.0
"""The sensor's clock, far from the local one: only its differences may count."""


def sample(t, r, sigma=0.5, epoch=EPOCH):
    return RangeSample(stamp=epoch + t, time=t, r=r, sigma=sigma)


def settled(r=300.0, r_dot=-6.0, sigma=0.5, count=60, period=0.1):
    """A filter that has seen a straight run of ideal ranges; and the time of the last."""
    kalman = KalmanRangeRate(SETTINGS)
    for i in range(count):
        assert kalman.observe(sample(i * period, r + r_dot * i * period, sigma)) is Fused.ACCEPTED
    return kalman, (count - 1) * period


class MatrixKalman:
    """The textbook: predict with F, Q; update with H, R. The acceleration's deviation is a third of V^2/r + V w."""

    H = np.array([[1.0, 0.0]])

    def __init__(self, first, sigma):
        self.x, self.P = np.array([first, 0.0]), np.diag([sigma**2, V**2 / 2])

    def step(self, dt, z, sigma):
        bound = V**2 / max(self.x[0], V / TURN) + V * TURN
        G = np.array([[dt**2 / 2], [dt]])
        F = np.array([[1.0, dt], [0.0, 1.0]])
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + (bound / 3) ** 2 * (G @ G.T)
        S = self.H @ self.P @ self.H.T + sigma**2
        innovation = z - self.H @ self.x
        K = self.P @ self.H.T @ np.linalg.inv(S)
        self.x = self.x + K @ innovation
        self.P = (np.eye(2) - K @ self.H) @ self.P
        return float(innovation[0] ** 2 / S[0, 0])


def flight(seed, count, period=0.1):
    """A vehicle that flies past and then round a target: true (t, r, r') with uneven steps."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, count) * period)
    x, y = -400 + V * t, 120 + 10 * np.sin(t / 5)
    r = np.hypot(x, y)
    return rng, t, r, (x * V + y * 2 * np.cos(t / 5)) / r


def test_the_filter_agrees_with_the_matrix_form_over_uneven_steps_and_noises():
    rng, t, r, _ = flight(1, 400)
    sigmas = rng.uniform(0.2, 2.0, len(t))
    z = r + sigmas * rng.standard_normal(len(t))
    kalman, reference = KalmanRangeRate(SETTINGS), MatrixKalman(z[0], sigmas[0])
    kalman.observe(sample(t[0], z[0], sigmas[0]))
    for (before, now), value, sigma in zip(pairwise(t), z[1:], sigmas[1:], strict=True):
        assert kalman.observe(sample(now, value, sigma)) is Fused.ACCEPTED
        nis = reference.step(now - before, value, sigma)
        estimate = kalman.at(now)
        assert (estimate.r, estimate.r_dot) == pytest.approx(tuple(reference.x), rel=1e-6, abs=1e-6)
        assert (estimate.r_sigma, estimate.r_dot_sigma) == pytest.approx(tuple(np.sqrt(np.diag(reference.P))), rel=1e-5)
        assert kalman.nis == pytest.approx(nis, rel=1e-3, abs=1e-6)


def test_the_filter_starts_at_the_sample_with_the_rate_of_an_unknown_bearing():
    """E[V^2 cos^2(theta_b)] over all bearings is V^2/2."""
    kalman = KalmanRangeRate(SETTINGS)
    assert kalman.at(0.0) is None
    assert kalman.observe(sample(3.0, 250.0, 0.7)) is Fused.ACCEPTED
    estimate = kalman.at(3.0)
    assert (estimate.r, estimate.r_dot) == (250.0, 0.0)
    assert (estimate.r_sigma, estimate.r_dot_sigma) == pytest.approx((0.7, V / 2**0.5))
    assert kalman.nis is None
    assert not kalman.ready


def test_the_normalised_innovation_is_chi_square_when_the_truth_is_the_model():
    """Random accelerations of a third of the bound, constant over each step: NIS has mean 1, and 5 % of it lies above
    3.84. 4000 samples: the mean's own deviation is 0.022."""
    rng = np.random.default_rng(2)
    period, sigma, r, r_dot = 0.1, 0.5, 50_000.0, 0.0
    acceleration = (V**2 / r + V * TURN) / 3
    kalman, nis = KalmanRangeRate(EstimatorSettings(V, TURN, gate=20)), []
    for i in range(4000):
        kalman.observe(sample(i * period, r + sigma * rng.standard_normal(), sigma))
        if i > 20:
            nis.append(kalman.nis)
        a = acceleration * rng.standard_normal()
        r, r_dot = r + r_dot * period + a * period**2 / 2, r_dot + a * period
    assert np.mean(nis) == pytest.approx(1.0, abs=0.07)
    assert np.mean(np.array(nis) > 3.84) == pytest.approx(0.05, abs=0.012)


@pytest.mark.parametrize("ahead", [0.0, 0.05, 0.4])
def test_the_estimate_ahead_of_the_newest_sample_is_a_straight_line(ahead):
    kalman, last = settled()
    now = kalman.at(last)
    later = kalman.at(last + ahead)
    assert later.time == last + ahead
    assert later.r == pytest.approx(now.r + now.r_dot * ahead, rel=1e-12)
    assert later.r_dot == now.r_dot == pytest.approx(-6.0, abs=0.05)
    assert (later.r_sigma > now.r_sigma) == (ahead > 0)


def test_the_uncertainty_ahead_is_the_one_a_prediction_step_has():
    kalman, last = settled()
    reference = MatrixKalman(300.0, 0.5)
    for i in range(1, 60):
        reference.step(0.1, 300.0 - 6.0 * 0.1 * i, 0.5)
    reference.step(0.4, 0.0, 1e9)  # a measurement worth nothing: a prediction of 0.4 s
    later = kalman.at(last + 0.4)
    assert (later.r_sigma, later.r_dot_sigma) == pytest.approx(tuple(np.sqrt(np.diag(reference.P))), rel=1e-6)


def test_a_moment_before_the_newest_sample_is_answered_with_the_newest_state():
    kalman, last = settled()
    assert kalman.at(last - 1.0).r == kalman.at(last).r


def test_arrival_jitter_costs_nothing_when_the_stamps_are_right():
    steady, jittery = KalmanRangeRate(SETTINGS), KalmanRangeRate(SETTINGS)
    rng = np.random.default_rng(5)
    for i in range(50):
        r = 200 - 0.5 * i
        steady.observe(sample(0.1 * i, r))
        jittery.observe(RangeSample(stamp=EPOCH + 0.1 * i, time=0.1 * i + rng.uniform(0, 0.05), r=r, sigma=0.5))
    assert jittery.at(0).r_dot == steady.at(0).r_dot


@pytest.mark.parametrize("off", [20.0, -20.0])
def test_an_outlier_stays_outside_and_moves_nothing(off):
    kalman, last = settled()
    expected = kalman.at(last + 0.1)
    assert kalman.observe(sample(last + 0.1, expected.r + off)) is Fused.GATED
    assert kalman.at(last + 0.1).r == pytest.approx(expected.r, abs=1e-6)
    assert kalman.at(last + 0.1).r_dot == expected.r_dot
    assert kalman.nis > SETTINGS.gate**2
    assert kalman.ready


@pytest.mark.parametrize(("sigmas", "fused"), [(4.99, Fused.ACCEPTED), (5.01, Fused.GATED), (-5.01, Fused.GATED)])
def test_the_gate_stands_at_its_number_of_standard_deviations(sigmas, fused):
    """Innovation variance = predicted range variance + measurement variance, at the moment of the sample."""
    kalman, last = settled()
    ahead = kalman.at(last + 0.1)
    deviation = (ahead.r_sigma**2 + 0.5**2) ** 0.5
    assert kalman.observe(sample(last + 0.1, ahead.r + sigmas * deviation)) is fused


def test_scattered_outliers_never_restart_the_filter():
    kalman, last = settled()
    for i in range(1, 40):
        t = last + 0.1 * i
        assert kalman.observe(sample(t, 900.0 if i % 2 else 5.0)) is Fused.GATED
    assert kalman.ready


def test_a_real_jump_restarts_the_filter_after_five_samples_that_agree():
    kalman, last = settled()
    answers = [kalman.observe(sample(last + 0.1 * i, 900.0 - 0.6 * i)) for i in range(1, 6)]
    assert answers == [Fused.GATED] * 4 + [Fused.RESTARTED]
    assert kalman.at(last + 0.5).r == pytest.approx(897.0)
    assert not kalman.ready, "a restarted filter knows no rate yet"
    for i in range(6, 20):
        assert kalman.observe(sample(last + 0.1 * i, 900.0 - 0.6 * i)) is Fused.ACCEPTED
    assert kalman.ready
    assert kalman.at(last + 1.9).r_dot == pytest.approx(-6.0, abs=1.0)


def test_a_good_sample_between_two_runs_of_outliers_forgets_the_first_run():
    kalman, last = settled()
    for i in range(1, 5):
        assert kalman.observe(sample(last + 0.1 * i, 900.0)) is Fused.GATED
    assert kalman.observe(sample(last + 0.5, kalman.at(last + 0.5).r)) is Fused.ACCEPTED
    for i in range(6, 10):
        assert kalman.observe(sample(last + 0.1 * i, 900.0)) is Fused.GATED


def test_time_passes_while_samples_are_refused():
    """The state is carried through the refused samples: after a second at -6 m/s the range is 6 m less."""
    kalman, last = settled()
    before = kalman.at(last).r
    for i in range(1, 11):
        kalman.observe(sample(last + 0.1 * i, 900.0 if i % 2 else 5.0))
    assert kalman.at(last + 1.0).r == pytest.approx(before - 6.0, abs=0.1)


def test_the_estimate_may_steer_after_its_fifth_sample():
    kalman = KalmanRangeRate(SETTINGS)
    ready = []
    for i in range(6):
        kalman.observe(sample(0.1 * i, 300.0))
        ready.append(kalman.ready)
    assert ready == [False] * 4 + [True] * 2


def test_samples_that_say_nothing_of_the_rate_do_not_make_it_ready():
    """Ten samples of 200 m noise within a second: the rate is no better known than before them."""
    kalman = KalmanRangeRate(SETTINGS)
    for i in range(10):
        kalman.observe(sample(0.1 * i, 300.0, sigma=200.0))
    assert not kalman.ready


def test_a_reset_forgets_everything():
    kalman, last = settled()
    kalman.reset()
    assert kalman.at(last) is None
    assert kalman.nis is None
    assert not kalman.ready
    assert kalman.observe(sample(last + 0.1, 77.0)) is Fused.ACCEPTED
    assert kalman.at(last + 0.1).r == 77.0


@pytest.mark.parametrize(("sigma", "period"), [(0.5, 0.1), (2.0, 0.2), (0.001, 0.05)])
def test_the_steady_state_is_what_the_filter_settles_to(sigma, period):
    kalman, last = settled(r=300.0, r_dot=0.0, sigma=sigma, count=200, period=period)
    steady = steady_state(SETTINGS, r=300.0, sigma=sigma, period=period)
    assert kalman.at(last).r_dot_sigma == pytest.approx(steady.r_dot_sigma, rel=1e-6)


def test_the_steady_lag_is_the_one_seen_under_constant_acceleration():
    """r'' = 2 m/s^2 for long: the estimated rate trails the true one by lag times 2 m/s."""
    kalman, acceleration, period = KalmanRangeRate(SETTINGS), 2.0, 0.1
    for i in range(300):
        t = period * i
        kalman.observe(sample(t, 1e6 + acceleration * t**2 / 2))
    lag = (acceleration * t - kalman.at(t).r_dot) / acceleration
    assert steady_state(SETTINGS, r=1e6, sigma=0.5, period=period).lag == pytest.approx(lag, rel=1e-3)


def test_many_flights_are_filtered_as_one_is():
    """Outliers, a jump that starts the filter anew, and samples that do not come."""
    rng, nothing = np.random.default_rng(1), RangeRate()
    one, many = RangeRate(), RangeRate(*(np.full(3, getattr(nothing, field.name)) for field in fields(nothing)))
    for i in range(300):
        h, z = rng.choice([0.05, 0.1, 0.4]), 200 - 0.25 * i + rng.normal(0, 0.5)
        z += 50.0 if i % 40 == 7 or 200 < i < 210 else 0.0
        one = observe(one, SETTINGS, h=h, z=z, sigma=0.5)
        many = observe(many, SETTINGS, h=np.full(3, h), z=np.full(3, z), sigma=np.full(3, 0.5), xp=np)
        for field in fields(one):
            assert getattr(many, field.name)[1] == pytest.approx(getattr(one, field.name), rel=1e-9, abs=1e-9)
        assert many.ready(SETTINGS)[1] == one.ready(SETTINGS)
    assert one.samples < 120, "the jump started it anew"


def test_many_flights_are_filtered_as_filterpy_filters_one():
    """To 1e-9, through outliers and a filter that starts anew."""
    rng, t, r, _ = flight(11, 400)
    z = r + rng.normal(0, 0.5, r.size) + np.where(rng.random(r.size) < 0.05, 60.0, 0.0) + np.where(t > 20, 90.0, 0.0)
    kalman, many = KalmanRangeRate(SETTINGS), RangeRate()
    for before, now, measured in zip(np.r_[t[0], t], t, z, strict=False):
        kalman.observe(sample(now, measured, epoch=0.0))
        kalman.settle()
        many = observe(many, SETTINGS, h=now - before, z=measured, sigma=0.5)
        for field in fields(many):
            one = getattr(kalman._state, field.name)
            assert getattr(many, field.name) == pytest.approx(one, rel=1e-9, abs=1e-9), field.name
