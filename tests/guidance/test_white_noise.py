"""The estimator of white noise, against noise of a given standard deviation, and its quantiles
against numpy."""

import numpy as np
import pytest

from circnav_mav.guidance.white_noise import WhiteNoise, bulk_sigma, quantile, residual


@pytest.mark.parametrize("count", [1, 3, 4, 7, 40, 41])
def test_quantile_of_one_half_is_median(count):
    values = np.random.default_rng(count).normal(size=count)
    assert quantile(values.tolist(), 0.5) == np.median(values)


def test_quantile_of_no_values_is_nan():
    assert np.isnan(quantile([], 0.5))


def test_noise_residual_contains_only_noise():
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.05, 0.3, 30_000)).tolist()
    steady = [100 + 7.5 * t for t in times]
    noisy = rng.normal(0, 0.3, 30_000).tolist()
    off_steady, off_noisy = (
        [residual(*zip(times[i : i + 3], z[i : i + 3], strict=True)) for i in range(0, 29_997, 3)]
        for z in (steady, noisy)
    )
    assert np.abs(off_steady).max() < 1e-9
    assert np.std(off_noisy) == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("sigma", [0.1, 2.0])
@pytest.mark.parametrize("share", [0.25, 0.5])
def test_white_noise_estimate_tolerates_outlier_in_thirty(share, sigma):
    noise = WhiteNoise(400, share)
    z = np.random.default_rng(3).normal(0, sigma, 400)
    z[::30] += 50
    residuals = [residual(*((j, float(z[j])) for j in (i - 2, i - 1, i))) for i in range(2, 400)]
    for one in residuals:
        noise.add(one)
    assert noise.sigma == pytest.approx(sigma, rel=0.3)
    assert bulk_sigma(residuals) == pytest.approx(sigma, rel=0.1)
