"""The estimator of white noise, against noise of a given standard deviation."""

import numpy as np
import pytest

from circnav_mav.guidance.white_noise import WhiteNoise, bulk_sigma, is_even, residual


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
def test_white_noise_estimate_tolerates_outlier_in_thirty(sigma):
    noise = WhiteNoise(400)
    z = np.random.default_rng(3).normal(0, sigma, 400)
    z[::30] += 50
    residuals = [residual(*((j, float(z[j])) for j in (i - 2, i - 1, i))) for i in range(2, 400)]
    for one in residuals:
        noise.add(one)
    assert noise.sigma == pytest.approx(sigma, rel=0.3)
    assert bulk_sigma(residuals) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize(("step", "even"), [(0.1, True), (0.115, True), (0.125, False)])
def test_white_noise_uses_even_steps_despite_jitter(step, even):
    assert is_even((0.0, 0.0), (0.1, 0.0), (0.1 + step, 0.0)) is even
