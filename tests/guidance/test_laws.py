"""The paper's laws against their own statements: both senses, the bound, the inside, arrays."""

from math import asin, cos, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.laws import LAWS, smooth, switching

EXAMPLE = {"V": 1.0, "r_d": 10.0}
"""The paper's three examples share these."""

ranges = st.floats(0, 1e4)
rates = st.floats(-50, 50)
speeds = st.floats(0.1, 50)
radii = st.floats(1, 1e3)
gains = st.floats(1e-6, 10)


@pytest.mark.parametrize("law", [smooth, switching])
@given(r=ranges, r_dot=rates, V=speeds, r_d=radii, k=gains)
def test_a_negative_gain_is_the_exact_mirror_image(law, r, r_dot, V, r_d, k):
    assert law(r, r_dot, V=V, r_d=r_d, k=-k) == -law(r, r_dot, V=V, r_d=r_d, k=k)


@pytest.mark.parametrize("law", [smooth, switching])
@given(share=st.floats(0, 1, exclude_max=True), r_dot=rates, V=speeds, r_d=radii, k=gains)
def test_inside_the_circle_nothing_turns(law, share, r_dot, V, r_d, k):
    assert law(min(share * r_d, np.nextafter(r_d, 0)), r_dot, V=V, r_d=r_d, k=k) == 0.0


@given(r=ranges, r_dot=rates, V=speeds, r_d=radii, k=st.floats(-10, 10))
def test_law_2_never_asks_for_more_than_its_gain(r, r_dot, V, r_d, k):
    assert abs(switching(r, r_dot, V=V, r_d=r_d, k=k)) <= abs(k)


@pytest.mark.parametrize("law", [smooth, switching])
@given(points=st.lists(st.tuples(ranges, rates), min_size=1, max_size=8), V=speeds, r_d=radii, k=gains)
def test_an_array_is_the_same_law_as_its_scalars(law, points, V, r_d, k):
    r, r_dot = (np.array(column) for column in zip(*points, strict=True))
    one_by_one = [float(law(*point, V=V, r_d=r_d, k=k)) for point in points]
    np.testing.assert_allclose(law(r, r_dot, V=V, r_d=r_d, k=k), one_by_one, rtol=1e-13, atol=0)


@given(outside=st.floats(1, 100), r_dot=st.floats(-1, 1), k=st.floats(0.001, 1))
def test_law_1_is_the_equation_of_the_paper(outside, r_dot, k):
    r = 10 * outside
    by_hand = k * (2 * r * 1.0 * cos(pi - asin(10 / r)) - 2 * r * r_dot)  # eq. `omega`
    assert float(smooth(r, r_dot, **EXAMPLE, k=k)) == pytest.approx(by_hand, rel=1e-12, abs=1e-12)


def test_law_1_settles_where_its_turn_rate_is_that_of_the_circle():
    """At r_a = 10.98684113 (the paper's example 1) with r' = 0: |omega| = V/r_a, and clockwise, for k > 0."""
    assert float(smooth(10.98684113, 0.0, **EXAMPLE, k=0.01)) == pytest.approx(-1 / 10.98684113, rel=1e-8)


@pytest.mark.parametrize(
    ("r_dot", "turn"),
    [(0.0, -0.12), (1.0, -0.12), (-1.0, 0.12)],
    ids=["across the line of sight", "straight away", "straight at the target"],
)
def test_law_2_turns_clockwise_unless_the_vehicle_closes_faster_than_the_tangent(r_dot, turn):
    """Far out the tangent closes at nearly -V; example 3, k = 0.12. At r = 20 the tangent rate is -sqrt(3)/2."""
    assert float(switching(20.0, r_dot, **EXAMPLE, k=0.12)) == turn


def test_law_2_does_not_turn_on_the_tangent_itself():
    tangent = np.cos(np.pi - np.arcsin(10.0 / 20.0))
    assert float(switching(20.0, tangent, **EXAMPLE, k=0.12)) == 0.0


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
@given(V=speeds, r_d=radii, above=st.floats(1.01, 100))
def test_the_radius_fed_is_the_one_that_reaches_the_radius_asked_for(law, V, r_d, above):
    k = above * law.gain_bound(V, r_d)
    assert law.reached_radius(V, law.fed_radius(V, r_d, k), k) == pytest.approx(r_d, rel=1e-9)
