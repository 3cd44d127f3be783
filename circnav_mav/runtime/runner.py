"""The loop of a flight and of a survey: wait, receive, step, send. Everything it needs comes in as an argument."""

import select
import signal
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from types import FrameType

from circnav_mav.mav.framing import split_frames
from circnav_mav.pilot import RANGING, VEHICLE, Pilot, TickRecord
from circnav_mav.pilot.survey import Survey
from circnav_mav.runtime.clock import Clock
from circnav_mav.runtime.keys import SigningTime
from circnav_mav.runtime.links import Link
from circnav_mav.runtime.locating import Locating
from circnav_mav.runtime.recorder import LoopStep, Recorder

LONGEST_WAIT = 0.05
LONGEST_STEP = 0.5
"""Real time, s, after which what a step has to say is not said: we stood still in it, and the vehicle may be in other
hands since. A stall between two steps the pilot notices itself."""

Show = Callable[[TickRecord | None, LoopStep], None]
"""Gets the newest tick and the step of the loop, and must not wait for anybody."""


class StopRequest:
    """SIGINT and SIGTERM as a flag that also wakes the loop."""

    def __init__(self) -> None:
        self.signal_name: str | None = None
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def fileno(self) -> int:
        """Becomes readable when a signal has come."""
        return self._reader.fileno()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.signal_name = signal.Signals(number).name
        with suppress(BlockingIOError):  # so many signals that the loop is awake anyway
            self._writer.send(b"!")


class Onlookers:
    """Shows every step to each; one that fails is shown no more of them, and never ends the flight."""

    def __init__(self, shows: Mapping[str, Show]) -> None:
        """shows: by what people call them."""
        self._shows = dict(shows)
        self.problems: list[str] = []
        """What failed, a line each."""

    def show(self, newest: TickRecord | None, step: LoopStep) -> None:
        """Show the newest tick and the step."""
        for name, show in list(self._shows.items()):
            try:
                show(newest, step)
            except Exception as error:
                del self._shows[name]
                self.problems.append(f"{name}: stopped at {step.time:.1f} s: {error!r}")


def run(
    pilot: Pilot,
    links: Mapping[str, Link],
    clock: Clock,
    recorder: Recorder,
    show: Show,
    stop: StopRequest,
    signing_time: SigningTime | None = None,
    locating: Locating | None = None,
) -> None:
    """Fly until the pilot is done. Every frame and tick goes to the recorder; `show` gets every step. locating: the
    survey beside it, which may go on when guidance has ended."""
    newest: TickRecord | None = None
    now = 0.0
    while not pilot.done or (locating is not None and locating.busy and not stop.signal_name):
        _wait(links, stop, LONGEST_WAIT if pilot.done else min(clock.until(pilot.next_tick), LONGEST_WAIT))
        began = clock.real()
        heard = [(name, *one) for name, link in links.items() for one in link.receive(now)]
        now = clock.now()  # a range that came while we stood still is not dated before it was sent
        if signing_time is not None:
            signing_time.turn()
        step = LoopStep(now)
        for name, data, source in heard:
            pilot.receive(data, now, source, name)
            step.heard.append((name, source, pilot.take_frames()))
            if locating is not None:
                locating.hear(*step.heard[-1], now)
        if stop.signal_name and pilot.outcome is None:
            step.interrupt = stop.signal_name
            pilot.interrupt(now, stop.signal_name)
        out = pilot.step(now)
        if clock.real() - began > LONGEST_STEP:
            out, step.held_back = b"", True
            pilot.hold_back()
        step.said = split_frames(out)
        step.hello = split_frames(_send(pilot, out, links, now))
        if locating is not None and not step.held_back and (frames := locating.step(now)):
            links[VEHICLE].send(b"".join(frames), pilot.reply_to)
            step.survey = frames
        recorder.step(step)
        records = pilot.take_records()
        recorder.ticks(records)
        newest = records[-1] if records else newest
        show(newest, step)


def listen(
    survey: Survey,
    links: Mapping[str, Link],
    clock: Clock,
    stop: StopRequest,
    signing_time: SigningTime | None = None,
) -> None:
    """Listen until the survey is done or a signal has come."""
    while not survey.done and stop.signal_name is None:
        _wait(links, stop, min(clock.until(survey.next_tick), LONGEST_WAIT))
        now = clock.now()
        if signing_time is not None:
            signing_time.turn()
        for name, link in links.items():
            for data, source in link.receive(now):
                survey.receive(data, now, source, name)
        _send(survey, survey.step(now), links, now)


def _send(speaker: Pilot | Survey, out: bytes, links: Mapping[str, Link], now: float) -> bytes:
    """Send to the vehicle, and greet a ranging link that is apart; answers with the greeting."""
    if out:
        links[VEHICLE].send(out, speaker.reply_to)
    hello = speaker.hello(now) if RANGING in links else b""
    if hello:
        links[RANGING].send(hello, None)
    return hello


def _wait(links: Mapping[str, Link], stop: StopRequest, seconds: float) -> None:
    """Wait for bytes, a signal or the time, whichever comes first."""
    watched = [fd for link in links.values() if (fd := link.fileno()) is not None]
    if stop.signal_name is None:
        watched.append(stop.fileno())
    select.select(watched, [], [], seconds)
