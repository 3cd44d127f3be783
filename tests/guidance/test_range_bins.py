"""The window of averaged ranges: its bins, and its estimate of the noise, against values by
hand."""

import numpy as np
import pytest

from circnav_mav.guidance.estimators.range_bins import WIDTH, RangeWindow

V = 15.0
SIGMA = 0.5


def listened(steps, ranges, valid, path=(0.0, 0.0)):
    """A window of two flights: steps (N,) in s, ranges (N, 2) in m, valid (N, 2); path: m in each
    step."""
    window = RangeWindow(2, V)
    for dt, z, arrived in zip(steps, ranges, valid, strict=True):
        window.add(
            np.full(2, dt), np.array(path)[:, None] + np.zeros(2), z, np.full(2, SIGMA), arrived
        )
    return window


def test_the_white_part_of_the_noise_is_measured_of_each_flight_though_the_range_drifts_and_moves():
    """White noise of 0.1 m beside an error with a time constant of seconds. The second flight
    receives every other range."""
    chance = np.random.default_rng(4)
    t = 0.05 * np.arange(400)
    slow = 0.4 * np.sin(t)[:, None]
    ranges = 100 + 10 * t[:, None] + slow + chance.normal(0, [0.1, 0.2], (400, 2))
    valid = np.stack([np.ones(400, bool), np.arange(400) % 2 == 0], axis=1)
    white = listened(np.full(400, 0.05), ranges, valid).white(np.full(2, SIGMA))
    assert white == pytest.approx([0.1, 0.2], rel=0.35)


def test_a_window_keeps_the_newest_sixteen_seconds():
    bins = listened(np.full(400, 0.05), np.full((400, 2), 100.0), np.ones((400, 2), bool)).bins(
        np.arange(2), np.full(2, SIGMA)
    )
    assert bins.z.shape == (2, 64)
    assert bins.age[0] == pytest.approx(0.25 * np.arange(63, -1, -1) + 0.15, abs=0.051)


def test_what_the_sensor_says_stands_for_the_white_part_until_it_is_measured_and_bounds_it():
    chance = np.random.default_rng(4)
    ranges = chance.normal(100, 5.0, (400, 2))
    every = np.ones((400, 2), bool)
    assert listened(np.full(10, 0.05), ranges[:10], every[:10]).white(
        np.full(2, SIGMA)
    ).tolist() == [SIGMA, SIGMA]
    assert listened(np.full(400, 0.05), ranges, every).white(np.full(2, SIGMA)).tolist() == [
        SIGMA,
        SIGMA,
    ]
    uneven = np.where(np.arange(400) % 2, 0.04, 0.06)
    still = np.full((400, 2), 100.0)
    assert listened(uneven, still, every).white(np.full(2, SIGMA)).tolist() == [SIGMA, SIGMA]
    assert listened(np.full(400, 0.05), still, every).white(np.full(2, SIGMA)).tolist() == [
        0.0,
        0.0,
    ]


def test_a_bin_is_the_mean_of_a_quarter_of_a_second_without_what_is_far_off_and_an_empty_one_says_nothing():
    """Five ranges per bin. In the second flight one is 50 m off, the middle one is lost, and later
    all are."""
    ranges = np.array(
        [[100.0, 200.0], [101.0, 250.0], [102.0, 202.0], [103.0, 203.0], [104.0, 204.0]] * 3
    )
    valid = np.ones((15, 2), bool)
    valid[[2, 7, *range(9, 15)], 1] = False
    window = listened(np.full(15, WIDTH / 5), ranges, valid, path=(0.5, -0.25))
    bins = window.bins(np.arange(2), np.full(2, SIGMA))
    # a step closes the bin before it adds its own range: four of the first five, and all of the
    # next
    assert bins.z[0] == pytest.approx([101.5, 102.0, 102.0])
    assert bins.z[1, :2] == pytest.approx([(200 + 203) / 2, (204 + 200 + 203) / 3])
    assert bins.age[0] == pytest.approx([12.5 * 0.05, 8 * 0.05, 3 * 0.05])
    assert bins.path[0, 0] == pytest.approx([12.5 * 0.5, 8 * 0.5, 3 * 0.5])
    assert bins.path[1, 0] == pytest.approx([12.5 * -0.25, 8 * -0.25, 3 * -0.25])
    # of the mean, and the drift meanwhile, 0.01 m^2/s^3: 0.01 age^3/3
    variance = [
        SIGMA**2 / 4 + 0.625**3 / 300,
        SIGMA**2 / 5 + 0.4**3 / 300,
        SIGMA**2 / 5 + 0.15**3 / 300,
    ]
    assert bins.variance[0] == pytest.approx(variance)
    assert np.isinf(bins.variance[1]).tolist() == [False, False, True]
