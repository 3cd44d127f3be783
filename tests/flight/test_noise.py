"""A radio that scatters by half a metre and says 2 cm."""

import pytest

from tests.flight.lockstep import clockwise_turns, flight, last_third, rms_error


@pytest.mark.parametrize(("law", "bound"), [("auto", 0.5), ("smooth", 1.5)])
def test_a_radio_that_says_too_little_of_its_noise_is_found_out_told_of_and_flown(law: str, bound: float) -> None:
    flown = flight("quickstart", "limits.duration_s=120.0", "ranging.sigma_m=0.02", law=law)
    flown.fly(130.0)
    assert flown.outcome.reason == "flown to its end"
    assert rms_error(last_third(flown), 100.0) < bound
    assert clockwise_turns(flown.truths) > 1
    assert b"expected 0.02 m" in b"".join(data for _, data in flown.sent)
    taken = flown.pilot.tracker.accepted
    assert taken > 0.9 * (taken + flown.pilot.tracker.ranging.rejected.total())
