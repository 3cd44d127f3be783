"""The loop: what it receives, sends, records, and how it is stopped."""

import signal

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.runtime.recorder import LoopStep
from circnav_mav.runtime.runner import Onlookers, StopRequest, listen, run


def frame(number):
    speaker = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    speaker.seq = number
    return bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(speaker))


class FakeClock:
    """Time moves by a tick each time it is asked."""

    longest_wait = 0.05

    def __init__(self):
        self.time = 0.0

    def now(self):
        self.time += 0.05
        return self.time

    def until(self, moment):
        return 0.0

    def advance(self, moment):
        pass

    def real(self):
        return 0.0


class FakeLink:
    errors = 0

    def __init__(self, incoming=()):
        self.incoming = list(incoming)
        self.sent = []

    def fileno(self):
        return None

    def receive(self, now):
        return [self.incoming.pop(0)] if self.incoming else []

    def send(self, data, to):
        self.sent.append((data, to))

    def close(self):
        pass


class FakePilot:
    """Ends after some steps, or two steps after an interrupt."""

    def __init__(self, steps=5):
        self.left = steps
        self.heard, self.interrupts = [], []
        self.held_back = 0
        self.outcome = None
        self.next_tick = 0.0
        self.reply_to = "the vehicle"

    @property
    def done(self):
        return self.left <= 0

    def receive(self, data, now, source, link):
        self.heard.append((data, source, link))

    def answer(self, now):
        return frame(self.left - 1)

    def follow_up(self, now):
        self.left -= 1
        return frame(100 + self.left)

    def step(self, now):
        return self.answer(now) + self.follow_up(now)

    def hold_back(self):
        self.held_back += 1

    def hello(self, now):
        return b"hello"

    def interrupt(self, now, reason):
        assert not self.interrupts, "once is enough"
        self.interrupts.append(reason)
        self.outcome, self.left = "interrupted", 2

    def take_frames(self):
        return [data for data, _, _ in self.heard[-1:]]

    def take_records(self):
        return [self.left]


class FakeRecorder:
    def __init__(self):
        self.kept, self.ticked, self.steps = [], [], []

    def step(self, step):
        self.steps.append(step)
        self.kept += step.said

    def ticks(self, records):
        self.ticked += records


@pytest.fixture
def stop():
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield StopRequest()
    for number, handler in before.items():
        signal.signal(number, handler)


def test_what_comes_in_is_given_to_the_pilot_with_its_source_and_link(stop):
    pilot = FakePilot()
    links = {"vehicle": FakeLink([(b"a", "x"), (b"b", "y")]), "ranging": FakeLink([(b"c", "radio")])}
    run(pilot, links, FakeClock(), FakeRecorder(), lambda *_: None, stop)
    assert pilot.heard == [(b"a", "x", "vehicle"), (b"c", "radio", "ranging"), (b"b", "y", "vehicle")]


def test_what_the_pilot_says_goes_to_the_vehicle_and_whole_frames_to_the_recorder(stop):
    pilot, recorder, vehicle = FakePilot(2), FakeRecorder(), FakeLink()
    run(pilot, {"vehicle": vehicle}, FakeClock(), recorder, lambda *_: None, stop)
    said = [frame(1), frame(101), frame(0), frame(100)]  # the setpoint on its own, at once
    assert vehicle.sent == [(one, "the vehicle") for one in said]
    assert recorder.kept == [frame(1), frame(101), frame(0), frame(100)]
    assert recorder.ticked == [1, 0]


def test_a_ranging_link_is_greeted_and_gets_no_setpoints(stop):
    ranging = FakeLink()
    run(FakePilot(2), {"vehicle": FakeLink(), "ranging": ranging}, FakeClock(), FakeRecorder(), lambda *_: None, stop)
    assert ranging.sent == [(b"hello", None)] * 2


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_interrupts_the_pilot_once_and_lets_it_say_goodbye(stop, number):
    pilot, vehicle = FakePilot(1000), FakeLink()
    signal.raise_signal(number)
    signal.raise_signal(number)
    run(pilot, {"vehicle": vehicle}, FakeClock(), FakeRecorder(), lambda *_: None, stop)
    assert pilot.interrupts == [signal.Signals(number).name]
    assert len(vehicle.sent) == 4


def test_the_newest_tick_is_shown_after_every_step(stop):
    shown = []
    run(
        FakePilot(3),
        {"vehicle": FakeLink()},
        FakeClock(),
        FakeRecorder(),
        lambda tick, step: shown.append((tick, step.time)),
        stop,
    )
    assert shown == [(2, 0.05), (1, 0.1), (0, pytest.approx(0.15))]


class StoppedAt(FakeClock):
    """The process is stopped for a time, s, at a moment of its second step; the run goes at ten times real time."""

    def __init__(self, seconds):
        super().__init__()
        self.stood, self.seconds = 0.0, seconds

    def now(self):
        return super().now() + 10 * self.stood

    def real(self):
        return self.time / 10 + self.stood

    def stop(self):
        self.stood += self.seconds


@pytest.mark.parametrize(("seconds", "stands"), [(0.4, False), (5.0, True)])
@pytest.mark.parametrize("moment", ["reading", "decoding", "deciding", "following up"])
def test_what_was_to_be_said_before_the_process_stood_still_is_not_said_after_it(stop, seconds, stands, moment):
    """The vehicle may be in other hands by then; a setpoint or a mode would be of before."""
    pilot, recorder, clock = FakePilot(3), FakeRecorder(), StoppedAt(seconds)
    vehicle = FakeLink([(b"a", "x")] * 3)
    places = {"reading": (vehicle, "receive"), "decoding": (pilot, "receive"), "deciding": (pilot, "answer")}
    where, name = places.get(moment, (pilot, "follow_up"))
    does, calls = getattr(where, name), []

    def stops(*arguments):
        calls.append(arguments)
        if len(calls) == 2:
            clock.stop()
        return does(*arguments)

    setattr(where, name, stops)
    run(pilot, {"vehicle": vehicle}, clock, recorder, lambda *_: None, stop)
    held_back = stands and moment != "following up"  # the setpoint was sent before
    assert len(vehicle.sent) == 6 - stands - held_back
    assert pilot.held_back == held_back == sum(step.held_back for step in recorder.steps)
    assert recorder.kept == [words for words, _ in vehicle.sent], "the log tells what was sent"
    assert len(recorder.steps) == 3, "and all that was heard"


def test_what_is_heard_after_the_process_stood_still_at_the_sockets_is_of_after_it(stop):
    """A range dated seconds before it was sent would make every later one look old."""
    clock, vehicle, recorder = StoppedAt(5.0), FakeLink([(b"a", "x")] * 3), FakeRecorder()
    reads = vehicle.receive

    def stops(now):
        if len(vehicle.incoming) == 2:
            clock.stop()
        return reads(now)

    vehicle.receive = stops
    run(FakePilot(3), {"vehicle": vehicle}, clock, recorder, lambda *_: None, stop)
    assert [step.time > 50 for step in recorder.steps] == [False, True, True]


class Turns:
    """Counts the turns that it is told of, as a signing time is."""

    def __init__(self):
        self.count = 0

    def turn(self):
        self.count += 1


def test_the_time_of_signatures_goes_on_in_every_turn(stop):
    flying, listening = Turns(), Turns()
    run(FakePilot(3), {"vehicle": FakeLink()}, FakeClock(), FakeRecorder(), lambda *_: None, stop, flying)
    listen(FakePilot(3), {"vehicle": FakeLink()}, FakeClock(), stop, listening)
    assert (flying.count, listening.count) == (3, 3)


def test_an_onlooker_that_fails_is_shown_no_more_and_the_others_go_on():
    seen, tries = [], []

    def breaks(newest, step):
        tries.append(step.time)
        if step.time > 1.0:
            raise ValueError("Out of range float values are not JSON compliant")

    onlookers = Onlookers({"live page": breaks, "display": lambda newest, step: seen.append(step.time)})
    for moment in (1.0, 2.0, 3.0):
        onlookers.show(None, LoopStep(moment))
    assert seen == [1.0, 2.0, 3.0]
    assert tries == [1.0, 2.0]
    assert onlookers.problems == [
        "live page: stopped at 2.0 s: ValueError('Out of range float values are not JSON compliant')"
    ]


def test_what_comes_in_before_all_is_loaded_is_thrown_away(stop):
    pilot, loaded = FakePilot(), iter([False, False, True])
    vehicle = FakeLink([(b"a", "x"), (b"b", "x"), (b"c", "x"), (b"d", "x")])
    run(pilot, {"vehicle": vehicle}, FakeClock(), FakeRecorder(), lambda *_: None, stop, ready=lambda: next(loaded))
    assert [data for data, _, _ in pilot.heard] == [b"c", b"d"]
    assert len(vehicle.sent) == 10, "it speaks all the while"


def test_a_setpoint_leaves_before_anything_is_recorded_or_shown(stop, monkeypatch):
    order = []
    pilot, vehicle, recorder = FakePilot(1), FakeLink(), FakeRecorder()
    monkeypatch.setattr(vehicle, "send", lambda words, _: order.append("setpoint" if words == frame(0) else "the rest"))
    monkeypatch.setattr(pilot, "take_records", lambda: order.append("records worked out") or [0])
    monkeypatch.setattr(recorder, "step", lambda _: order.append("recorded"))
    run(pilot, {"vehicle": vehicle}, FakeClock(), recorder, lambda *_: order.append("shown"), stop)
    assert order == ["setpoint", "the rest", "records worked out", "recorded", "shown"]
