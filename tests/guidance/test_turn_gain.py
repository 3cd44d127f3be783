"""The turn-rate gain: learning from a vehicle that receives no commands, and over gaps."""

from math import exp, pi, remainder, sin

import numpy as np
import pytest

from circnav_mav.guidance.turn_gain import TurnGain, learn
from circnav_mav.guidance.types import TurnRate

COMMAND = TurnRate(-0.2)
STEP = 0.05


def turned(state: TurnGain, start: float, seconds: float, rate: float) -> TurnGain:
    """Return the state after the heading has turned at a rate (rad/s) for some time under the same
    command."""
    heading = state.heading
    for n in range(round(seconds / STEP)):
        heading += rate * STEP
        state = learn(state, lag=0.4, time=start + n * STEP, heading=heading, command=COMMAND)
    return state


def test_gain_is_learnt_however_poor_and_survives_a_minute_in_which_the_vehicle_stands_still() -> (
    None
):
    slipping = turned(TurnGain(), 0.0, 120.0, 0.65 * COMMAND)
    assert slipping.followed
    assert slipping.gain == pytest.approx(0.65, abs=0.02)
    flown = turned(TurnGain(), 0.0, 60.0, 0.9 * COMMAND)
    assert flown.gain == pytest.approx(0.9, abs=0.02)
    unheard = turned(flown, 60.0, 60.0, 0.0)
    assert not unheard.followed
    assert unheard.gain == pytest.approx(0.9, abs=0.06)
    soon = turned(unheard, 120.0, 2.0, 0.9 * COMMAND)
    assert soon.gain == unheard.gain, "the low-pass still remembers the vehicle that stood"
    received = turned(unheard, 120.0, 5.0, 0.9 * COMMAND)
    assert received.followed
    assert received.gain == pytest.approx(0.9, abs=0.08)


@pytest.mark.parametrize("swing", [0.3, 1.0])
def test_the_lag_of_a_vehicle_whose_command_swings_hides_no_lack_of_turn(swing: float) -> None:
    """A swing of 0.3 or 1 rad/s and a lag of 0.4 s give 7 and 20 deg of phase."""
    state = TurnGain()
    heading = 0.0
    rate = 0.0
    lag = 0.4
    for n in range(2400):
        command = TurnRate(0.2 * sin(swing * n * STEP))
        rate += (0.8 * command - rate) * (1 - exp(-STEP / lag))
        heading += rate * STEP
        state = learn(state, lag=lag, time=n * STEP, heading=heading, command=command)
    assert state.gain == pytest.approx(0.8, abs=0.03)


def test_turn_gain_is_learned_over_gaps_and_compass_wrap() -> None:
    rng = np.random.default_rng(0)
    time = 0.0
    heading = 3.0
    state = TurnGain()
    for step in range(900):
        time += 1.0 if step == 300 else 0.0 if step % 50 == 9 else STEP
        command = 0.2 * sin(step / 40) + 0.1
        heading += 0.85 * command * STEP + rng.normal(0, 1e-3)
        measured = remainder(heading, 2 * pi)
        state = learn(state, lag=0.3, time=time, heading=measured, command=command)
        assert step < 300 or state.gain == pytest.approx(0.85, abs=0.05)
