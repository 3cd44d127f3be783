"""The only clock."""

import re
import time

import pytest

from circnav_mav.runtime import clock as clock_module
from circnav_mav.runtime.clock import AutopilotClock, Clock, local_time_name

BOTH = pytest.mark.parametrize("make", [Clock, lambda: AutopilotClock(lambda: None)], ids=["ours", "the autopilot's"])


@pytest.fixture
def ticking(monkeypatch):
    """A clock of the computer that the test moves."""
    times = {"now": 1000.0}
    monkeypatch.setattr(clock_module, "steady", lambda: times["now"])
    return times


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_seconds_count_from_the_start_at_the_runs_speed_and_waits_are_real(ticking, speed):
    clock = Clock(speed)
    began = clock.real()
    assert clock.now() == 0.0
    ticking["now"] += 2.5
    assert (clock.now(), clock.real() - began) == (2.5 * speed, 2.5)
    assert clock.until(5.0 * speed) == pytest.approx(2.5)
    assert clock.until(2.0 * speed) == 0.0


def test_times_are_whole_microseconds(ticking):
    clock = Clock(3.0)
    ticking["now"] += 0.1234567891
    assert clock.now() == 0.370370


@pytest.mark.skipif(not hasattr(time, "CLOCK_BOOTTIME"), reason="only Linux tells how long it slept")
@BOTH
def test_time_goes_on_while_the_computer_sleeps(make, monkeypatch):
    """The lid is closed for ten minutes: the pilot has to see the gap."""
    clock, slept = make(), {time.CLOCK_BOOTTIME: 600.0}
    before, tell = clock.now(), time.clock_gettime
    monkeypatch.setattr(time, "clock_gettime", lambda which: tell(which) + slept.get(which, 0.0))
    assert clock.now() - before == pytest.approx(600.0, abs=1.0)


@BOTH
def test_the_epoch_is_the_wall_clock_at_second_0_whose_jumps_move_nothing(make, ticking, monkeypatch):
    monkeypatch.setattr(time, "time_ns", lambda: 1_790_000_000_123_456_789)
    clock = make()
    assert clock.epoch_us == 1_790_000_000_123_456
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    ticking["now"] += 1.0
    assert clock.now() == 1.0


def test_run_folders_sort_by_time():
    assert re.fullmatch(r"20\d{6}-\d{6}", local_time_name())
