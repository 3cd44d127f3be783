"""The estimator of white noise, against noise of a given standard deviation and numpy's
quantiles."""

import numpy as np
import pytest

from circnav_mav.guidance.white_noise import WhiteNoise, bulk_sigma, quantile, residual


@pytest.mark.parametrize("rows", [1, 3, 4, 7, 40, 41])
def test_the_median_of_the_values_present_is_numpys(rows):
    values = np.random.default_rng(rows).normal(size=(rows, 200))
    values[: rows // 2 - rows // 2 % 2, :50] = np.nan
    assert np.array_equal(quantile(values, 0.5), np.nanmedian(values, axis=0))
    assert np.isnan(quantile(np.full((rows, 1), np.nan), 0.5)).all()


def test_a_residual_has_the_deviation_of_the_noise_at_any_spacing_and_none_of_a_steady_motion():
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.05, 0.3, 30_000))
    steady = 100 + 7.5 * times
    threes = [
        [(times[i::3][:9_999], z[i::3][:9_999]) for i in range(3)]
        for z in (steady, rng.normal(0, 0.3, 30_000))
    ]
    assert np.abs(residual(*threes[0])).max() < 1e-9
    assert residual(*threes[1]).std() == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_the_noise_of_each_flight_is_measured_by_itself_and_an_outlier_in_thirty_changes_it_little(
    share,
):
    rng = np.random.default_rng(3)
    noise = WhiteNoise(400, share, 2)
    z = rng.normal(0, [0.1, 2.0], (400, 2))
    z[::30] += 50
    threes = [[(j, z[j]) for j in (i - 2, i - 1, i)] for i in range(2, 400)]
    for three in threes:
        noise.add(residual(*three), np.arange(2))
    assert noise.sigma == pytest.approx([0.1, 2.0], rel=0.22)
    assert bulk_sigma([float(residual(*three)[0]) for three in threes]) == pytest.approx(
        0.1, rel=0.1
    )
