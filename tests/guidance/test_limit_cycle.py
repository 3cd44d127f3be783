"""What counts as a turn command that swings from limit to limit, and what does not."""

from math import pi, sin

import pytest

from circnav_mav.guidance.watches import LEAST, CommandWatch

LIMIT, STEP = 0.45, 0.05


def watched(command, seconds=60.0):
    """After a command given as a function of time, cut to the limit."""
    watch = CommandWatch()
    for i in range(round(seconds / STEP)):
        watch = watch.watch(i * STEP, min(max(command(i * STEP), -LIMIT), LIMIT), LIMIT)
    return watch


@pytest.mark.parametrize("period", [1.0, 2.5, 4.6])  # as seen on firmware
def test_a_command_that_swings_between_its_limits_is_a_cycle_and_lowers_the_gains(period):
    watch = watched(lambda t: 0.17 + 0.6 * sin(2 * pi * t / period))
    assert watch.cycles >= 1
    assert watch.share < 1


def test_the_gains_are_not_lowered_without_end():
    assert watched(lambda t: sin(2 * pi * t), 600.0).share == LEAST


@pytest.mark.parametrize(
    "command",
    [
        lambda t: 0.15 + 0.1 * sin(2 * pi * t / 40),  # the circle in wind
        lambda t: 0.15 + 0.15 * sin(2 * pi * t / 1.5),  # restless, but far from the limits
        lambda t: 0.7 * LIMIT * sin(2 * pi * t / 6),  # the weave of a search
        lambda t: LIMIT if t < 3 else -LIMIT if t < 6 else LIMIT if t < 8 else 0.15,  # an approach
    ],
    ids=["wind", "restless", "weave", "approach"],
)
def test_what_a_flight_needs_is_no_cycle(command):
    assert watched(command).share == 1.0


def test_a_cycle_that_stops_lowers_the_gains_no_further():
    share = watched(lambda t: 0.6 * sin(2 * pi * t) if t < 8 else 0.15, 30.0).share
    assert share == watched(lambda t: 0.6 * sin(2 * pi * t) if t < 8 else 0.15, 300.0).share < 1.0
