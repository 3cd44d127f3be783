"""A circle is flown with a quiet stick over a slow link, too: what the radius error does not show, the servos feel."""

import pytest

from sim.faults.pipe import Impairment, Pipe
from tests.flight.lockstep import clockwise_turns, flight, last_third, rms_error, unrest

SECONDS = 110.0


@pytest.mark.parametrize(("mission", "most"), [("arduplane", 1.5), ("ardurover", 4.0)])
def test_a_link_that_takes_a_while_does_not_make_the_turn_swing(mission: str, most: float) -> None:
    """A tenth of a second each way, more or less: what a companion on a loaded machine or a quick radio has. most:
    standard deviation of the turn command, deg/s; the turn itself is 8 deg/s."""
    flown = flight(mission, f"limits.duration_s={SECONDS}", law="auto")
    flown.down, flown.up = (Pipe(Impairment(delay=0.05, jitter=0.1, in_order=True), seed) for seed in (1, 2))
    flown.fly(SECONDS)
    assert unrest(flown) < most
    assert rms_error(last_third(flown), flown.pilot.settings.orbit.radius) < 0.5
    assert clockwise_turns(last_third(flown)) > 0.2
