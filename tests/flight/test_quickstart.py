"""The quickstart mission with a separate ranging link, and the paper's examples 1 and 3, in
lockstep over real MAVLink bytes."""

import itertools

import pytest

from tests.flight.lockstep import (
    clockwise_turns,
    flight,
    last_third,
    mean_radius,
    rms_error,
    true_radius,
)

BEACON = (
    'ranging.message="ranging_beacon"', 'ranging.endpoint="sim"', "ranging.beacon_id=9",
    'sim.ranging.message="ranging_beacon"', 'sim.ranging.via="direct"', "sim.ranging.beacon_id=9",
)  # fmt: skip


def test_quickstart_circles_with_ranging_beacon_on_separate_link() -> None:
    """Ranges as RANGING_BEACON. test_range_rate.py flies with NAMED_VALUE_FLOAT, all other flights
    with DISTANCE_SENSOR."""
    flown = flight(
        "quickstart", 'orbit.direction="clockwise"', "limits.duration_s=55", *BEACON
    ).fly(65)
    assert flown.outcome.ending.value == "completed"
    assert rms_error(last_third(flown), 100.0) < 2.0
    assert clockwise_turns(last_third(flown)) > 0.35


@pytest.mark.parametrize(("example", "radius", "tolerance"), [(1, 10.987, 0.02), (3, 10.0, 0.05)])
def test_paper_examples_reach_radius_of_paper(example, radius, tolerance):
    """One start. tests/extras/paper and `circnav paper` simulate 60 and 2,000 starts without
    MAVLink."""
    flown = flight(f"paper_example_{example}", "limits.duration_s=80", "sim.seed=1").fly(90)
    assert flown.outcome.ending.value == "completed"
    assert mean_radius(last_third(flown)) == pytest.approx(radius, abs=tolerance)
    assert clockwise_turns(last_third(flown)) > 0.35
    if example == 1:  # the paper's lemma in_C_d_once: the circle is entered at most once
        inside = [true_radius(truth) < 10.0 for truth in flown.truths if truth.time > 2]
        assert sum(now and not before for before, now in itertools.pairwise(inside)) <= 1
