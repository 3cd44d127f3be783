"""Elementary functions of a float or an array."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import maths

ONE = ("cos", "sin", "exp", "tanh", "rint", "sign", "sinc", "logical_not")
SHARE = ("arccos", "arcsin")
TWO = ("arctan2", "hypot", "minimum", "maximum")


@given(x=st.floats(-600, 600), y=st.floats(-1e6, 1e6))
def test_a_float_is_answered_as_numpy_answers_an_array(x, y):
    values = [*((n, (x,)) for n in ONE), *((n, (x / 600,)) for n in SHARE), *((n, (y, x)) for n in TWO)]
    for name, operands in [*values, ("sqrt", (abs(y),)), ("clip", (x, -abs(y), abs(y))), ("where", (x > y, x, y))]:
        function, expected = getattr(maths, name), getattr(np, name)(*operands)
        assert function(*operands) == pytest.approx(expected, rel=1e-12, abs=1e-12), name
        assert function(*map(np.array, operands)) == expected, name


def test_a_number_that_is_none_is_not_hidden_by_a_bound():
    assert np.isnan([maths.clip(nan, -1.0, 1.0), maths.minimum(nan, 1.0), maths.maximum(nan, 0.0)]).all()
    assert maths.clip(inf, -1.0, 1.0) == 1.0
