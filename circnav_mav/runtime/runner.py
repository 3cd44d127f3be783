"""The loop of a flight and of preflight: wait, receive, step, send. Everything it needs comes in as an argument."""

import select
import signal
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from types import FrameType

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.mav.framing import split_frames
from circnav_mav.pilot import RANGING, VEHICLE, Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.survey import Survey
from circnav_mav.runtime.clock import Clock
from circnav_mav.runtime.keys import SigningTime
from circnav_mav.runtime.links import Link
from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.recorder import Recorder

LONGEST_STEP = 0.5
"""Real time, s, since the begin of a step after which nothing is sent in it: the process was stopped meanwhile, and the
vehicle may be in other hands. The pilot itself detects a stall between two steps."""


ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT)
"""Signals that end a flight safely: Ctrl-C, a service that is stopped, and Ctrl-\\, which is beside Ctrl-C."""


class StopRequest:
    """The signals that end a flight as a flag that also wakes the loop."""

    def __init__(self) -> None:
        self.signal_name: str | None = None
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        self.claim()

    def claim(self) -> None:
        """Install the handlers. Call again after another package was loaded: rospy, for one, installs its own."""
        for number in ENDING:
            signal.signal(number, self._on_signal)

    def release(self) -> None:
        """Let a signal end the process again. A thread that a driver left running would keep it for ever."""
        for number in ENDING:
            signal.signal(number, signal.SIG_DFL)

    def fileno(self) -> int:
        """Becomes readable when a signal has come."""
        return self._reader.fileno()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.signal_name = signal.Signals(number).name
        with suppress(BlockingIOError):  # so many signals that the loop is awake anyway
            self._writer.send(b"!")


def run(
    pilot: Pilot,
    links: Mapping[str, Link],
    clock: Clock,
    recorder: Recorder,
    onlookers: Onlookers,
    stop: StopRequest,
    signing_time: SigningTime | None = None,
) -> None:
    """Fly until the pilot is done and no onlooker is busy. Every step and tick goes to the recorder."""
    loop = Loop(pilot, links, clock, recorder, onlookers)
    while not loop.over:
        wait(links, stop, min(clock.until(loop.due), clock.longest_wait))
        if signing_time is not None:
            signing_time.turn()
        loop.step(stop.signal_name)


class Loop:
    """The loop of one flight, a step at a time."""

    def __init__(
        self, pilot: Pilot, links: Mapping[str, Link], clock: Clock, recorder: Recorder, onlookers: Onlookers
    ) -> None:
        self.now = 0.0
        """Time of the newest step, s."""
        self._pilot, self._links, self._clock = pilot, links, clock
        self._recorder, self._onlookers = recorder, onlookers
        self._newest: TickRecord | None = None

    @property
    def over(self) -> bool:
        """True once the pilot is done and no onlooker is busy."""
        return self._pilot.done and not self._onlookers.busy

    @property
    def due(self) -> float:
        """Time of the next step at the latest, s."""
        return self.now + self._clock.longest_wait if self._pilot.done else self._pilot.scheduler.due

    def step(self, signal_name: str | None = None) -> None:
        """Go on to the next thing that happens. signal_name: of a signal that has come to end the flight."""
        pilot, links, onlookers = self._pilot, self._links, self._onlookers
        self._clock.advance(self.due)
        step = turn(pilot, links, self._clock, self.now, signal_name, onlookers.circle_requests(self.now))
        self.now = step.time
        records = pilot.take_records()
        self._newest = records[-1] if records else self._newest
        frames = onlookers.on_step(self._newest, step, self._recorder.problem, called_off=signal_name is not None)
        if frames:
            links[VEHICLE].send(b"".join(frames), pilot.session.reply_to)
            step.attached = frames
        step.exchanged = onlookers.take_exchanged(self.now)
        self._recorder.step(step)
        self._recorder.ticks(records)


def turn(
    pilot: Pilot,
    links: Mapping[str, Link],
    clock: Clock,
    before: float,
    signal_name: str | None = None,
    requests: Sequence[CircleRequest] = (),
) -> LoopStep:
    """Run one step of the loop: receive, decide, send. before: time of the last one. signal_name: signal that ends the
    flight. requests: for another circle, from outside of the pilot."""
    began = clock.real()
    received = [(name, *one) for name, link in links.items() for one in link.receive(before)]
    now = clock.now()  # a range that came while we stood still is not dated before it was sent
    step = LoopStep(now)
    for name, data, source in received:
        pilot.receive(data, now, source, name)
        step.heard.append((name, source, pilot.take_frames()))
    for request in requests:
        step.requests.append(request)
        pilot.request_circle(request, now)
    if signal_name and pilot.mission.outcome is None:
        step.interrupt = signal_name
        pilot.interrupt(now, signal_name)

    def is_late() -> bool:
        return clock.real() - began > LONGEST_STEP

    def send(data: bytes) -> bool:
        if is_late():
            return False
        links[VEHICLE].send(data, pilot.session.reply_to)
        step.said += split_frames(data)
        return True

    pilot.step(now, send)
    step.held_back = is_late() and not step.said
    step.hello = split_frames(_greet(pilot, links, now))
    return step


def listen(
    survey: Survey,
    links: Mapping[str, Link],
    clock: Clock,
    stop: StopRequest,
    signing_time: SigningTime | None = None,
) -> None:
    """Listen until the survey is done or a signal has come."""
    while not survey.done and stop.signal_name is None:
        wait(links, stop, min(clock.until(survey.next_tick), clock.longest_wait))
        clock.advance(survey.next_tick)
        now = clock.now()
        if signing_time is not None:
            signing_time.turn()
        for name, link in links.items():
            for data, source in link.receive(now):
                survey.receive(data, now, source, name)
        if out := survey.step(now):
            links[VEHICLE].send(out, survey.session.reply_to)
        _greet(survey, links, now)


def _greet(speaker: Pilot | Survey, links: Mapping[str, Link], now: float) -> bytes:
    """Greet a ranging link that is apart; answers with the greeting."""
    hello = speaker.hello(now) if RANGING in links else b""
    if hello:
        links[RANGING].send(hello, None)
    return hello


def wait(links: Mapping[str, Link], stop: StopRequest, seconds: float) -> None:
    """Wait for bytes, a signal or the time, whichever comes first."""
    watched = [fd for link in links.values() if (fd := link.fileno()) is not None]
    if stop.signal_name is None:
        watched.append(stop.fileno())
    select.select(watched, [], [], seconds)
