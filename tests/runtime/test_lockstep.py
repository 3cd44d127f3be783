"""Simulated time: it goes from event to event, a pace only waits, and a wait cut short does not run ahead."""

import math

import pytest

from circnav_mav.runtime import clock as clock_module
from circnav_mav.runtime import lockstep
from circnav_mav.runtime.lockstep import Lockstep


class Metronome:
    """A vehicle that does something every 20 ms, and notes what it is asked."""

    def __init__(self):
        self.time, self.heard = 0.0, []

    @property
    def next_event(self):
        return (math.floor(self.time * 50 + 1e-6) + 1) / 50

    def advance(self, until):
        self.time = until

    def receive(self, data, link):
        self.heard.append((link, data))

    def outgoing(self, link):
        return [link.encode()]


@pytest.fixture
def ticking(monkeypatch):
    """A clock of the computer that the test moves."""
    times = {"now": 1000.0}
    for module in (clock_module, lockstep):
        monkeypatch.setattr(module, "steady", lambda: times["now"])
    return times


def test_without_a_pace_time_goes_to_whatever_comes_first_however_long_the_computer_takes(ticking):
    clock = Lockstep(Metronome())
    seen = []
    for moment in (0.05, 0.05, 0.05, 0.1):
        assert clock.until(moment) == 0.0
        ticking["now"] += 100.0
        clock.advance(moment)
        seen.append((clock.now(), clock.real()))
    assert seen == [(0.02, 0.02), (0.04, 0.04), (0.05, 0.05), (0.06, 0.06)]


def test_a_pace_waits_in_real_seconds_and_ends_at_the_same_times(ticking):
    clock = Lockstep(Metronome(), speed=0.5)
    for expected in (0.02, 0.04, 0.06):
        wait = clock.until(1.0)
        assert wait == pytest.approx(0.04, abs=1e-9)
        ticking["now"] += wait - 1e-4  # as a wait may end
        clock.advance(1.0)
        assert clock.now() == expected
        ticking["now"] = 1000.0 + expected / 0.5


def test_a_wait_cut_short_by_a_signal_does_not_run_ahead_of_the_pace(ticking):
    clock = Lockstep(Metronome(), speed=1.0)
    ticking["now"] += 0.005
    clock.advance(1.0)
    assert clock.now() == pytest.approx(0.005, abs=2e-6)


def test_a_paced_run_does_not_race_after_a_night_of_sleep(ticking):
    clock = Lockstep(Metronome(), speed=1.0)
    ticking["now"] += 3600.0
    clock.advance(1.0)
    assert clock.now() == 0.02
    while clock.until(1e9) == 0.0:
        clock.advance(1e9)
    assert clock.now() < 1.0


def test_beside_a_real_radio_time_keeps_up_with_it(ticking):
    """Its ranges are of now, also after a pause."""
    clock = Lockstep(Metronome(), speed=1.0, others=True)
    ticking["now"] += 0.3
    clock.advance(1.0)
    assert clock.now() == pytest.approx(0.3, abs=2e-6)


def test_every_tick_that_is_due_is_reached_in_whole_microseconds():
    """A product rounded down would be a time before the tick, and the loop would turn there for ever."""
    clock = Lockstep(Metronome())
    for tick in range(1, 2_000):
        moment = math.nextafter(tick * 1e-6, 1.0)
        clock.advance(moment)
        assert clock.now() >= moment
        assert clock.now() * 1e6 == pytest.approx(round(clock.now() * 1e6), abs=1e-6)


def test_the_links_are_the_vehicles_and_nobody_waits_on_them():
    vehicle = Metronome()
    clock = Lockstep(vehicle)
    assert list(clock.links(ranging_apart=False)) == ["vehicle"]
    links = clock.links(ranging_apart=True)
    assert {name: link.receive(0.0) for name, link in links.items()} == {
        "vehicle": [(b"main", "sim")],
        "ranging": [(b"ranging", "sim")],
    }
    links["vehicle"].send(b"go", "sim")
    assert vehicle.heard == [("main", b"go")]
    assert links["vehicle"].fileno() is None
