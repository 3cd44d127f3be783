"""The loop: received, sent and recorded data, and its end."""

import signal
from unittest.mock import Mock

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.runtime.listeners import Listener, Listeners
from circnav_mav.runtime.runner import ENDING, StopRequest, listen, run


def frame(number):
    speaker = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    speaker.seq = number % 256
    return bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(speaker))


class FakeClock:
    """A clock that advances by one tick at each reading and runs at ten times real time. `stop`:
    simulates a process that is stopped for some seconds."""

    longest_wait = 0.05

    def __init__(self):
        self.time = self.stood = 0.0

    def now(self):
        self.time += 0.05
        return self.time + 10 * self.stood

    def until(self, moment):
        return 0.0

    def advance(self, moment):
        pass

    def real(self):
        return self.time / 10 + self.stood

    def stop(self, seconds):
        self.stood += seconds


class FakeLink:
    def __init__(self, *incoming):
        self.incoming = list(incoming)
        self.sent = []

    def fileno(self):
        return None

    def receive(self, now):
        return [self.incoming.pop(0)] if self.incoming else []

    def send(self, data, to):
        self.sent.append((data, to))


class FakePilot:
    """A pilot that ends after some steps, or two steps after an interrupt. Also used as a preflight
    listener."""

    next_tick = 0.0
    scheduler = Mock(due=0.0)
    session = Mock(reply_to="the vehicle")

    def __init__(self, steps=5):
        self.left = steps
        self.mission = Mock(outcome=None)
        self.received = []
        self.interrupts = []

    @property
    def done(self):
        return self.left <= 0

    def receive(self, data, now, source, link):
        self.received.append((data, source, link))

    def decide(self):
        return frame(self.left - 1)

    def prepare_the_rest(self):
        return frame(100 + self.left)

    def step(self, now, send=lambda data: True):
        send(self.decide())
        self.left -= 1
        send(self.prepare_the_rest())

    def hello(self, now):
        return b"hello"

    def interrupt(self, now, reason):
        assert not self.interrupts
        self.interrupts.append(reason)
        self.mission.outcome = "interrupted"
        self.left = 2

    def take_frames(self):
        return [data for data, _, _ in self.received[-1:]]

    def take_records(self):
        return [self.left]


class Showing(Listener):
    """A listener that calls a function with the newest tick and the step."""

    def __init__(self, show):
        self.show = show

    def on_step(self, newest, step, recording_problem):
        return self.show(newest, step) or ()


class FakeRecorder:
    problem = None

    def __init__(self):
        self.ticked = []
        self.steps = []
        self.step = self.steps.append
        self.ticks = self.ticked.extend

    @property
    def kept(self):
        return [words for step in self.steps for words in step.sent]


@pytest.fixture
def stop():
    before = {number: signal.getsignal(number) for number in ENDING}
    yield StopRequest()
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def fly(stop):
    """Return a function that runs a pilot to its end and returns the recorder."""

    def run_to_the_end(pilot, *listeners, clock=None, recorder=None, signing_time=None, **links):
        recorder = recorder or FakeRecorder()
        attached = Listeners([*listeners])
        run(
            pilot,
            {"vehicle": FakeLink()} | links,
            clock or FakeClock(),
            recorder,
            attached,
            stop,
            signing_time,
        )
        assert not attached.problems
        return recorder

    return run_to_the_end


def test_loop_passes_frames_between_link_pilot_and_recorder(fly):
    pilot = FakePilot(2)
    shown = []
    vehicle = FakeLink((b"a", "x"), (b"b", "y"))
    ranging = FakeLink((b"c", "radio"))
    screen = Showing(lambda tick, step: shown.append((tick, step.time)))
    recorder = fly(pilot, screen, vehicle=vehicle, ranging=ranging)
    assert pilot.received == [
        (b"a", "x", "vehicle"),
        (b"c", "radio", "ranging"),
        (b"b", "y", "vehicle"),
    ]
    # the setpoint is sent first, in a separate call
    sent_frames = [frame(1), frame(101), frame(0), frame(100)]
    assert vehicle.sent == [(one, "the vehicle") for one in sent_frames]
    assert recorder.kept == sent_frames
    assert recorder.ticked == [1, 0]
    assert ranging.sent == [(b"hello", None)] * 2
    assert shown == [(1, 0.05), (0, 0.1)]


@pytest.mark.parametrize("number", ENDING)
def test_repeated_signals_interrupt_pilot_once(fly, number):
    pilot = FakePilot(1000)
    vehicle = FakeLink()
    for _ in range(2000):
        signal.raise_signal(number)
    fly(pilot, vehicle=vehicle)
    assert pilot.interrupts == [signal.Signals(number).name]
    assert len(vehicle.sent) == 4


class Lasting(Listener):
    """A listener that is busy until a signal and then sends one frame."""

    busy = True
    steps = 0

    def on_step(self, newest, step, recording_problem):
        self.steps += 1
        if self.steps == 3:
            signal.raise_signal(signal.SIGINT)
        self.busy = not self.called_off
        return [b"streams"] if self.called_off else []


def test_loop_continues_for_busy_listener_until_a_signal(fly):
    """In the step after the signal, the listener restores the stream rates. The sent frames are
    recorded."""
    lasting = Lasting()
    pilot = FakePilot(1)
    vehicle = FakeLink()
    pilot.mission.outcome = "completed"
    recorder = fly(pilot, lasting, vehicle=vehicle)
    assert lasting.steps == 4 and vehicle.sent[-1] == (b"streams", "the vehicle")
    assert [step.attached for step in recorder.steps] == [[], [], [], [b"streams"]]


def test_frames_between_fleet_members_are_recorded_without_sending(fly):
    class Member(Listener):
        def take_exchanged(self):
            return [b"report"]

    vehicle = FakeLink()
    recorder = fly(FakePilot(2), Member(), vehicle=vehicle)
    assert [(step.exchanged, step.attached) for step in recorder.steps] == [([b"report"], [])] * 2
    assert all(data != b"report" for data, _ in vehicle.sent)


@pytest.mark.parametrize(("seconds", "is_dropped"), [(0.4, False), (5.0, True)])
@pytest.mark.parametrize("moment", ["reading", "decoding", "deciding", "preparing the rest"])
def test_loop_drops_frames_computed_before_process_was_paused(fly, seconds, is_dropped, moment):
    """The process stops in its second step. A setpoint or mode request computed before the pause
    must not be sent after it, because the operator may have taken over meanwhile."""
    pilot = FakePilot(3)
    clock = FakeClock()
    vehicle = FakeLink(*[(b"a", "x")] * 3)
    where, name = {
        "reading": (vehicle, "receive"),
        "decoding": (pilot, "receive"),
        "deciding": (pilot, "decide"),
        "preparing the rest": (pilot, "prepare_the_rest"),
    }[moment]
    does = getattr(where, name)
    calls = []

    def stops(*arguments):
        calls.append(arguments)
        if len(calls) == 2:
            clock.stop(seconds)
        return does(*arguments)

    setattr(where, name, stops)
    recorder = fly(pilot, vehicle=vehicle, clock=clock)
    # in "preparing the rest" the setpoint has already been sent
    held_back = is_dropped and moment != "preparing the rest"
    assert len(vehicle.sent) == 6 - is_dropped - held_back
    assert held_back == sum(step.held_back for step in recorder.steps)
    assert recorder.kept == [words for words, _ in vehicle.sent]
    assert len(recorder.steps) == 3
    assert [step.time > 3 for step in recorder.steps] == [False, moment == "reading", True]


def test_signing_time_advances_in_every_step(fly, stop):
    flying = Mock()
    listening = Mock()
    fly(FakePilot(3), signing_time=flying)
    listen(FakePilot(3), {"vehicle": FakeLink()}, FakeClock(), stop, listening)
    assert (flying.advance.call_count, listening.advance.call_count) == (3, 3)


def test_setpoint_is_sent_before_recording_and_display(fly, monkeypatch):
    order = []
    pilot = FakePilot(1)
    vehicle = FakeLink()
    recorder = FakeRecorder()
    monkeypatch.setattr(
        vehicle,
        "send",
        lambda words, _: order.append("setpoint" if words == frame(0) else "the rest"),
    )
    monkeypatch.setattr(pilot, "take_records", lambda: order.append("records worked out") or [0])
    monkeypatch.setattr(recorder, "step", lambda _: order.append("recorded"))
    fly(pilot, Showing(lambda *_: order.append("shown")), vehicle=vehicle, recorder=recorder)
    assert order == ["setpoint", "the rest", "records worked out", "shown", "recorded"]
