"""The clocks of a run: the local clock, the autopilot's clock (with gaps, reboots, pauses and the
wrap of its counter), and simulated time, which advances from event to event."""

import math
import random
import re
import time
from itertools import pairwise

import pytest

from circnav_mav.runtime import clock as clock_module
from circnav_mav.runtime import lockstep
from circnav_mav.runtime.clock import AutopilotClock, Clock, local_time_name
from circnav_mav.runtime.lockstep import Lockstep

BOTH = pytest.mark.parametrize(
    "make", [Clock, lambda: AutopilotClock(lambda: None)], ids=["local clock", "autopilot clock"]
)
WRAP = 2**32 / 1000


@pytest.fixture
def ticking(monkeypatch):
    """The computer's clock, which the test advances."""
    times = {"now": 1000.0}
    for module in (clock_module, lockstep):
        monkeypatch.setattr(module, "steady", lambda: times["now"])
    return times


def whole_microseconds(moment):
    return moment * 1e6 == pytest.approx(round(moment * 1e6), abs=1e-4)


# --- the local clock


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_local_clock_runs_at_speed_of_run(ticking, speed):
    clock = Clock(speed)
    began = clock.real()
    assert clock.now() == 0.0
    ticking["now"] += 2.5
    assert (clock.now(), clock.real() - began) == (2.5 * speed, 2.5)
    assert clock.until(5.0 * speed) == pytest.approx(2.5)
    assert clock.until(2.0 * speed) == 0.0
    ticking["now"] += 0.1234567891
    assert whole_microseconds(clock.now())


@pytest.mark.skipif(not hasattr(time, "CLOCK_BOOTTIME"), reason="only Linux counts suspended time")
@BOTH
def test_local_clock_includes_suspended_time(make, monkeypatch):
    """The computer is suspended for ten minutes. The clock must include this gap, so that the pilot
    detects it."""
    clock = make()
    slept = {time.CLOCK_BOOTTIME: 600.0}
    before = clock.now()
    gettime = time.clock_gettime
    monkeypatch.setattr(time, "clock_gettime", lambda which: gettime(which) + slept.get(which, 0.0))
    assert clock.now() - before == pytest.approx(600.0, abs=1.0)


@BOTH
def test_local_clock_ignores_wall_clock_jumps(make, ticking, monkeypatch):
    assert re.fullmatch(r"20\d{6}-\d{6}", local_time_name()), (
        "the names of run folders sort by time"
    )
    monkeypatch.setattr(time, "time_ns", lambda: 1_790_000_000_123_456_789)
    clock = make()
    assert clock.epoch_us == 1_790_000_000_123_456
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    ticking["now"] += 1.0
    assert clock.now() == 1.0


# --- the autopilot's clock


class Autopilot:
    """An autopilot whose time since boot runs at `speed` times real time, and the clock that
    follows it."""

    def __init__(self, ticking):
        self.ticking = ticking
        self.boot = 100.0
        self.speed = 1.0
        self.reported = None
        self.times = []
        self.clock = AutopilotClock(lambda: self.reported)

    def run(self, seconds, *, every=0.05, late=None):
        """Let real time pass, s. The clock is read every 10 ms. It receives a boot time every
        `every` s of the autopilot's time, `late()` s after it was measured. Return the time by
        which the clock advanced, s."""
        before = self.clock.now()
        due = self.boot + every
        for _ in range(round(seconds / 0.01)):
            self.ticking["now"] += 0.01
            self.boot += 0.01 * self.speed
            if self.boot >= due:
                self.reported = (self.boot - (late() if late else 0.0)) % WRAP
                due += every * max(1, (self.boot - due) // every + 1)
            self.times.append(self.clock.now())
        assert self.times == sorted(self.times)
        return self.times[-1] - before

    def silent(self, seconds):
        return self.run(seconds, every=float("inf"))


@pytest.fixture
def autopilot(ticking):
    return Autopilot(ticking)


def lateness(seed):
    """Return a function that draws the delay of a message, s, with a mean of 50 ms."""
    draw = random.Random(seed)
    return lambda: draw.expovariate(1 / 0.05)


@pytest.mark.parametrize("speed", [0.2, 1.0, 5.0])
def test_autopilot_clock_runs_in_real_time_before_first_message(autopilot, speed):
    """At first only SYSTEM_TIME arrives, once per second, because ATTITUDE has not been requested
    yet."""
    assert autopilot.silent(3.0) == pytest.approx(3.0)
    assert autopilot.clock.until(4.0) == pytest.approx(1.0)
    autopilot.speed = speed
    autopilot.run(15.0, every=1.0)
    assert autopilot.run(20.0, every=1.0) == pytest.approx(20.0 * speed, rel=0.02)


def test_autopilot_clock_keeps_its_speed_while_waiting_messages_arrive(autopilot):
    """While circnav started, the messages of 1 s have waited. All arrive within 0.1 s."""
    late = lambda: 10 * (100.1 - autopilot.boot)  # noqa: E731
    autopilot.run(0.1, every=0.01, late=late)
    for _ in range(5):
        assert autopilot.run(1.0) == pytest.approx(1.0, abs=0.02)


def test_autopilot_clock_has_no_long_term_drift(autopilot):
    """The speed of the simulator varies by 10 %, and its messages are late. After 1500 s the error
    of the clock is below 1 s."""
    autopilot.speed = 5.0
    draw = random.Random(2)
    late = lateness(2)
    autopilot.run(5.0)
    lead = autopilot.clock.now() - autopilot.boot
    for _ in range(30):
        autopilot.speed = draw.uniform(4.5, 5.5)
        autopilot.run(10.0, late=late)
    autopilot.speed = 5.0
    autopilot.run(5.0)
    assert autopilot.clock.now() - autopilot.boot == pytest.approx(lead, abs=1.0)


def test_autopilot_clock_is_steady_despite_late_messages(autopilot):
    autopilot.speed = 5.0
    late = lateness(1)
    autopilot.run(3.0, late=late)
    autopilot.times.clear()
    autopilot.run(20.0, late=late)
    steps = [after - before for before, after in pairwise(autopilot.times)]
    assert 0.4 * 0.05 < min(steps) < max(steps) < 2 * 0.05
    assert sum(steps) == pytest.approx(5.0 * 20.0, rel=0.01)


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_autopilot_clock_continues_through_silence(autopilot, speed):
    autopilot.speed = speed
    autopilot.run(5.0)
    assert autopilot.silent(10.0) == pytest.approx(10.0 * speed, rel=0.02)
    assert autopilot.run(5.0) == pytest.approx(5.0 * speed, rel=0.05)


def reboots(autopilot):
    autopilot.boot = 0.0


def stands_still(autopilot):
    """Pause the simulator: silence, and then the boot time continues from its last value."""
    stood = autopilot.boot
    autopilot.silent(10.0)
    autopilot.boot = stood


def changes_places(autopilot):
    """Receive an older message after a newer one."""
    before = autopilot.clock.now()
    autopilot.reported -= 0.2
    assert autopilot.clock.now() == before


@pytest.mark.parametrize(
    ("boot", "speed", "known", "then", "jump"),
    [
        (100.0, 5.0, 3.0, 5.0, reboots),
        (100.0, 1.0, 0.15, 1.0, reboots),
        (WRAP - 25.0, 5.0, 3.0, 5.0, lambda autopilot: None),
        (100.0, 5.0, 3.0, 5.0, stands_still),
        (100.0, 1.0, 5.0, 2.0, changes_places),
    ],
    ids=[
        "reboot",
        "reboot before the speed is known",
        "wrap of 32-bit milliseconds",
        "pause",
        "disorder",
    ],
)
def test_autopilot_clock_does_not_jump_with_boot_time(autopilot, boot, speed, known, then, jump):
    autopilot.boot = boot
    autopilot.speed = speed
    autopilot.run(known)
    jump(autopilot)
    for _ in range(2):
        assert autopilot.run(then) == pytest.approx(then * speed, rel=0.02)
    assert autopilot.clock.speed == pytest.approx(speed, rel=0.01)


@pytest.mark.parametrize(
    "speeds", [(1.0, 5.0), (5.0, 1.0), (1.0, 100.0), (20.0, 0.2), (1 / 3, 1.0)]
)
def test_autopilot_clock_follows_changes_of_simulation_speed(autopilot, speeds):
    for autopilot.speed in speeds:
        autopilot.run(5.0)
        assert autopilot.run(5.0) == pytest.approx(5.0 * autopilot.speed, rel=0.01)
        assert autopilot.clock.speed == pytest.approx(autopilot.speed, rel=0.01)
    assert all(map(whole_microseconds, autopilot.times))


# --- simulated time


class Metronome:
    """A vehicle that acts every 20 ms and records its calls."""

    def __init__(self):
        self.time = 0.0
        self.received = []

    @property
    def next_event(self):
        return (math.floor(self.time * 50 + 1e-6) + 1) / 50

    def advance(self, until):
        self.time = until

    def receive(self, data, link):
        self.received.append((link, data))

    def outgoing(self, link):
        return [link.encode()]


def test_lockstep_clock_jumps_to_the_next_event(ticking):
    clock = Lockstep(Metronome())
    seen = []
    for moment in (0.05, 0.05, 0.05, 0.1):
        assert clock.until(moment) == 0.0
        ticking["now"] += 100.0
        clock.advance(moment)
        seen.append((clock.now(), clock.real()))
    assert seen == [(0.02, 0.02), (0.04, 0.04), (0.05, 0.05), (0.06, 0.06)]


def test_paced_lockstep_clock_waits_in_real_time(ticking):
    clock = Lockstep(Metronome(), speed=0.5)
    for expected in (0.02, 0.04, 0.06):
        wait = clock.until(1.0)
        assert wait == pytest.approx(0.04, abs=1e-9)
        ticking["now"] += wait - 1e-4  # a wait may end slightly early
        clock.advance(1.0)
        assert clock.now() == expected
        ticking["now"] = 1000.0 + expected / 0.5


@pytest.mark.parametrize(
    ("others", "passed", "goes_on"),
    [(False, 0.005, 0.005), (True, 0.3, 0.3), (False, 3600.0, 0.02)],
    ids=[
        "wait interrupted by signal",
        "real radio and pause",
        "suspended for a night",
    ],
)
def test_paced_lockstep_clock_follows_real_time(ticking, others, passed, goes_on):
    clock = Lockstep(Metronome(), speed=1.0, others=others)
    ticking["now"] += passed
    clock.advance(1.0)
    assert clock.now() == pytest.approx(goes_on, abs=2e-6)
    while clock.until(1e9) == 0.0:
        clock.advance(1e9)
    assert clock.now() < 1.0


def test_lockstep_clock_reaches_every_tick_in_whole_microseconds():
    """If the time of a tick were rounded down to microseconds, it would be before the tick, and the
    loop would never advance."""
    clock = Lockstep(Metronome())
    for tick in range(1, 2_000):
        moment = math.nextafter(tick * 1e-6, 1.0)
        clock.advance(moment)
        assert clock.now() >= moment
        assert whole_microseconds(clock.now())


def test_lockstep_links_exchange_data_with_simulated_vehicle():
    vehicle = Metronome()
    clock = Lockstep(vehicle)
    assert list(clock.links(ranging_apart=False)) == ["vehicle"]
    links = clock.links(ranging_apart=True)
    received = {name: link.receive(0.0) for name, link in links.items()}
    assert received == {"vehicle": [(b"main", "sim")], "ranging": [(b"ranging", "sim")]}
    links["vehicle"].send(b"go", "sim")
    assert vehicle.received == [("main", b"go")]
    assert links["vehicle"].fileno() is None
