"""The paper's three examples through real MAVLink bytes: radius reached, sense of rotation, mirror image."""

import itertools

import pytest

from tests.flight.lockstep import clockwise_turns, flight, last_third, mean_radius, true_radius

SECONDS = 120
EXAMPLES = {1: (10.987, 0.02), 2: (10.0, 0.02), 3: (10.0, 0.05)}  # reached radius and tolerance, m


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_reaches_the_papers_radius_clockwise_and_enters_the_circle_once(example: int) -> None:
    """From one start; sixty, and two thousand, without MAVLink: tests/experiments, `circnav paper`."""
    flown = flight(f"paper_example_{example}", f"limits.duration_s={SECONDS}", "sim.seed=1").fly(SECONDS + 10)
    assert flown.outcome.ending.value == "completed"
    radius, tolerance = EXAMPLES[example]
    assert mean_radius(last_third(flown)) == pytest.approx(radius, abs=tolerance)
    assert clockwise_turns(last_third(flown)) > 0.5
    if example == 1:  # lemma in_C_d_once
        inside = [true_radius(truth) < 10.0 for truth in flown.truths if truth.time > 2]
        assert sum(now and not before for before, now in itertools.pairwise(inside)) <= 1
