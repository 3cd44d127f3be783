"""What the paper proves, against the paper's own numbers."""

from math import hypot, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import theory
from circnav_mav.guidance.slant import horizontal

radii = st.floats(1, 1e4)
above_the_bound = st.floats(1.001, 1e3)


def test_law_1_reaches_the_radius_of_example_1():
    assert theory.reached_radius(10.0, 0.01) == pytest.approx(10.98684113, abs=5e-9)


def test_law_1_is_fed_the_radius_of_example_2():
    assert theory.corrected_radius(10.0, 0.01) == pytest.approx(8.66025404, abs=5e-9)


def test_gain_bounds_are_the_theorems_at_the_papers_numbers():
    """1/(2 r_d^2) = 0.005 and V/r_d = 0.1 for V = 1, r_d = 10."""
    assert theory.smooth_gain_bound(10.0) == pytest.approx(0.005)
    assert theory.switching_gain_bound(1.0, 10.0) == pytest.approx(0.1)
    assert theory.switching_gain_bound(15.0, 100.0) == pytest.approx(0.15)


@given(r_d=radii, above=above_the_bound, sign=st.sampled_from([1, -1]))
def test_the_corrected_radius_undoes_the_reached_one(r_d, above, sign):
    k = sign * above / (2 * r_d**2)
    assert theory.reached_radius(theory.corrected_radius(r_d, k), k) == pytest.approx(r_d, rel=1e-9)


@given(r_d=radii, above=above_the_bound)
def test_the_reached_radius_lies_always_outside_the_one_fed(r_d, above):
    assert theory.reached_radius(r_d, above / (2 * r_d**2)) > r_d


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_no_correction_exists_at_or_below_the_bound(share, sign):
    with pytest.raises(ValueError, match=r"must be above 1/\(2 r_d\^2\) = 0\.005"):
        theory.corrected_radius(10.0, sign * share * 0.005)


@given(theta_b=st.floats(0, 2 * pi), r=st.floats(45, 1e3), turn=st.floats(-1, 1))
def test_no_turn_accelerates_the_range_beyond_its_bound(theta_b, r, turn):
    """r'' = V sin(theta_b) theta_b' with theta_b' = omega + V sin(theta_b)/r (eq. `thetadot`).

    V = 15 m/s, omega_max = 1/3 rad/s, so the tightest turn is 45 m."""
    V, omega_max = 15.0, 1 / 3
    acceleration = V * sin(theta_b) * (turn * omega_max + V * sin(theta_b) / r)
    assert abs(acceleration) <= theory.max_range_acceleration(V, omega_max, r) * (1 + 1e-12)


def test_the_acceleration_bound_stops_growing_inside_the_tightest_turn():
    assert theory.max_range_acceleration(15.0, 1 / 3, 1e-6) == pytest.approx(
        theory.max_range_acceleration(15.0, 1 / 3, 45)
    )
    assert theory.max_range_acceleration(15.0, 1 / 3, 90) == pytest.approx(15**2 / 90 + 5)


@given(rho=st.floats(10, 1e4), height=st.floats(0.1, 40), sigma=st.floats(0.01, 5))
def test_slant_range_gives_back_the_horizontal_one(rho, height, sigma):
    answer = horizontal(hypot(rho, height), sigma, height)
    assert answer is not None
    flat, noise = answer
    assert flat == pytest.approx(rho, rel=1e-9)
    assert noise == pytest.approx(sigma * hypot(rho, height) / rho, rel=1e-9)


@pytest.mark.parametrize("slant", [29.9, 30.0, 30.5])
def test_a_target_overhead_has_no_horizontal_range(slant):
    """Growth of the noise is slant/rho: 30.5/sqrt(30.5^2 - 30^2) = 5.55, above 5."""
    assert horizontal(slant, 0.5, 30.0) is None
