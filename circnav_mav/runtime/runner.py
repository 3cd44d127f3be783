"""Loop of a flight and of preflight: wait, receive, step, send. All dependencies are arguments."""

import select
import signal
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from types import FrameType

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.mav.framing import split_frames
from circnav_mav.pilot import RANGING, VEHICLE, Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.preflight.listener import PreflightListener
from circnav_mav.runtime.clock import Clock
from circnav_mav.runtime.keys import SigningTime
from circnav_mav.runtime.links import Link
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.recorder import Recorder
from circnav_mav.time_limit import time_limit

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT)
"""Signals that end a flight safely: SIGINT (Ctrl-C), SIGTERM (a stopped service) and SIGQUIT
(Ctrl-\\, which is easily typed instead of Ctrl-C)."""


class StopRequest:
    """Flag that is set by the signals in ENDING, and wakes the loop."""

    def __init__(self) -> None:
        self.signal_name: str | None = None
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        self.claim()

    def claim(self) -> None:
        """Install the signal handlers. Call again after loading a package that may install handlers
        of its own, such as rospy."""
        for number in ENDING:
            signal.signal(number, self._on_signal)

    def release(self) -> None:
        """Restore the default handlers. A signal then ends the process, even if a thread of a
        driver still runs."""
        for number in ENDING:
            signal.signal(number, signal.SIG_DFL)

    def fileno(self) -> int:
        """Return a descriptor that becomes readable after a signal."""
        return self._reader.fileno()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.signal_name = signal.Signals(number).name
        with suppress(BlockingIOError):  # the socket is full of signals, so the loop wakes anyway
            self._writer.send(b"!")


def run(
    pilot: Pilot,
    links: Mapping[str, Link],
    clock: Clock,
    recorder: Recorder,
    listeners: Listeners,
    stop: StopRequest,
    signing_time: SigningTime | None = None,
    limit: Callable[[], AbstractContextManager[None]] = time_limit,
) -> None:
    """Fly until `Pilot` is done and no listener is busy. Record every step and tick. limit: time
    limit of a step."""
    loop = Loop(pilot, links, clock, recorder, listeners)
    while not loop.over:
        wait(links, stop, min(clock.until(loop.due), clock.longest_wait))
        if signing_time is not None:
            signing_time.advance()
        with limit():
            loop.step(stop.signal_name)


class Loop:
    """Loop of a flight, run step by step."""

    def __init__(
        self,
        pilot: Pilot,
        links: Mapping[str, Link],
        clock: Clock,
        recorder: Recorder,
        listeners: Listeners,
    ) -> None:
        self.now = 0.0
        """Time of the newest step, s."""
        self._pilot = pilot
        self._links = links
        self._clock = clock
        self._recorder = recorder
        self._listeners = listeners
        self._newest: TickRecord | None = None

    @property
    def over(self) -> bool:
        """True if `Pilot` is done and no listener is busy."""
        return self._pilot.done and not self._listeners.busy

    @property
    def due(self) -> float:
        """Latest time of the next step, s."""
        return (
            self.now + self._clock.longest_wait if self._pilot.done else self._pilot.scheduler.due
        )

    def step(self, signal_name: str | None = None) -> None:
        """Advance to the next event and process it. signal_name: received signal that ends the
        flight, or None."""
        pilot = self._pilot
        links = self._links
        listeners = self._listeners
        self._clock.advance(self.due)
        step = run_step(
            pilot, links, self._clock, self.now, signal_name, listeners.circle_requests(self.now)
        )
        self.now = step.time
        records = pilot.take_records()
        self._newest = records[-1] if records else self._newest
        frames = listeners.on_step(
            self._newest, step, self._recorder.problem, called_off=signal_name is not None
        )
        if frames:
            links[VEHICLE].send(b"".join(frames), pilot.session.reply_to)
            step.attached = frames
        step.exchanged = listeners.take_exchanged(self.now)
        self._recorder.step(step)
        self._recorder.ticks(records)


def run_step(
    pilot: Pilot,
    links: Mapping[str, Link],
    clock: Clock,
    before: float,
    signal_name: str | None = None,
    requests: Sequence[CircleRequest] = (),
) -> LoopStep:
    """Run one step of the loop: receive, decide, send.

    before: time of the previous step, s.
    signal_name: received signal that ends the flight, or None.
    requests: requests of listeners for another circle.
    """
    began = clock.real()
    received = [(name, *one) for name, link in links.items() for one in link.receive(before)]
    # Read the clock after receiving. If the process was stopped while receiving, an earlier clock
    # reading would date ranges before their transmission.
    now = clock.now()
    step = LoopStep(now)
    for name, data, source in received:
        pilot.receive(data, now, source, name)
        step.received.append((name, source, pilot.take_frames()))
    for request in requests:
        step.requests.append(request)
        pilot.request_circle(request, now)
    if signal_name and pilot.mission.outcome is None:
        step.interrupt = signal_name
        pilot.interrupt(now, signal_name)

    def is_late() -> bool:
        # 0.5: real duration of a step, s, after which the step sends nothing more. The process was
        # probably stopped, and the operator may have taken over. `Pilot` detects a stall between
        # two steps.
        return clock.real() - began > 0.5

    def send(data: bytes) -> bool:
        if is_late():
            return False
        links[VEHICLE].send(data, pilot.session.reply_to)
        step.sent += split_frames(data)
        return True

    pilot.step(now, send)
    step.held_back = is_late() and not step.sent
    step.hello = split_frames(_send_hello(pilot, links, now))
    return step


def listen(
    listener: PreflightListener,
    links: Mapping[str, Link],
    clock: Clock,
    stop: StopRequest,
    signing_time: SigningTime | None = None,
) -> None:
    """Run preflight's listener until it is done or a signal is received."""
    while not listener.done and stop.signal_name is None:
        wait(links, stop, min(clock.until(listener.next_tick), clock.longest_wait))
        clock.advance(listener.next_tick)
        now = clock.now()
        if signing_time is not None:
            signing_time.advance()
        for name, link in links.items():
            for data, source in link.receive(now):
                listener.receive(data, now, source, name)
        if out := listener.step(now):
            links[VEHICLE].send(out, listener.session.reply_to)
        _send_hello(listener, links, now)


def _send_hello(sender: Pilot | PreflightListener, links: Mapping[str, Link], now: float) -> bytes:
    """Send a hello (heartbeat) to a separate ranging link if a hello is due. Return the bytes
    sent."""
    hello = sender.hello(now) if RANGING in links else b""
    if hello:
        links[RANGING].send(hello, None)
    return hello


def wait(links: Mapping[str, Link], stop: StopRequest, seconds: float) -> None:
    """Wait until a link has data, a signal arrives or the time is over."""
    if seconds == 0:  # the next step is due, or simulated time does not wait
        return
    watched = [fd for link in links.values() if (fd := link.fileno()) is not None]
    if stop.signal_name is None:
        watched.append(stop.fileno())
    select.select(watched, [], [], seconds)
