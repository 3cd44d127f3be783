"""The range-rate filter, which is filterpy's in flight, against a matrix-form one that stands in this file."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest

from circnav_mav.guidance.estimators.interface import EstimatorSettings, Fused
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate, RangeRate, observe, observe_rate, steady_state
from circnav_mav.guidance.types import RangeSample, RateSample

V, TURN = 15.0, 0.35
SETTINGS = EstimatorSettings(speed=V, max_turn_rate=TURN)
EPOCH = 1_700_000_000.0
"""The sensor's clock, far from the local one: only its differences may count."""


def sample(t, r, sigma=0.5, epoch=EPOCH, **rate):
    return RangeSample(stamp=epoch + t, time=t, r=r, sigma=sigma, **rate)


def settled(r=300.0, r_dot=-6.0, sigma=0.5, count=60, period=0.1):
    """A filter that has seen a straight run of ideal ranges; and the time of the last."""
    kalman = KalmanRangeRate(SETTINGS)
    for i in range(count):
        assert kalman.observe(sample(i * period, r + r_dot * i * period, sigma)) is Fused.ACCEPTED
    return kalman, (count - 1) * period


def hear(kalman, last, values):
    """What becomes of ranges that come every tenth of a second."""
    return [kalman.observe(sample(last + 0.1 * i, r)) for i, r in enumerate(values, 1)]


class MatrixKalman:
    """The textbook: predict with F, Q; update with H, R. The acceleration's deviation is a third of V^2/r + V w."""

    def __init__(self, first, sigma):
        self.x, self.P = np.array([first, 0.0]), np.diag([sigma**2, V**2 / 2])

    def step(self, dt, z, sigma, H=((1.0, 0.0),)):
        bound, H = V**2 / max(self.x[0], V / TURN) + V * TURN, np.array(H)
        G = np.array([[dt**2 / 2], [dt]])
        F = np.array([[1.0, dt], [0.0, 1.0]])
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + (bound / 3) ** 2 * (G @ G.T)
        S = H @ self.P @ H.T + sigma**2
        innovation = z - H @ self.x
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ innovation
        self.P = (np.eye(2) - K @ H) @ self.P
        return float(innovation[0] ** 2 / S[0, 0])

    def expects(self, estimate):
        """Whether an estimate is this one."""
        assert (estimate.r, estimate.r_dot) == pytest.approx(tuple(self.x), rel=1e-6, abs=1e-6)
        assert (estimate.r_sigma, estimate.r_dot_sigma) == pytest.approx(tuple(np.sqrt(np.diag(self.P))), rel=1e-5)


def flight(seed, count, period=0.1):
    """A vehicle that flies past and then round a target: true (t, r) with uneven steps."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, count) * period)
    return rng, t, np.hypot(-400 + V * t, 120 + 10 * np.sin(t / 5))


def test_the_filter_agrees_with_the_matrix_form_over_uneven_steps_and_noises():
    rng, t, r = flight(1, 400)
    sigmas = rng.uniform(0.2, 2.0, len(t))
    z = r + sigmas * rng.standard_normal(len(t))
    kalman, reference = KalmanRangeRate(SETTINGS), MatrixKalman(z[0], sigmas[0])
    kalman.observe(sample(t[0], z[0], sigmas[0]))
    for (before, now), value, sigma in zip(pairwise(t), z[1:], sigmas[1:], strict=True):
        assert kalman.observe(sample(now, value, sigma)) is Fused.ACCEPTED
        nis = reference.step(now - before, value, sigma)
        reference.expects(kalman.at(now))
        assert kalman.nis == pytest.approx(nis, rel=1e-3, abs=1e-6)
    reference.step(0.4, 0.0, 1e9)  # a measurement worth nothing: a prediction of .4 s
    reference.expects(kalman.at(now + 0.4))


def test_the_filter_takes_rates_as_its_matrix_form_does():
    rng, kalman = np.random.default_rng(1), KalmanRangeRate(SETTINGS)
    kalman.observe_rate(RateSample(0.0, 0.0, 5.0, 0.1))  # before any range it is nothing
    assert kalman.at(0.0) is None
    kalman.observe(sample(0.0, 300.0, epoch=0.0))
    reference, t = MatrixKalman(300.0, 0.5), 0.0
    for i in range(200):
        step = float(rng.uniform(0.02, 0.1))
        t += step
        r, rate = 300.0 - 6.0 * t + 0.3 * rng.normal(), -6.0 + 0.3 * rng.normal()
        if i % 3:
            kalman.observe_rate(RateSample(t, t, rate, 0.3))
            reference.step(step, rate, 0.3, H=[[0.0, 1.0]])
        else:
            kalman.observe(sample(t, r, epoch=0.0))
            reference.step(step, r, 0.5)
        reference.expects(kalman.at(t))
    kalman.observe_rate(RateSample(t + 0.1, t + 0.1, 40.0, 0.3))  # an outlier
    assert kalman.at(t + 0.1).r_dot == pytest.approx(-6.0, abs=0.5)


@pytest.mark.parametrize("rates", [False, True])
def test_many_flights_are_filtered_as_filterpy_filters_one(rates):
    """To 1e-9, through outliers and a jump that starts the filter anew."""
    rng, t, r = flight(11, 400)
    z = r + rng.normal(0, 0.5, r.size) + np.where(rng.random(r.size) < 0.05, 60.0, 0.0) + np.where(t > 20, 90.0, 0.0)
    kalman, nothing, began = KalmanRangeRate(SETTINGS), RangeRate(), 0
    many = RangeRate(*(np.full(3, getattr(nothing, field.name)) for field in fields(nothing)))
    for before, now, measured in zip(np.r_[t[0], t], t, z, strict=False):
        rate = {"r_dot": rng.normal(-6.0, 0.2), "r_dot_sigma": 0.2} if rates else {}
        kalman.observe(sample(now, measured, epoch=0.0, **rate))
        kalman.settle()
        many = observe(many, SETTINGS, h=now - before, z=np.full(3, measured), sigma=0.5)
        if rates:
            many = observe_rate(many, SETTINGS, h=0.0, z=rate["r_dot"], sigma=0.2)
        for field in fields(many):
            one = getattr(kalman._state, field.name)
            assert np.broadcast_to(getattr(many, field.name), 3)[1] == pytest.approx(one, rel=1e-9, abs=1e-9)
        assert many.ready(SETTINGS)[1] == kalman.ready
        began += many.samples[1] == 1
    assert began > 1, "the jump started it anew"


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
    state, settings, nis = RangeRate(), EstimatorSettings(V, TURN, gate=20), []
    for _ in range(4000):
        state = observe(state, settings, h=period, z=r + sigma * rng.standard_normal(), sigma=sigma)
        nis.append(state.nis)
        a = acceleration * rng.standard_normal()
        r, r_dot = r + r_dot * period + a * period**2 / 2, r_dot + a * period
    assert np.mean(nis[20:]) == pytest.approx(1.0, abs=0.07)
    assert np.mean(np.array(nis[20:]) > 3.84) == pytest.approx(0.05, abs=0.012)


@pytest.mark.parametrize("ahead", [-1.0, 0.0, 0.05, 0.4])
def test_the_estimate_ahead_of_the_newest_sample_is_a_straight_line_and_before_it_the_newest(ahead):
    kalman, last = settled()
    now, later = kalman.at(last), kalman.at(last + ahead)
    assert later.time == last + ahead
    assert later.r == pytest.approx(now.r + now.r_dot * max(ahead, 0.0), rel=1e-12)
    assert later.r_dot == now.r_dot == pytest.approx(-6.0, abs=0.05)
    assert (later.r_sigma > now.r_sigma) == (ahead > 0)


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
    assert hear(kalman, last, [expected.r + off]) == [Fused.GATED]
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
    assert hear(kalman, last, [ahead.r + sigmas * deviation]) == [fused]


def test_scattered_outliers_never_restart_the_filter_and_time_passes():
    """The state is carried through the refused samples: after four seconds at -6 m/s the range is 24 m less."""
    kalman, last = settled()
    before = kalman.at(last).r
    assert hear(kalman, last, [900.0, 5.0] * 20) == [Fused.GATED] * 40
    assert kalman.ready
    assert kalman.at(last + 4.0).r == pytest.approx(before - 24.0, abs=0.4)


def test_a_real_jump_restarts_the_filter_after_five_samples_that_agree():
    kalman, last = settled()
    assert hear(kalman, last, [900.0 - 0.6 * i for i in range(1, 6)]) == [Fused.GATED] * 4 + [Fused.RESTARTED]
    assert kalman.at(last + 0.5).r == pytest.approx(897.0)
    assert not kalman.ready, "a restarted filter knows no rate yet"
    assert hear(kalman, last + 0.5, [897.0 - 0.6 * i for i in range(1, 15)]) == [Fused.ACCEPTED] * 14
    assert kalman.ready
    assert kalman.at(last + 1.9).r_dot == pytest.approx(-6.0, abs=1.0)


def test_a_good_sample_between_two_runs_of_outliers_forgets_the_first_run():
    kalman, last = settled()
    assert hear(kalman, last, [900.0] * 4) == [Fused.GATED] * 4
    assert hear(kalman, last + 0.4, [kalman.at(last + 0.5).r]) == [Fused.ACCEPTED]
    assert hear(kalman, last + 0.5, [900.0] * 4) == [Fused.GATED] * 4


@pytest.mark.parametrize(("sigma", "ready"), [(0.5, [False] * 4 + [True] * 2), (200.0, [False] * 10)])
def test_the_estimate_may_steer_after_its_fifth_sample_if_that_tells_anything_of_the_rate(sigma, ready):
    """Ten samples of 200 m noise within a second: the rate is no better known than before them."""
    kalman = KalmanRangeRate(SETTINGS)
    for i, expected in enumerate(ready):
        kalman.observe(sample(0.1 * i, 300.0, sigma))
        assert kalman.ready == expected


def test_a_reset_forgets_everything():
    kalman, last = settled()
    kalman.reset()
    assert (kalman.at(last), kalman.nis, kalman.ready) == (None, None, False)
    assert hear(kalman, last, [77.0]) == [Fused.ACCEPTED]
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
