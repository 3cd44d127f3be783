"""The scheduler of ticks: steps of the pilot at which no range arrives."""

import itertools
import random

import pytest

from circnav_mav.pilot.tick_scheduler import TickScheduler

TICK = 0.05


def stepped(
    hz: float, jitter: float = 0.0, seconds: float = 20.0, lost: float = 0.0
) -> tuple[list[float], int]:
    """Return the times (s) of the steps of a pilot, and the number of ranges.

    Ranges arrive at `hz`, each late by up to `jitter` (s). Times are whole microseconds, as in the
    loop.
    """
    ticks = TickScheduler(TICK)
    chance = random.Random(4)
    now = 0.0
    times = [round(n / hz + chance.uniform(0.0, jitter), 6) for n in range(round(seconds * hz))]
    ranges = [time for time in times if chance.random() >= lost]
    received = len(ranges)
    steps = []
    while now < seconds:
        now = round(max(min([ticks.due, *ranges[:1]]), 0.0), 6)
        if ranges and ranges[0] <= now:
            ticks.received(ranges.pop(0))
        ticks.stepped(now)
        steps.append(now)
    return steps, received


def gaps(steps: list[float]) -> list[float]:
    return [after - before for before, after in itertools.pairwise(steps[60:-1])]


@pytest.mark.parametrize(
    "hz", [1.0, 2.0, 4.98, 5.0, 9.9, 9.98, 10.0, 10.02, 12.0, 19.9, 19.98, 20.0, 20.1]
)
@pytest.mark.parametrize("jitter", [0.0, 0.004])
def test_scheduler_avoids_ticks_shortly_before_ranges(hz: float, jitter: float) -> None:
    apart = gaps(stepped(hz, jitter)[0])
    assert sum(gap < 0.005 for gap in apart) <= 0.05 * len(apart)
    assert max(apart) <= 1.5 * TICK + 1e-9
    assert 18 <= len(apart) / sum(apart) <= 24.5


def test_scheduler_steps_at_every_range_of_fast_radio() -> None:
    steps, received = stepped(100.0)
    assert len(steps) == pytest.approx(received, abs=3)


@pytest.mark.parametrize(("late", "due"), [(0.2, 1.45), (0.3, 1.0), (0.4, 1.0)])
def test_scheduler_waits_for_range_expected_within_quarter_tick(late: float, due: float) -> None:
    """late: time from the next tick to the expected range. due: time of the next step. Both in
    ticks."""
    ticks = TickScheduler(TICK)
    for n in range(3):
        ticks.received((n - 2) * (1 + late) * TICK)
    ticks.stepped(0.0)
    assert ticks.due == pytest.approx(due * TICK)


def test_scheduler_waits_only_once_for_missing_range() -> None:
    apart = gaps(stepped(9.98, lost=0.4)[0])
    assert max(apart) <= 1.5 * TICK + 1e-9
    assert sum(gap > 1.2 * TICK for gap in apart) < 0.25 * len(apart)


def test_scheduler_keeps_ticks_aligned_with_range_times() -> None:
    """The benchmark's array engine assumes a fixed grid of ticks, with or without lost ranges."""
    steps, _ = stepped(10.0, lost=0.4)
    assert max(abs(step / TICK - round(step / TICK)) for step in steps) < 1e-6


def test_scheduler_makes_tick_due_immediately_on_request() -> None:
    ticks = TickScheduler(TICK)
    ticks.stepped(1.0)
    assert ticks.due == 1.0 + TICK
    ticks.at_once()
    assert ticks.due < 0
