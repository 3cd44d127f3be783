"""The window of averaged ranges: its median against numpy's."""

import numpy as np
import pytest

from circnav_mav.core.estimators.bins import _median


@pytest.mark.parametrize("rows", [1, 2, 7, 8, 40])
def test_the_median_of_what_is_there_is_numpys(rows):
    rng = np.random.default_rng(rows)
    for missing in (0.0, 0.3, 0.9):
        values = rng.normal(size=(rows, 200))
        values[rng.random(values.shape) < missing] = np.nan
        values[0] = np.where(np.isnan(values).all(axis=0), 1.0, values[0])
        assert np.array_equal(_median(values), np.nanmedian(values, axis=0))
