"""The slow integral of the radius error."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.circles import MOST_TRIM as MOST
from circnav_mav.guidance.circles import TRIM_NEAR as NEAR
from circnav_mav.guidance.circles import next_trim

R_D = 100.0
FAR = 1.1 * NEAR * R_D
errors = st.floats(-300.0, 300.0)
trims = st.floats(-MOST * R_D, MOST * R_D)


def trimmed(trim, error, saturated=False):
    return next_trim(trim, rate=0.05, r=R_D + error, r_d=R_D, step=0.1, saturated=saturated)


def test_it_grows_against_a_small_error():
    assert trimmed(0.0, 2.0) == pytest.approx(-0.01)
    assert trimmed(-0.3, -2.0) == pytest.approx(-0.29)


@pytest.mark.parametrize("error", [FAR, -FAR])
def test_it_does_not_grow_far_from_the_circle(error):
    assert trimmed(0.0, error) == 0.0
    assert trimmed(-error / 10, error) == -error / 10


def test_it_unwinds_far_from_the_circle_when_it_is_what_keeps_the_vehicle_there():
    assert trimmed(-8.0, -FAR) == pytest.approx(-8.0 + 0.005 * FAR)


def test_it_unwinds_to_nothing_and_not_beyond():
    assert trimmed(0.1, 300.0) == 0.0


def test_it_stands_still_while_the_turn_is_at_its_limit():
    assert trimmed(-1.0, 2.0, saturated=True) == -1.0


@given(trim=trims, error=errors)
def test_it_stays_within_its_bound_and_never_grows_outside_of_its_room(trim, error):
    after = trimmed(trim, error)
    assert abs(after) <= MOST * R_D
    if abs(error) > NEAR * R_D:
        assert abs(after) <= abs(trim)
        assert after * trim >= 0
