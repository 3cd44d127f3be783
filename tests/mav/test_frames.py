"""The sign seam: the paper's frame against MAVLink's."""

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.types import TurnRate
from circnav_mav.mav.frames import (
    YawRate,
    compass_from_vector,
    course_from_yaw,
    turn_rate_from_yaw_rate,
    yaw_rate_from_turn_rate,
)


@given(rate=st.floats(-10, 10))
def test_the_sign_changes_once_and_back(rate):
    assert yaw_rate_from_turn_rate(TurnRate(rate)) == -rate
    assert turn_rate_from_yaw_rate(YawRate(rate)) == -rate


@pytest.mark.parametrize(
    ("yaw", "course"), [(0.0, pi / 2), (pi / 2, 0.0), (-pi / 2, pi), (pi, -pi / 2), (pi / 4, pi / 4)]
)
def test_north_is_up_and_east_is_right(yaw, course):
    """Heading clockwise from north, course counter-clockwise from east."""
    assert course_from_yaw(yaw) == pytest.approx(course)


@pytest.mark.parametrize(("x", "y", "bearing"), [(0, 1, 0.0), (1, 0, pi / 2), (0, -1, pi), (-1, 0, 3 * pi / 2)])
def test_a_vector_to_the_north_is_bearing_zero_and_to_the_east_a_quarter_turn(x, y, bearing):
    assert compass_from_vector(x, y) == pytest.approx(bearing)


@given(yaw=st.floats(-10, 10), turn=st.floats(-0.5, 0.5))
def test_a_course_lies_within_half_a_turn_and_falls_as_the_yaw_rises(yaw, turn):
    course, turned = course_from_yaw(yaw), course_from_yaw(yaw + turn)
    assert -pi < course <= pi
    assert (turned - course + turn + pi) % (2 * pi) - pi == pytest.approx(0, abs=1e-9)
