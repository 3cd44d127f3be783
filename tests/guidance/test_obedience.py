"""Commanded against flown turns: a vehicle that does not follow, a turn rate that oscillates, and
harmless cases."""

from math import pi, sin

import numpy as np
import pytest

from circnav_mav.guidance.obedience import LEAST, LimitCycle, Obedience
from circnav_mav.guidance.turn_response import BIN, CandidateTurns, TurnBin, TurnBins

LIMIT = 0.5
DELAYS = (0, 1, 2, 4)
"""Delay of the candidates in these tests, bins."""


class Monitor:
    """Obedience and limit cycle of one vehicle."""

    def __init__(self):
        self.obedience = Obedience()
        self.limit_cycle = LimitCycle(LIMIT)

    @property
    def follows(self):
        return self.obedience.follows

    @property
    def share(self):
        return self.limit_cycle.share


def monitored(command, flown, seconds=30.0, *, noise=0.0, monitor=None, start=0.0, lap=0.0):
    """Return the monitor after some time. command: turn rate by time. flown: turn rate by time and
    the commands so far, newest last. lap: duration of a lap round the located target, s."""
    monitor = monitor or Monitor()
    rng = np.random.default_rng(4)
    said = [0.0] * 20
    monitor.limit_cycle.lap = lap
    for i in range(round(seconds / BIN)):
        time = start + i * BIN
        said.append(min(max(command(time), -LIMIT), LIMIT))
        predicted = np.array([said[-1 - late] for late in DELAYS])
        turn = flown(time, said) + noise * rng.standard_normal()
        monitor.obedience.judge(TurnBin(time, BIN, predicted, turn))
        monitor.limit_cycle.judge(time, turn, said[-1])
    return monitor


def circle(time):
    """An approach with alternating turns, then a circle in wind."""
    return 0.5 * np.sign(sin(0.9 * time)) if time < 12 else 0.15 + 0.08 * sin(2 * pi * time / 30)


@pytest.mark.parametrize("gain", [0.4, 0.7, 1.0, 1.5])
@pytest.mark.parametrize("late", [0, 2, 4])
def test_a_vehicle_that_follows_late_and_by_any_gain_in_gusts_raises_nothing(gain, late):
    assert monitored(circle, lambda time, said: gain * said[-1 - late], 120.0, noise=0.05).follows


@pytest.mark.parametrize(
    "flown",
    [
        lambda time, said: 0.0,
        lambda time, said: 0.12,
        lambda time, said: -said[-2],
        lambda time, said: 0.1 * said[-2],
    ],
    ids=["flies straight", "turns by itself", "reversed", "weak"],
)
def test_one_that_does_not_is_found_within_5_s_of_the_turns(flown):
    assert not monitored(circle, flown, 5.0, noise=0.01).follows


def test_one_wrong_bin_is_no_disobedience():
    assert monitored(
        lambda t: 0.2, lambda t, said: -0.5 if t % 15 < BIN else said[-2], 120.0, noise=0.01
    ).follows


def test_what_is_followed_again_ends_it_and_a_turn_that_does_not_change_does_not():
    stopped = monitored(circle, lambda time, said: 0.0, 5.0)
    assert stopped.obedience.since < 5.0
    steady = monitored(lambda time: 0.3, lambda time, said: 0.3, 20.0, monitor=stopped, start=5.0)
    assert not steady.follows
    assert monitored(
        lambda time: 0.3 * sin(time), lambda time, said: said[-2], 10.0, monitor=steady, start=25.0
    ).follows


def test_commands_too_small_to_tell_raise_nothing():
    assert monitored(lambda time: 0.01, lambda time, said: 0.0, 60.0, noise=0.01).follows


@pytest.mark.parametrize("period", [1.0, 1.4, 2.5, 3.0])
def test_a_swing_of_up_to_3_s_is_a_cycle_within_15_s_and_lowers_the_gains_but_not_without_end(
    period,
):
    def swing(time):
        return 0.15 + 0.25 * sin(2 * pi * time / period)

    def follow(time, said):
        return said[-2]

    assert monitored(swing, follow, 15.0, noise=0.02).share < 1.0
    assert monitored(swing, follow, 200.0, noise=0.02).share == LEAST


@pytest.mark.parametrize(
    "lap", [0.0, 12.0, 40.0], ids=["not located", "a lap of two periods", "located"]
)
@pytest.mark.parametrize("period", [5.0, 7.5])
def test_a_slow_swing_is_a_cycle_once_the_target_is_located_unless_it_repeats_with_the_lap(
    period, lap
):
    def swing(time):
        return 0.15 + 0.25 * sin(2 * pi * time / period)

    found = monitored(swing, lambda time, said: said[-2], 40.0, noise=0.02, lap=lap)
    assert (found.share < 1.0) == (lap == 40.0)


@pytest.mark.parametrize(
    "command",
    [
        lambda time: 0.15 + 0.1 * sin(2 * pi * time / 40),
        lambda time: 0.15 + 0.12 * sin(2 * pi * time / 1.5),
        lambda time: 0.35 * sin(2 * pi * time / 6),
        lambda time: 0.15 if time > 16 else LIMIT if time // 2.5 % 2 == 0 else -LIMIT,
    ],
    ids=[
        "the circle in wind",
        "restless, but small",
        "the weave of a search",
        "an approach, six times to and fro",
    ],
)
def test_what_a_flight_needs_is_no_cycle(command):
    assert monitored(command, lambda time, said: said[-2], 60.0).share == 1.0


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("frequency", [2.6, 1.1])
def test_gusts_are_no_cycle_however_large(seed, frequency):
    """Noise through a loop with a period of 2.4 s or 6 s and a damping of 0.3."""
    rng = np.random.default_rng(seed)
    state = [0.0, 0.0]

    def gusty(time):
        for _ in range(10):
            back = frequency**2 * state[0] + 2 * 0.3 * frequency * state[1]
            rate = state[1] - back * 0.02 + rng.standard_normal() * 0.18 * frequency / 2.6
            state[:] = state[0] + rate * 0.02, rate
        return state[0]

    assert monitored(gusty, lambda time, said: said[-2], 120.0, lap=60.0).share == 1.0


def test_a_swing_that_stops_lowers_the_gains_no_further():
    shares = [
        monitored(
            lambda t: 0.4 * sin(2 * pi * t) if t < 8 else 0.15, lambda t, said: said[-2], seconds
        ).share
        for seconds in (30.0, 200.0)
    ]
    assert shares[0] == shares[1] < 1.0


def test_a_link_whose_delay_is_estimated_anew_changes_no_prediction():
    candidates = CandidateTurns()
    bins = TurnBins(candidates)
    rates = []
    for i in range(400):
        time = 0.05 * i
        candidates.command(time, 0.2)
        new = bins.add(time, 0.2 * time, 0.05 if i % 17 < 9 else 0.6)
        if new is not None and time > 3.0:
            rates.append(new.predicted)
    assert len(rates) > 30
    assert np.allclose(rates, 0.2)
