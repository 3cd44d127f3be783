"""A circle is flown with a quiet stick: what the radius error does not show, the servos feel."""

import numpy as np
import pytest

from sim.faults.impairment import Impairment
from sim.faults.pipe import Pipe
from tests.flight.lockstep import clockwise_turns, flight, last_third, rms_error

SECONDS = 150.0
UNREST = {
    "quickstart": 1.5,
    "arduplane": 1.5,
    "ardurover": 4.0,
    "px4_copter": 4.5,
    "px4_plane": 2.5,
    "px4_plane_attitude": 2.5,
}
"""Standard deviation of the commanded turn rate on the circle, deg/s, that each mission may have under `auto`; the turn
itself is 5 .. 13 deg/s."""


def unrest(flown):
    """Of the commanded turn rate over the last third, deg/s."""
    turns = [tick.turn_rate for tick in flown.ticks if tick.time > flown.now * 2 / 3 and tick.turn_rate is not None]
    return float(np.degrees(np.std(turns)))


def sense(flown):
    """+1 for clockwise, as the mission asks."""
    return -flown.pilot.settings.orbit.direction.turn_sign


@pytest.mark.parametrize("mission", ["quickstart", "px4_copter", "px4_plane", "px4_plane_attitude"])
def test_auto_holds_the_circle_in_the_sense_of_the_mission_with_a_steady_turn(mission):
    """ArduPlane and ArduCopter, over a link: test_ringing.py. PX4's copter goes by a velocity estimate that is off by
    .2 m/s and more; the firmware flew .6 .. 1.3 m."""
    flown = flight(mission, f"limits.duration_s={SECONDS}", law="auto").fly(SECONDS)
    radius = flown.pilot.settings.orbit.radius
    assert rms_error(last_third(flown), radius) < (1.4 if mission == "px4_copter" else 0.02 * radius)
    assert unrest(flown) < UNREST[mission]
    assert clockwise_turns(last_third(flown)) * sense(flown) > 0.2


@pytest.mark.parametrize("mission", ["arduplane", "ardurover"])
def test_a_link_that_takes_a_while_does_not_make_the_turn_swing(mission):
    """A tenth of a second each way, more or less: what a companion on a loaded machine or a quick radio has."""
    flown = flight(mission, f"limits.duration_s={SECONDS}", law="auto")
    flown.down, flown.up = (Pipe(Impairment(delay=0.05, jitter=0.1, in_order=True), seed) for seed in (1, 2))
    flown.fly(SECONDS)
    assert unrest(flown) < UNREST[mission]
    assert rms_error(last_third(flown), flown.pilot.settings.orbit.radius) < 0.5
    assert clockwise_turns(last_third(flown)) * sense(flown) > 0.2
