"""The only clock."""

import time

import pytest

from circnav_mav.runtime import clock as clock_module
from circnav_mav.runtime.clock import AutopilotClock, Clock, local_time_name


@pytest.fixture
def ticking(monkeypatch):
    """A clock of the computer that the test moves."""
    times = {"now": 1000.0}
    monkeypatch.setattr(clock_module, "steady", lambda: times["now"])
    return times


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_seconds_count_from_the_start_at_the_runs_speed(ticking, speed):
    clock = Clock(speed)
    assert clock.now() == 0.0
    ticking["now"] += 2.5
    assert clock.now() == 2.5 * speed


def test_times_are_whole_microseconds(ticking):
    clock = Clock(3.0)
    ticking["now"] += 0.1234567891
    assert clock.now() * 1e6 == pytest.approx(round(clock.now() * 1e6), abs=1e-6)
    assert clock.now() == 0.370370


def test_the_wait_for_a_moment_is_in_real_seconds(ticking):
    clock = Clock(10.0)
    assert clock.until(5.0) == pytest.approx(0.5)
    ticking["now"] += 1.0
    assert clock.until(5.0) == 0.0


@pytest.mark.skipif(not hasattr(time, "CLOCK_BOOTTIME"), reason="only Linux tells how long it slept")
@pytest.mark.parametrize("make", [Clock, lambda: AutopilotClock(lambda: None)], ids=["ours", "the autopilot's"])
def test_time_goes_on_while_the_computer_sleeps(make, monkeypatch):
    """The lid is closed for ten minutes: the pilot has to see the gap."""
    clock, slept = make(), {time.CLOCK_BOOTTIME: 600.0}
    before, tell = clock.now(), time.clock_gettime
    monkeypatch.setattr(time, "clock_gettime", lambda which: tell(which) + slept.get(which, 0.0))
    assert clock.now() - before == pytest.approx(600.0, abs=1.0)


def test_how_long_something_takes_is_in_real_seconds_whatever_the_runs_speed(ticking):
    clock = Clock(10.0)
    began = clock.real()
    ticking["now"] += 2.5
    assert clock.real() - began == 2.5


def test_a_jump_of_the_wall_clock_moves_nothing(ticking, monkeypatch):
    clock = Clock()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    ticking["now"] += 1.0
    assert clock.now() == 1.0


@pytest.mark.parametrize("make", [Clock, lambda: AutopilotClock(lambda: None)], ids=["ours", "the autopilot's"])
def test_the_epoch_is_the_wall_clock_at_second_0(make, monkeypatch):
    monkeypatch.setattr(time, "time_ns", lambda: 1_790_000_000_123_456_789)
    assert make().epoch_us == 1_790_000_000_123_456


def test_run_folders_sort_by_time(monkeypatch):
    monkeypatch.setattr(time, "localtime", lambda *_: time.struct_time((2026, 3, 1, 9, 5, 7, 0, 60, 0)))
    assert len(local_time_name()) == len("20260301-090507")
