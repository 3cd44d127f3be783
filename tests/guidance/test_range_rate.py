"""The range-rate filter of the flight: its model and gate against a filter in matrix form."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate, steady_state
from circnav_mav.guidance.types import RangeSample, RateSample

V = 15.0
TURN = 0.35
SETTINGS = EstimatorSettings(speed=V, max_turn_rate=TURN)
EPOCH = 1_700_000_000.0
"""Offset of the sensor's clock from the local clock, s. The filter may use only differences of
stamps."""


def sample(t, r, sigma=0.5, epoch=EPOCH, **rate):
    return RangeSample(stamp=epoch + t, time=t, r=r, sigma=sigma, **rate)


def settled(r=300.0, r_dot=-6.0, sigma=0.5, count=60, period=0.1):
    """Return a filter after ideal ranges of a straight flight, and the time of the last range."""
    kalman = KalmanRangeRate(SETTINGS)
    for i in range(count):
        assert kalman.observe(sample(i * period, r + r_dot * i * period, sigma))
    return kalman, (count - 1) * period


def observe(kalman, last, values):
    """Pass ranges to the filter, one every 0.1 s. Return the results."""
    return [kalman.observe(sample(last + 0.1 * i, r)) for i, r in enumerate(values, 1)]


class MatrixKalman:
    """filterpy's general filter: predict with F, Q and update with H, R. The standard deviation of
    the acceleration is one third of V^2/r + V w."""

    def __init__(self, first, sigma):
        self.filter = KalmanFilter(dim_x=2, dim_z=1)
        self.filter.x = np.array([first, 0.0])
        self.filter.P = np.diag([sigma**2, V**2 / 2])

    def step(self, dt, z, sigma, H=((1.0, 0.0),)):
        bound = V**2 / max(self.filter.x[0], V / TURN) + V * TURN
        G = np.array([[dt**2 / 2], [dt]])
        self.filter.predict(F=np.array([[1.0, dt], [0.0, 1.0]]), Q=(bound / 3) ** 2 * (G @ G.T))
        self.filter.update(z, R=sigma**2, H=np.array(H))
        return float(self.filter.y[0] ** 2 / self.filter.S[0, 0])

    def expects(self, estimate):
        """Compare an estimate with the state and covariance of this filter."""
        assert (estimate.r, estimate.r_dot) == pytest.approx(
            tuple(self.filter.x), rel=1e-9, abs=1e-9
        )
        assert (estimate.r_sigma, estimate.r_dot_sigma) == pytest.approx(
            tuple(np.sqrt(np.diag(self.filter.P))), rel=1e-9
        )


def flight(seed, count):
    """Return a random generator, and times (s) and true ranges (m) of a vehicle that passes a
    target. The time steps are uneven, about 0.1 s."""
    rng = np.random.default_rng(seed)
    # multiples of 1/1024 s are exact at any clock offset
    t = np.round(np.cumsum(rng.uniform(0.05, 0.15, count)) * 1024) / 1024
    return rng, t, np.hypot(-400 + V * t, 120 + 10 * np.sin(t / 5))


@pytest.mark.parametrize("rates", [0.0, 0.6], ids=["ranges", "ranges and rates"])
def test_range_rate_filter_matches_filterpy_with_uneven_steps(rates):
    rng, t, r = flight(1, 400)
    kalman = KalmanRangeRate(SETTINGS)
    now = t[0]
    kalman.observe_rate(RateSample(EPOCH, 0.0, 5.0, 0.1))  # a range rate alone gives no estimate
    assert kalman.at(0.0) is None
    z = r[0] + rng.normal()
    kalman.observe(sample(now, z, 1.0))
    assert (kalman.at(now).r, kalman.at(now).r_dot, kalman.nis, kalman.ready) == (
        z,
        0.0,
        None,
        False,
    )
    reference = MatrixKalman(z, 1.0)
    # prior variance of r': E[V^2 cos^2(theta_b)] over all bearings is V^2/2
    reference.expects(kalman.at(now))
    for now, step, true, r_dot in zip(
        t[1:], np.diff(t), r[1:], np.diff(r) / np.diff(t), strict=True
    ):
        sigma = rng.uniform(0.2, 2.0)
        if rng.random() < rates:
            rate = r_dot + sigma * rng.normal()
            kalman.observe_rate(RateSample(EPOCH + now, now, rate, sigma))
            reference.step(step, rate, sigma, H=[[0.0, 1.0]])
        else:
            z = true + sigma * rng.normal()
            assert kalman.observe(sample(now, z, sigma))
            assert kalman.nis == pytest.approx(reference.step(step, z, sigma), rel=1e-3, abs=1e-6)
        reference.expects(kalman.at(now))
    before = kalman.at(now).r_dot
    kalman.observe_rate(RateSample(EPOCH + now, now, before + 40.0, 0.3))  # an outlier
    # older than the newest sample
    kalman.observe_rate(RateSample(EPOCH + now - 0.05, now - 0.05, before + 0.5, 0.3))
    assert kalman.at(now).r_dot == before
    reference.step(0.4, 0.0, 1e9)  # prediction by 0.4 s: a measurement of infinite sigma
    reference.expects(kalman.at(now + 0.4))
    assert kalman.at(now - 1.0).r == kalman.at(now).r


def test_range_rate_filter_uses_stamps_despite_arrival_jitter():
    steady = KalmanRangeRate(SETTINGS)
    jittery = KalmanRangeRate(SETTINGS)
    rng = np.random.default_rng(5)
    for i in range(50):
        r = 200 - 0.5 * i
        steady.observe(sample(0.1 * i, r))
        jittery.observe(
            RangeSample(stamp=EPOCH + 0.1 * i, time=0.1 * i + rng.uniform(0, 0.05), r=r, sigma=0.5)
        )
    assert jittery.at(0).r_dot == steady.at(0).r_dot


@pytest.mark.parametrize("sigmas", [4.99, 5.01, -5.01, -20.0])
def test_range_rate_gate_rejects_beyond_five_sigma(
    sigmas,
):
    """The gate compares the innovation with sqrt(predicted range variance + measurement variance)
    at the time of the sample."""
    kalman, last = settled()
    ahead = kalman.at(last + 0.1)
    outside = abs(sigmas) > 5
    off = sigmas * (ahead.r_sigma**2 + 0.5**2) ** 0.5
    assert observe(kalman, last, [ahead.r + off]) == [not outside]
    after = kalman.at(last + 0.1)
    assert (abs(after.r - ahead.r) < 1e-6, after.r_dot == ahead.r_dot) == (outside, outside)
    assert kalman.nis == pytest.approx(sigmas**2, rel=1e-6)
    assert kalman.ready


def test_range_rate_filter_predicts_through_scattered_outliers():
    """The filter predicts while it rejects samples: after 4 s at -6 m/s the range is 24 m less. A
    good sample between two runs of consistent outliers discards the first run."""
    kalman, last = settled()
    before = kalman.at(last).r
    assert observe(kalman, last, [900.0, 5.0] * 20) == [False] * 40
    assert kalman.ready
    assert kalman.at(last + 4.0).r == pytest.approx(before - 24.0, abs=0.4)
    kalman, last = settled()
    good = kalman.at(last + 0.5).r
    assert (
        observe(kalman, last, [900.0] * 4 + [good] + [900.0] * 4)
        == [False] * 4 + [True] + [False] * 4
    )


@pytest.mark.parametrize(("apart", "agree"), [(6.0, True), (7.0, False)])
def test_range_rate_filter_restarts_only_with_consistent_samples(apart, agree):
    """Consistent samples differ by at most 2 V 0.1 s = 3 m plus five standard deviations of a
    difference of two samples, 3.5 m."""
    kalman, last = settled()
    results = observe(kalman, last, [900.0 - apart * i for i in range(5)])
    assert results == [False] * 4 + [agree]


def test_range_rate_filter_restarts_after_five_consistent_samples():
    kalman, last = settled()
    assert observe(kalman, last, [900.0 - 0.6 * i for i in range(1, 6)]) == [False] * 4 + [True]
    assert kalman.at(last + 0.5).r == pytest.approx(897.0)
    assert not kalman.ready, "no rate estimate after a restart"
    assert observe(kalman, last + 0.5, [897.0 - 0.6 * i for i in range(1, 15)]) == [True] * 14
    assert kalman.ready
    assert kalman.at(last + 1.9).r_dot == pytest.approx(-6.0, abs=1.0)


@pytest.mark.parametrize(
    ("sigma", "ready"), [(0.5, [False] * 4 + [True] * 2), (200.0, [False] * 10)]
)
def test_range_rate_filter_is_ready_after_five_informative_samples(sigma, ready):
    """Ten samples with 200 m of noise within a second do not reduce the uncertainty of the rate."""
    kalman = KalmanRangeRate(SETTINGS)
    for i, expected in enumerate(ready):
        kalman.observe(sample(0.1 * i, 300.0, sigma))
        assert kalman.ready == expected


def test_range_rate_filter_predicts_no_negative_range():
    """The vehicle approaches at 6 m/s from 10 m. Without a bound, the prediction after 20 s without
    ranges would be -110 m."""
    kalman, last = settled(r=46.0)
    assert [round(kalman.at(last + t).r) for t in (0.0, 1.0, 3.0, 20.0)] == [11, 5, 7, 109]
    assert kalman.at(last + 1.0).r_dot == pytest.approx(-6.0, abs=0.1)
    assert kalman.at(last + 3.0).r_dot == pytest.approx(6.0, abs=0.1)


def test_range_rate_filter_reset_discards_state():
    kalman, last = settled()
    kalman.reset()
    assert (kalman.at(last), kalman.nis, kalman.ready) == (None, None, False)
    assert observe(kalman, last, [77.0]) == [True]
    assert kalman.at(last + 0.1).r == 77.0


@pytest.mark.parametrize(("sigma", "period"), [(0.5, 0.1), (2.0, 0.2), (0.001, 0.05)])
def test_computed_steady_state_matches_settled_range_rate_filter(sigma, period):
    """At a constant r'' of 2 m/s^2 far from the target, the estimated rate lags the true rate by
    the filter's lag times 2 m/s^2."""
    kalman, _ = settled(r_dot=0.0, sigma=sigma, count=200, period=period)
    steady = steady_state(SETTINGS, r=300.0, sigma=sigma, period=period)
    assert kalman.at(0.0).r_dot_sigma == pytest.approx(steady.r_dot_sigma, rel=1e-6)
    kalman = KalmanRangeRate(SETTINGS)
    acceleration = 2.0
    for t in period * np.arange(300):
        kalman.observe(sample(t, 1e6 + acceleration * t**2 / 2, sigma))
    lag = (acceleration * t - kalman.at(t).r_dot) / acceleration
    assert steady_state(SETTINGS, r=1e6, sigma=sigma, period=period).lag == pytest.approx(
        lag, rel=2e-3
    )
