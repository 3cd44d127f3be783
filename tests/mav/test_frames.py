"""The sign seam: the paper's frame against MAVLink's."""

from math import pi

import pytest

from circnav_mav.mav.frames import compass_from_vector, course_from_yaw


@pytest.mark.parametrize(
    ("yaw", "course"),
    [(0.0, pi / 2), (pi / 2, 0.0), (-pi / 2, pi), (pi, -pi / 2), (pi / 4, pi / 4), (7.0, 2.5 * pi - 7.0)],
)
def test_north_is_up_and_east_is_right(yaw, course):
    """Heading clockwise from north, course counter-clockwise from east, in (-pi, pi]."""
    assert course_from_yaw(yaw) == pytest.approx(course)


@pytest.mark.parametrize(("x", "y", "bearing"), [(0, 1, 0.0), (1, 0, pi / 2), (0, -1, pi), (-1, 0, 3 * pi / 2)])
def test_a_vector_to_the_north_is_bearing_zero_and_to_the_east_a_quarter_turn(x, y, bearing):
    assert compass_from_vector(x, y) == pytest.approx(bearing)
