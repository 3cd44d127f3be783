"""The default gains: above the source's bound, the paper's where nothing forbids them, lower where the loop is late."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.tuning import default_gain, loop_lag

speeds, radii, lags = st.floats(0.5, 60), st.floats(5, 2000), st.floats(0.05, 10)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
@given(V=speeds, r_d=radii, lag=lags)
def test_every_default_gain_meets_its_own_condition_and_is_none_higher_in_a_later_loop(law, V, r_d, lag):
    gain = default_gain(law.name, V, r_d, lag)
    assert gain > law.gain_bound(V, r_d)
    assert default_gain(law.name, V, r_d, 2 * lag) <= gain


def test_default_gains_are_those_of_the_papers_examples():
    """k = 0.01 in examples 1 and 2, k = 0.12 in example 3, at V = 1 and r_d = 10; there the loop has no lag."""
    assert default_gain("smooth", 1.0, 10.0, 0.1) == pytest.approx(0.01)
    assert default_gain("switching", 1.0, 10.0, 0.1) == pytest.approx(0.12)


@pytest.mark.parametrize("law", ["feedforward", "pd", "pi", "drift", "auto"])
def test_a_late_loop_gets_the_gain_at_which_vehicles_do_not_swing(law):
    """k V lag = 0.5, above which autopilots were seen in a limit cycle."""
    assert 15.0 * 1.0 * default_gain(law, 15.0, 100.0, 1.0) == pytest.approx(0.5)


def test_the_loop_is_as_late_as_turn_and_filter_together():
    settings = EstimatorSettings(15.0, 0.35)
    quick, slow = (loop_lag(0.4, settings, r_d=100.0, sigma=sigma, period=0.1) for sigma in (0.1, 2.0))
    assert 0.4 < quick < slow
    assert loop_lag(1.4, settings, r_d=100.0, sigma=2.0, period=0.1) == pytest.approx(slow + 1.0)
