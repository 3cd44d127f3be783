"""The loop: wait, receive, step, send. Everything it needs comes in as an argument."""

import select
import signal
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from types import FrameType

from circnav_mav.mav.framing import split_frames
from circnav_mav.pilot import RANGING, VEHICLE, Pilot, TickRecord
from circnav_mav.runtime.clock import RunClock
from circnav_mav.runtime.keys import SigningTime
from circnav_mav.runtime.links import Link
from circnav_mav.runtime.recorder import Recorder, Turn

LONGEST_WAIT = 0.05
LONGEST_TURN = 0.5
"""Real time, s, after which what a turn has to say is not said: we stood still in it, and the vehicle may be in other
hands since. A stall between two turns the pilot notices itself."""


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


def run(
    pilot: Pilot,
    links: Mapping[str, Link],
    clock: RunClock,
    recorder: Recorder,
    show: Callable[[TickRecord | None, Turn], None],
    stop: StopRequest,
    signing_time: SigningTime | None = None,
) -> None:
    """Fly until the pilot is done. Every frame and tick goes to the recorder; `show` gets the newest tick and the turn
    after each step, and must not wait for anybody."""
    newest: TickRecord | None = None
    now = 0.0
    while not pilot.done:
        wait(links, stop, min(clock.until(pilot.next_tick), LONGEST_WAIT))
        began = clock.real()
        heard = [(name, *one) for name, link in links.items() for one in link.receive(now)]
        now = clock.now()  # a range that came while we stood still is not dated before it was sent
        if signing_time is not None:
            signing_time.turn()
        turn = Turn(now)
        for name, data, source in heard:
            pilot.receive(data, now, source, name)
            turn.heard.append((name, source, pilot.take_frames()))
        if stop.signal_name and pilot.outcome is None:
            turn.interrupt = stop.signal_name
            pilot.interrupt(now, stop.signal_name)
        out = pilot.step(now)
        if clock.real() - began > LONGEST_TURN:
            out, turn.held_back = b"", True
            pilot.hold_back()
        if out:
            links[VEHICLE].send(out, pilot.reply_to)
        if RANGING in links and (hello := pilot.hello(now)):
            links[RANGING].send(hello, None)
            turn.hello = split_frames(hello)
        turn.said = split_frames(out)
        recorder.turn(turn)
        records = pilot.take_records()
        recorder.ticks(records)
        newest = records[-1] if records else newest
        show(newest, turn)


def wait(links: Mapping[str, Link], stop: StopRequest, seconds: float) -> None:
    """Wait for bytes, a signal or the time, whichever comes first."""
    watched = [fd for link in links.values() if (fd := link.fileno()) is not None]
    if stop.signal_name is None:
        watched.append(stop.fileno())
    select.select(watched, [], [], seconds)
