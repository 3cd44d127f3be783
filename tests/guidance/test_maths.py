"""Elementary functions of a float or an array, and horizontal ranges."""

from math import hypot, inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import maths
from circnav_mav.guidance.maths import horizontal, horizontal_rate

ONE = ("cos", "sin", "exp", "tanh", "rint", "sign", "sinc", "logical_not")
SHARE = ("arccos", "arcsin")
TWO = ("arctan2", "hypot", "minimum", "maximum")


@given(x=st.floats(-600, 600), y=st.floats(-1e6, 1e6))
def test_a_float_is_answered_as_numpy_answers_an_array(x, y):
    values = [
        *((n, (x,)) for n in ONE),
        *((n, (x / 600,)) for n in SHARE),
        *((n, (y, x)) for n in TWO),
    ]
    for name, operands in [
        *values,
        ("sqrt", (abs(y),)),
        ("clip", (x, -abs(y), abs(y))),
        ("where", (x > y, x, y)),
    ]:
        function = getattr(maths, name)
        expected = getattr(np, name)(*operands)
        assert function(*operands) == pytest.approx(expected, rel=1e-12, abs=1e-12), name
        assert function(*map(np.array, operands)) == expected, name


def test_a_number_that_is_none_is_not_hidden_by_a_bound():
    assert np.isnan(
        [maths.clip(nan, -1.0, 1.0), maths.minimum(nan, 1.0), maths.maximum(nan, 0.0)]
    ).all()
    assert maths.clip(inf, -1.0, 1.0) == 1.0


@given(
    rho=st.floats(10, 1e4),
    height=st.floats(0.1, 40),
    sigma=st.floats(0.01, 5),
    rate=st.floats(-20, 20),
)
def test_slant_range_and_rate_give_back_the_horizontal_ones(rho, height, sigma, rate):
    """In level flight the slant rate is the horizontal one times rho/slant."""
    slant = hypot(rho, height)
    noise = pytest.approx(sigma * slant / rho, rel=1e-9)
    assert horizontal(slant, sigma, height) == (pytest.approx(rho, rel=1e-9), noise)
    assert horizontal_rate(slant, rate * rho / slant, sigma, height) == (
        pytest.approx(rate, rel=1e-9),
        noise,
    )


@pytest.mark.parametrize("slant", [29.9, 30.0, 30.5])
def test_a_target_overhead_has_no_horizontal_range(slant):
    """Growth of the noise is slant/rho: 30.5/sqrt(30.5^2 - 30^2) = 5.55, above 5."""
    assert horizontal(slant, 0.5, 30.0) is None
