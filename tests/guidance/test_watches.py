"""Watches beside the law: a drift that exceeds the limit of the circle, and the slow integral of
the radius error."""

from math import exp, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate
from circnav_mav.guidance.watches import DriftAlarm, next_trim, watch_drift
from tests.guidance.relative import known

V = 15.0
R = 100.0
LIMIT = 0.35
ORBIT = Orbit(R, Direction.CLOCKWISE, V, LIMIT)
ALLOWED = sqrt(R * V * LIMIT) - V
"""(V + W)^2 = V omega_max r_d, solved for W: 7.91 m/s."""
QUIET = DriftAlarm()


def after(drifts, most_turn=LIMIT, *, alarm=QUIET, start=0.0, trusted=True):
    """Return the alarm after drift estimates at 10 Hz."""
    for at, drift in enumerate(drifts):
        motion = known(drift_x=0.6 * drift, drift_y=0.8 * drift, trusted=trusted)
        alarm = watch_drift(
            alarm,
            RangeEstimate(start + 0.1 * at, 100.0, 0.0, 0.5, 0.1, relative=motion),
            ORBIT,
            most_turn,
        )
    return alarm


@pytest.mark.parametrize(
    ("most", "allowed"), [(LIMIT, ALLOWED), (0.72 * LIMIT, sqrt(0.72 * R * V * LIMIT) - V)]
)
def test_it_is_raised_at_the_drift_that_the_turn_rate_really_reached_allows(most, allowed):
    """Downwind the ground speed is at most V + W, and the course turns at V/(V + W) of the nose's
    rate."""
    assert not after([allowed - 0.01] * 100, most).on
    raised = after([allowed + 0.01] * 100, most)
    assert (raised.on, raised.allowed) == (True, pytest.approx(allowed))


def test_a_gust_raises_nothing_a_lull_does_not_end_it_and_what_is_not_trusted_changes_nothing():
    assert not after(([ALLOWED + 2] * 25 + [ALLOWED - 0.1] * 5) * 4).on
    raised = after([ALLOWED + 2] * 40)
    assert after([0.95 * ALLOWED], alarm=raised, start=5.0).on
    assert not after([0.89 * ALLOWED], alarm=raised, start=5.0).on
    assert after([0.0] * 40, alarm=raised, trusted=False) == raised
    assert (
        after([ALLOWED + 2] * 40, trusted=False) == watch_drift(QUIET, None, ORBIT, LIMIT) == QUIET
    )


def trimmed(trim, error, saturated=False, change=0.0):
    """Radius trim after 0.1 s off a circle of 100 m at 15 m/s, with 0.05/s. It grows within 20 m of
    the circle, up to 15 m."""
    return next_trim(
        trim,
        rate=0.05,
        r=100.0 + error,
        change=change,
        r_d=100.0,
        V=15.0,
        step=0.1,
        saturated=saturated,
    )


@pytest.mark.parametrize(
    ("trim", "error", "saturated", "after"),
    [
        (0.0, 2.0, False, -0.01),
        (-0.3, -2.0, False, -0.29),
        (0.0, 22.0, False, 0.0),
        (-2.2, 22.0, False, -2.2),
        (2.2, -22.0, False, 2.2),
        (-8.0, -22.0, False, -7.89),
        (0.1, 300.0, False, 0.0),
        (15.0, -10.0, False, 15.0),
        (-1.0, 2.0, True, -1.0),
    ],
    ids=[
        "it grows against an error",
        "to either side",
        "it does not begin far from the circle",
        "nor grow there",
        "nor inside",
        "it unwinds there",
        "to nothing and not beyond",
        "it is bounded",
        "it stands still at the limit of the turn",
    ],
)
def test_the_trim_holds_the_mean_radius(trim, error, saturated, after):
    assert trimmed(trim, error, saturated) == pytest.approx(after)


def test_an_approach_that_settles_by_itself_leaves_next_to_nothing():
    trim = 0.0
    for step in range(300):
        error = 40.0 * exp(
            -step / 25.0
        )  # with 2.5 s; counting 2.5 s in full within 20 m would give 2.5 m
        trim = trimmed(trim, error, change=-error / 25.0)
    assert abs(trim) < 0.25


@given(trim=st.floats(-15.0, 15.0), error=st.floats(-300.0, 300.0))
def test_it_stays_within_its_bound_and_never_grows_outside_of_its_room(trim, error):
    after = trimmed(trim, error)
    assert abs(after) <= 15.0
    if abs(error) > 20.0:
        assert abs(after) <= abs(trim)
        assert after * trim >= 0
