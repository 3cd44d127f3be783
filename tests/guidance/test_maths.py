"""Bounds, arcs and horizontal ranges."""

from math import hypot, inf, isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.maths import chord, clip, horizontal, horizontal_rate


def test_clip_returns_nan_for_nan():
    assert isnan(clip(nan, -1.0, 1.0))


def test_clip_bounds_infinity():
    assert clip(inf, -1.0, 1.0) == 1.0


def test_chord_of_half_a_turn_is_the_diameter():
    assert chord(10.0, 0.0, 3.141592653589793, 3.141592653589793) == pytest.approx((0.0, 20.0))
    assert chord(10.0, 0.0, 0.0, 2.0) == (20.0, 0.0)


@given(
    rho=st.floats(10, 1e4),
    height=st.floats(0.1, 40),
    sigma=st.floats(0.01, 5),
    rate=st.floats(-20, 20),
)
def test_horizontal_range_and_rate_invert_slant_geometry(rho, height, sigma, rate):
    """In level flight the slant range rate is the horizontal range rate times rho/slant; rho:
    horizontal range."""
    slant = hypot(rho, height)
    noise = pytest.approx(sigma * slant / rho, rel=1e-9)
    assert horizontal(slant, sigma, height) == (pytest.approx(rho, rel=1e-9), noise)
    assert horizontal_rate(slant, rate * rho / slant, sigma, height) == (
        pytest.approx(rate, rel=1e-9),
        noise,
    )


@pytest.mark.parametrize("slant", [29.9, 30.0, 30.5])
def test_target_overhead_has_no_horizontal_range(slant):
    """The slant correction multiplies the noise by slant/rho, and a factor above 5 gives no range.
    At a slant range of 30.5 m and a height of 30 m the factor is 30.5/sqrt(30.5^2 - 30^2) =
    5.55."""
    assert horizontal(slant, 0.5, 30.0) is None
