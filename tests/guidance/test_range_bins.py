"""The window of averaged ranges: its bins and its estimate of the white noise, against values
calculated by hand."""

import numpy as np
import pytest

from circnav_mav.guidance.estimators.range_bins import WIDTH, RangeWindow

V = 15.0
SIGMA = 0.5


def window_of(steps, ranges, path=(0.0, 0.0)):
    """Return a window after these steps (s), with a range (m) or None after each step. path:
    displacement of the vehicle in each step, east and north, m."""
    window = RangeWindow(V)
    for dt, z in zip(steps, ranges, strict=True):
        window.add(dt, path, z, SIGMA)
    return window


@pytest.mark.parametrize(("sigma", "every"), [(0.1, 1), (0.2, 2)])
def test_range_window_measures_white_noise_despite_drift_and_motion(sigma, every):
    """The ranges have white noise and a slow error, and the vehicle moves. Every range or every
    second range is received."""
    chance = np.random.default_rng(4)
    t = 0.05 * np.arange(400)
    ranges = 100 + 10 * t + 0.4 * np.sin(t) + chance.normal(0, sigma, 400)
    received = [z if i % every == 0 else None for i, z in enumerate(ranges.tolist())]
    assert window_of([0.05] * 400, received).white(SIGMA) == pytest.approx(sigma, rel=0.35)


def test_range_window_keeps_newest_16_s():
    bins = window_of([0.05] * 400, [100.0] * 400).bins(SIGMA)
    assert bins.z.shape == (64,)
    assert bins.age == pytest.approx(0.25 * np.arange(63, -1, -1) + 0.15, abs=0.051)


def test_range_window_bounds_white_noise_by_reported_sigma():
    ranges = np.random.default_rng(4).normal(100, 5.0, 400).tolist()
    assert window_of([0.05] * 10, ranges[:10]).white(SIGMA) == SIGMA
    assert window_of([0.05] * 400, ranges).white(SIGMA) == SIGMA
    assert window_of([0.04, 0.06] * 200, [100.0] * 400).white(SIGMA) == SIGMA
    assert window_of([0.05] * 400, [100.0] * 400).white(SIGMA) == 0.0


@pytest.mark.parametrize(("step", "ranges_in_4_s"), [(0.5, 8), (0.25, 16)])
def test_drifting_range_error_is_common_to_ranges_of_4_s(step, ranges_in_4_s):
    bins = window_of([step] * 60, [100.0] * 60).bins(SIGMA)
    assert bins.variance - bins.age**3 / 300 == pytest.approx(SIGMA**2 * ranges_in_4_s, rel=0.05)


def test_range_bin_is_mean_of_quarter_second():
    window = window_of([WIDTH / 5] * 15, [100.0, 101.0, 102.0, 103.0, 104.0] * 3, path=(0.5, -0.25))
    bins = window.bins(SIGMA)
    # A step closes the bin before it adds its range. The first bin therefore has four of five
    # ranges, and each later bin has five.
    assert bins.z == pytest.approx([101.5, 102.0, 102.0])
    assert bins.age == pytest.approx([12.5 * 0.05, 8 * 0.05, 3 * 0.05])
    assert bins.path[0] == pytest.approx([12.5 * 0.5, 8 * 0.5, 3 * 0.5])
    assert bins.path[1] == pytest.approx([12.5 * -0.25, 8 * -0.25, 3 * -0.25])
    # variance of the mean, plus 0.01 age^3/3 for a random walk of the drift (0.01 m^2/s^3)
    variance = [
        SIGMA**2 / 4 + 0.625**3 / 300,
        SIGMA**2 / 5 + 0.4**3 / 300,
        SIGMA**2 / 5 + 0.15**3 / 300,
    ]
    assert bins.variance == pytest.approx(variance)


def test_range_window_excludes_outliers_and_empty_bins():
    """In each bin the second range is an outlier of 50 m and the third range is lost. Later all
    ranges are lost."""
    ranges = [200.0, 250.0, None, 203.0, 204.0, 200.0, 250.0, None, 203.0, *[None] * 6]
    bins = window_of([WIDTH / 5] * 15, ranges).bins(SIGMA)
    assert bins.z == pytest.approx([(200 + 203) / 2, (204 + 200 + 203) / 3])
