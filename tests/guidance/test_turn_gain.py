"""The turn-rate gain: gaps, compass wrap, and a minute without turning."""

from copy import deepcopy
from math import exp, pi, remainder, sin

import numpy as np
import pytest

from circnav_mav.guidance.types import TurnRate
from circnav_mav.guidance.vehicle_model import TurnGain

COMMAND = TurnRate(-0.2)
STEP = 0.05


def turned(before: TurnGain, start: float, seconds: float, rate: float) -> TurnGain:
    """Return the estimate after the heading has turned at a rate (rad/s) for some time under the
    same command."""
    gain = deepcopy(before)
    for n in range(round(seconds / STEP)):
        gain.learn(start + n * STEP, gain.heading + rate * STEP, COMMAND, 0.4)
    return gain


def test_turn_gain_is_kept_during_minute_without_turning() -> None:
    slipping = turned(TurnGain(), 0.0, 120.0, 0.65 * COMMAND)
    assert slipping.followed
    assert slipping.gain == pytest.approx(0.65, abs=0.02)
    flown = turned(TurnGain(), 0.0, 60.0, 0.9 * COMMAND)
    assert flown.gain == pytest.approx(0.9, abs=0.02)
    stands = turned(flown, 60.0, 60.0, 0.0)
    assert not stands.followed
    assert stands.gain == pytest.approx(0.9, abs=0.06)
    soon = turned(stands, 120.0, 2.0, 0.9 * COMMAND)
    assert soon.gain == stands.gain, "the low-pass filter still contains samples without turning"
    later = turned(stands, 120.0, 5.0, 0.9 * COMMAND)
    assert later.followed
    assert later.gain == pytest.approx(0.9, abs=0.08)


@pytest.mark.parametrize(
    ("flown", "least", "most"), [(0.4, 0.5, 0.8), (1.7, 1.1, 1.6)], ids=["weak", "strong"]
)
def test_turn_gain_stays_plausible_in_implausible_turns(flown, least, most) -> None:
    """No vehicle flies 0.4 or 1.7 of its commands: a bank limit or a wrong compass causes this."""
    assert least < turned(TurnGain(), 0.0, 120.0, flown * COMMAND).gain < most


def test_turn_gain_follows_change_within_35_s() -> None:
    before = turned(TurnGain(), 0.0, 90.0, 0.95 * COMMAND)
    assert turned(before, 90.0, 35.0, 0.7 * COMMAND).gain == pytest.approx(0.7, abs=0.06)


def test_turn_gain_is_learned_on_large_circle() -> None:
    """On a circle of 500 m radius at 15 m/s, the command is 0.03 rad/s."""
    gain = TurnGain()
    for n in range(2400):
        gain.learn(n * STEP, 0.75 * 0.03 * n * STEP, 0.03, 0.4)
    assert gain.gain == pytest.approx(0.75, abs=0.06)


@pytest.mark.parametrize("command", [0.015, 0.03])
def test_unflown_turn_is_noticed_on_circles_up_to_500_m(command) -> None:
    """At 15 m/s, the command on a circle of 1000 m radius is too small to judge in noise."""
    gain = TurnGain()
    for n in range(200):
        gain.learn(n * STEP, 0.0, command, 0.4)
    assert gain.followed == (command < 0.02)


@pytest.mark.parametrize("swing", [0.3, 1.0])
def test_turn_gain_is_exact_despite_turn_lag(swing: float) -> None:
    """The command oscillates at 0.3 or 1 rad/s. A lag of 0.4 s then delays the turn by 7 or 20 deg
    of phase."""
    state = TurnGain()
    heading = 0.0
    rate = 0.0
    lag = 0.4
    for n in range(2400):
        command = TurnRate(0.2 * sin(swing * n * STEP))
        rate += (0.8 * command - rate) * (1 - exp(-STEP / lag))
        heading += rate * STEP
        state.learn(n * STEP, heading, command, lag)
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
        state.learn(time, measured, command, 0.3)
        assert step < 300 or state.gain == pytest.approx(0.85, abs=0.05)
