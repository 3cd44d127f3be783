"""Theorems of the paper against the paper's own numbers, and the geometry of ranges."""

from math import hypot, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import laws
from circnav_mav.guidance.maths import horizontal, horizontal_rate


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        (laws.reached_radius(10.0, 0.01), 10.98684113),  # example 1
        (laws.corrected_radius(10.0, 0.01), 8.66025404),  # example 2
        (laws.corrected_radius(10.0, -0.01), 8.66025404),
        (laws.smooth_gain_bound(10.0), 0.005),
        (laws.switching_gain_bound(15.0, 100.0), 0.15),
    ],
)
def test_law_1_reaches_and_is_fed_the_papers_radii_above_the_papers_bounds(number, expected):
    assert number == pytest.approx(expected, rel=1e-9)


@given(theta_b=st.floats(0, 2 * pi), r=st.floats(45, 1e3), turn=st.floats(-1, 1))
def test_no_turn_accelerates_the_range_beyond_its_bound(theta_b, r, turn):
    """r'' = V sin(theta_b) theta_b' with theta_b' = omega + V sin(theta_b)/r (eq. `thetadot`).

    V = 15 m/s, omega_max = 1/3 rad/s, so the tightest turn is 45 m."""
    V, omega_max = 15.0, 1 / 3
    acceleration = V * sin(theta_b) * (turn * omega_max + V * sin(theta_b) / r)
    assert abs(acceleration) <= laws.max_range_acceleration(V, omega_max, r) * (1 + 1e-12)


@pytest.mark.parametrize(("r", "bound"), [(1e-6, 10.0), (45.0, 10.0), (90.0, 7.5)])
def test_the_acceleration_bound_stops_growing_inside_the_tightest_turn(r, bound):
    """V^2/r + V omega_max of the same vehicle."""
    assert laws.max_range_acceleration(15.0, 1 / 3, r) == pytest.approx(bound)


@given(rho=st.floats(10, 1e4), height=st.floats(0.1, 40), sigma=st.floats(0.01, 5), rate=st.floats(-20, 20))
def test_slant_range_and_rate_give_back_the_horizontal_ones(rho, height, sigma, rate):
    """In level flight the slant rate is the horizontal one times rho/slant."""
    slant = hypot(rho, height)
    noise = pytest.approx(sigma * slant / rho, rel=1e-9)
    assert horizontal(slant, sigma, height) == (pytest.approx(rho, rel=1e-9), noise)
    assert horizontal_rate(slant, rate * rho / slant, sigma, height) == (pytest.approx(rate, rel=1e-9), noise)


@pytest.mark.parametrize("slant", [29.9, 30.0, 30.5])
def test_a_target_overhead_has_no_horizontal_range(slant):
    """Growth of the noise is slant/rho: 30.5/sqrt(30.5^2 - 30^2) = 5.55, above 5."""
    assert horizontal(slant, 0.5, 30.0) is None
