"""Commanded against flown turns: a vehicle that does not follow, a turn rate that oscillates, and
harmless cases."""

from math import pi, sin

import numpy as np
import pytest

from circnav_mav.guidance.command_following import CommandFollowing, LimitCycle
from circnav_mav.guidance.turn_response import BIN, CandidateTurns, TurnBin, TurnBins

LIMIT = 0.5
DELAYS = (0, 1, 2, 4)
"""Response delays that the check compares in these tests, in bins."""


class Monitor:
    """The check of followed turns and the detection of a limit cycle for one vehicle."""

    def __init__(self):
        self.command_following = CommandFollowing()
        self.limit_cycle = LimitCycle(LIMIT)

    @property
    def follows(self):
        return self.command_following.follows

    @property
    def share(self):
        return self.limit_cycle.share


def monitored(command, flown, seconds=30.0, *, noise=0.0, monitor=None, start=0.0, lap=0.0):
    """Return the monitor after some time. command: function of time; commanded turn rate, rad/s.
    flown: function of time and of the commands so far, newest last; flown turn rate, rad/s. lap:
    duration of a lap round the located target, s."""
    monitor = monitor or Monitor()
    rng = np.random.default_rng(4)
    sent = [0.0] * 20
    monitor.limit_cycle.lap = lap
    for i in range(round(seconds / BIN)):
        time = start + i * BIN
        sent.append(min(max(command(time), -LIMIT), LIMIT))
        predicted = np.array([sent[-1 - late] for late in DELAYS])
        turn = flown(time, sent) + noise * rng.standard_normal()
        monitor.command_following.judge(TurnBin(time, BIN, predicted, turn))
        monitor.limit_cycle.judge(time, turn, sent[-1])
    return monitor


def circle(time):
    """Return the commanded turn rate of an approach with alternating turns, then of a circle in
    wind."""
    return 0.5 * np.sign(sin(0.9 * time)) if time < 12 else 0.15 + 0.08 * sin(2 * pi * time / 30)


@pytest.mark.parametrize(("gain", "late"), [(0.4, 0), (0.4, 4), (1.0, 2), (1.5, 0), (1.5, 4)])
def test_command_following_accepts_delayed_weak_turns_in_gusts(gain, late):
    assert monitored(circle, lambda time, sent: gain * sent[-1 - late], 60.0, noise=0.05).follows


def test_command_following_accepts_steady_turn_at_bank_limit():
    """The command stays above the turn rate that the vehicle's own bank limit allows."""

    def command(time):
        return 0.3 * sin(time) if time < 12 else 0.45 + 0.03 * sin(time)

    def limited(time, sent):
        return min(max(sent[-2], -0.25), 0.25)

    assert monitored(command, limited, 60.0, noise=0.01).follows


@pytest.mark.parametrize(
    "flown",
    [
        lambda time, sent: 0.0,
        lambda time, sent: 0.12,
        lambda time, sent: -sent[-2],
        lambda time, sent: 0.1 * sent[-2],
    ],
    ids=["straight", "constant turn", "reversed", "weak"],
)
def test_command_following_detects_ignored_turns_within_5_s(flown):
    assert not monitored(circle, flown, 5.0, noise=0.01).follows


def test_command_following_detects_ignored_turn_of_large_circle():
    """On a circle of 500 m radius at 15 m/s, the commanded turn is 0.03 rad/s."""
    assert not monitored(lambda time: 0.03, lambda time, sent: 0.0, 15.0, noise=0.001).follows


def test_command_following_tolerates_one_wrong_turn_measurement():
    assert monitored(
        lambda t: 0.2, lambda t, sent: -0.5 if t % 15 < BIN else sent[-2], 120.0, noise=0.01
    ).follows


def test_command_following_recovers_only_with_followed_turn_changes():
    stopped = monitored(circle, lambda time, sent: 0.0, 5.0)
    assert stopped.command_following.since < 5.0
    steady = monitored(lambda time: 0.3, lambda time, sent: 0.3, 20.0, monitor=stopped, start=5.0)
    assert not steady.follows
    assert monitored(
        lambda time: 0.3 * sin(time), lambda time, sent: sent[-2], 10.0, monitor=steady, start=25.0
    ).follows


@pytest.mark.parametrize("noise", [0.001, 0.01])
def test_command_following_ignores_small_commands(noise):
    """A bank error of 3 deg at 22 m/s turns a plane by 0.023 rad/s."""
    assert monitored(lambda time: 0.02, lambda time, sent: 0.0, 60.0, noise=noise).follows


@pytest.mark.parametrize("period", [1.0, 3.0])
def test_limit_cycle_of_3_s_lowers_gains_to_bound(period):
    def swing(time):
        return 0.15 + 0.25 * sin(2 * pi * time / period)

    def follow(time, sent):
        return sent[-2]

    assert monitored(swing, follow, 15.0, noise=0.02).share < 1.0
    # A poorly damped turn loop is calmed by a sixth of the gains. A tenth cannot hold the circle.
    assert 0.1 < monitored(swing, follow, 200.0, noise=0.02).share < 1 / 6


@pytest.mark.parametrize("lap", [0.0, 12.0, 30.0], ids=["not located", "short lap", "located"])
@pytest.mark.parametrize("period", [5.0, 7.5])
def test_slow_oscillation_is_limit_cycle_only_on_longer_lap(period, lap):
    def swing(time):
        return 0.15 + 0.25 * sin(2 * pi * time / period)

    found = monitored(swing, lambda time, sent: sent[-2], 40.0, noise=0.02, lap=lap)
    assert (found.share < 1.0) == (lap == 30.0)


def test_swing_of_12_s_is_no_limit_cycle():
    """A vehicle that drifts in gusts of a long lap corrects its turn as slowly."""

    def swing(time):
        return 0.15 + 0.25 * sin(2 * pi * time / 12.0)

    assert monitored(swing, lambda time, sent: sent[-2], 100.0, lap=60.0).share == 1.0


@pytest.mark.parametrize(
    "command",
    [
        lambda time: 0.15 + 0.1 * sin(2 * pi * time / 40),
        lambda time: 0.15 + 0.12 * sin(2 * pi * time / 1.5),
        lambda time: 0.35 * sin(2 * pi * time / 6),
        lambda time: 0.15 if time > 16 else LIMIT if time // 2.5 % 2 == 0 else -LIMIT,
    ],
    ids=[
        "circle in wind",
        "small oscillation",
        "excitation",
        "alternating approach",
    ],
)
def test_limit_cycle_detection_ignores_ordinary_turns(command):
    assert monitored(command, lambda time, sent: sent[-2], 60.0).share == 1.0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("frequency", [2.6, 1.1])
def test_limit_cycle_detection_ignores_gusts(seed, frequency):
    """White noise through an oscillator with a period of 2.4 s or 6 s and a damping of 0.3."""
    rng = np.random.default_rng(seed)
    state = [0.0, 0.0]

    def gusty(time):
        for _ in range(10):
            back = frequency**2 * state[0] + 2 * 0.3 * frequency * state[1]
            rate = state[1] - back * 0.02 + rng.standard_normal() * 0.18 * frequency / 2.6
            state[:] = state[0] + rate * 0.02, rate
        return state[0]

    assert monitored(gusty, lambda time, sent: sent[-2], 120.0, lap=60.0).share == 1.0


def test_limit_cycle_detection_stops_lowering_gains_after_oscillation():
    shares = [
        monitored(
            lambda t: 0.4 * sin(2 * pi * t) if t < 8 else 0.15, lambda t, sent: sent[-2], seconds
        ).share
        for seconds in (30.0, 200.0)
    ]
    assert shares[0] == shares[1] < 1.0


def test_turn_bins_predict_steady_turn_despite_changed_link_delay():
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
