"""The clock that goes with the autopilot: as fast as it, through gaps, reboots, pauses and the wrap of its counter."""

import random
from collections.abc import Callable, Iterator

import pytest

from circnav_mav.runtime import clock
from circnav_mav.runtime.clock import AutopilotClock

WRAP = 2**32 / 1000


class Bench:
    """An autopilot that flies `speed` times as fast as the real time, which the test moves."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.real, self.boot, self.speed = 0.0, 100.0, 1.0
        self.told: float | None = None
        self.times: list[float] = []
        monkeypatch.setattr(clock, "steady", lambda: 5000.0 + self.real)
        self.clock = AutopilotClock(lambda: self.told)

    def run(self, seconds: float, *, every: float = 0.05, late: Iterator[float] | None = None) -> float:
        """Let real time pass; the clock is read each 10 ms and hears each `every` s of the autopilot's time.

        Returns how far the clock went.
        """
        before, due = self.clock.now(), self.boot + every
        for _ in range(round(seconds / 0.01)):
            self.real += 0.01
            self.boot += 0.01 * self.speed
            if self.boot >= due:
                self.told = (self.boot - (next(late) if late else 0.0)) % WRAP
                due += every * max(1, (self.boot - due) // every + 1)
            self.times.append(self.clock.now())
        assert self.times == sorted(self.times)
        return self.times[-1] - before


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def silent(bench: Bench, seconds: float) -> float:
    return bench.run(seconds, every=float("inf"))


def test_before_the_first_boot_time_it_is_the_local_clock(bench: Bench) -> None:
    assert silent(bench, 3.0) == pytest.approx(3.0)
    assert bench.clock.until(4.0) == pytest.approx(1.0)


def test_times_are_whole_microseconds(bench: Bench) -> None:
    bench.speed = 1 / 3
    bench.run(3.0)
    assert all(moment * 1e6 == pytest.approx(round(moment * 1e6), abs=1e-4) for moment in bench.times)


@pytest.mark.parametrize("speed", [0.2, 1.0, 5.0])
def test_a_boot_time_once_a_second_is_enough(bench: Bench, speed: float) -> None:
    """SYSTEM_TIME alone, before ATTITUDE was asked for."""
    bench.speed = speed
    bench.run(15.0, every=1.0)
    assert bench.run(20.0, every=1.0) == pytest.approx(20.0 * speed, rel=0.02)


def test_it_does_not_drift_away_in_the_long_run(bench: Bench) -> None:
    """A simulator that cannot quite hold its speed, heard late: within a second in 1500."""
    bench.speed = 5.0
    draw = random.Random(2)
    late = iter(lambda: draw.expovariate(1 / 0.05), None)
    bench.run(5.0)
    lead = bench.clock.now() - bench.boot
    for _ in range(30):
        bench.speed = draw.uniform(4.5, 5.5)
        bench.run(10.0, late=late)
    bench.speed = 5.0
    bench.run(5.0)
    assert bench.clock.now() - bench.boot == pytest.approx(lead, abs=1.0)


def test_late_messages_make_it_neither_jump_nor_stand_still(bench: Bench) -> None:
    draw = random.Random(1)
    late = iter(lambda: draw.expovariate(1 / 0.05), None)
    bench.speed = 5.0
    bench.run(3.0, late=late)
    bench.times.clear()
    bench.run(20.0, late=late)
    steps = [b - a for a, b in zip(bench.times, bench.times[1:], strict=False)]
    assert max(steps) < 2 * 0.05
    assert min(steps) > 0.4 * 0.05
    assert sum(steps) == pytest.approx(5.0 * 20.0, rel=0.01)


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_time_goes_on_through_a_silence_and_after_it_without_a_jump(bench: Bench, speed: float) -> None:
    bench.speed = speed
    bench.run(5.0)
    assert silent(bench, 10.0) == pytest.approx(10.0 * speed, rel=0.02)
    assert bench.run(5.0) == pytest.approx(5.0 * speed, rel=0.05)


def reboots(bench: Bench) -> None:
    bench.boot = 0.0


def stands_still(bench: Bench) -> None:
    """A simulator that is paused: silence, and then the boot time goes on where it stopped."""
    stood = bench.boot
    silent(bench, 10.0)
    bench.boot = stood


@pytest.mark.parametrize(
    ("boot", "jump"),
    [(100.0, reboots), (WRAP - 25.0, lambda bench: None), (100.0, stands_still)],
    ids=["a reboot", "the wrap of 32 bits of milliseconds", "a pause"],
)
def test_a_jump_of_the_boot_time_moves_nothing(bench: Bench, boot: float, jump: Callable[[Bench], None]) -> None:
    bench.boot, bench.speed = boot, 5.0
    bench.run(3.0)
    jump(bench)
    for _ in range(2):
        assert bench.run(5.0) == pytest.approx(25.0, rel=0.02)
    assert bench.clock.speed == pytest.approx(5.0, rel=0.01)


def test_a_reboot_before_the_speed_is_known_moves_nothing_either(bench: Bench) -> None:
    bench.run(0.15)
    bench.boot = 0.0
    assert bench.run(1.0) == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(("before", "after"), [(1.0, 5.0), (5.0, 1.0), (1.0, 100.0), (20.0, 0.2)])
def test_it_takes_the_autopilots_speed_and_follows_a_change_within_seconds(
    bench: Bench, before: float, after: float
) -> None:
    for speed in (before, after):
        bench.speed = speed
        bench.run(5.0)
        assert bench.run(5.0) == pytest.approx(5.0 * speed, rel=0.01)
        assert bench.clock.speed == pytest.approx(speed, rel=0.01)


def test_two_messages_that_changed_places_change_nothing(bench: Bench) -> None:
    bench.run(5.0)
    newest, before = bench.told, bench.clock.now()
    assert newest is not None
    bench.told = newest - 0.2
    assert bench.clock.now() == before
    assert bench.run(2.0) == pytest.approx(2.0, rel=0.02)
    assert bench.clock.speed == pytest.approx(1.0, rel=0.01)
