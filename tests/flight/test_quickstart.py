"""The paper's examples 1 and 3 in lockstep over real MAVLink bytes, with RANGING_BEACON on a
separate link. test_range_rate.py flies with NAMED_VALUE_FLOAT, all other flights with
DISTANCE_SENSOR."""

import itertools

import pytest

from tests.flight.lockstep import clockwise_turns, flight, last_third, mean_radius, true_radius


@pytest.mark.parametrize(("example", "radius", "tolerance"), [(1, 10.987, 0.02), (3, 10.0, 0.05)])
def test_paper_examples_reach_radius_of_paper(example, radius, tolerance):
    """One start. tests/extras/paper and `circnav paper` simulate 60 and 2,000 starts without
    MAVLink."""
    flown = flight(f"paper_example_{example}", "limits.duration_s=68", "sim.seed=1").fly(80)
    assert flown.outcome.ending.value == "completed"
    assert mean_radius(last_third(flown)) == pytest.approx(radius, abs=tolerance)
    assert clockwise_turns(last_third(flown)) > 0.3
    if example == 1:  # the paper's lemma in_C_d_once: the circle is entered at most once
        inside = [true_radius(truth) < 10.0 for truth in flown.truths if truth.time > 2]
        assert sum(now and not before for before, now in itertools.pairwise(inside)) <= 1
