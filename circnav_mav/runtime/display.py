"""Display during a flight: a live picture on a terminal, one plain line a second elsewhere. A
separate thread draws, so that a stopped terminal (Ctrl-S), a closed terminal or a slow pipe never
delays a tick."""

import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress

from rich.console import Console
from rich.live import Live

from circnav_mav.foreign import printable
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runtime.listeners import Listener, Listeners
from circnav_mav.runtime.picture import Picture
from circnav_mav.runtime.status import AlarmLog, Status, StatusSource, in_degrees, kind, shown

PATIENCE = 1.0
"""Longest wait for a stuck terminal at the end of the flight, s."""


class PlainScreen:
    """Prints one line for each status. Further lines report each begun alarm, changed lines of
    listeners, and, after engaging, the trusted vehicle. The reason why the vehicle is not steered
    is reported if it lasts for two draws."""

    def __init__(self, console: Console, begun: Sequence[Mapping[str, float | str]]) -> None:
        """begun: alarms of the flight, which `AlarmLog` extends. An alarm may begin and end between
        two lines."""
        self._console = console
        self._begun = begun
        self._alarms_printed = 0
        self._waits = ""
        self._ended = False
        self._newest: dict[str, str] = {}

    def draw(self, status: Status) -> None:
        """Print the lines of a status."""
        # After the end of the flight, the extra `external_position` may run for a long time: print
        # only new facts, no more status lines.
        ended = self._ended
        self._ended = status.tick.phase is Phase.ENDED
        if not (ended and self._ended):
            self._print(one_line(status))
        if status.flown is not None:
            self._print_new("TRUSTED", status.view.trusted, status.view.trusted)
        for label, words in status.added.items():
            self._print_new(label.upper(), words, kind(words))
        waits = self._waits
        self._waits = kind(status.view.waits)
        if self._waits == waits:
            self._print_new("WAITING", status.view.waits, waits)
        self._print_alarms()

    def close(self) -> None:
        """Print the alarms that began after the last status."""
        self._print_alarms()

    def _print_alarms(self) -> None:
        """Print each begun alarm once."""
        for alarm in self._begun[self._alarms_printed :]:
            self._print(f"  ALARM    at {alarm['time_s']} s: {alarm['text']}")
            self._alarms_printed += 1

    def _print_new(self, label: str, text: str, about: str) -> None:
        """Print a text with its label, unless the last text of this label had the same `about`."""
        if text and about != self._newest.get(label):
            self._print(f"  {label:<8} {text}")
            self._newest[label] = about

    def _print(self, text: str) -> None:
        self._console.print(printable(text), highlight=False, markup=False, soft_wrap=True)


class LiveScreen:
    """Live picture that is redrawn in place. Nothing is written before the first draw."""

    def __init__(self, console: Console, picture: Picture) -> None:
        self._picture = picture
        self._live = Live(console=console, auto_refresh=False)

    def draw(self, status: Status) -> None:
        """Draw the picture of a status."""
        if not self._live.is_started:
            self._live.start()
        console = self._live.console
        self._live.update(self._picture.draw(status, console.width), refresh=True)

    def close(self) -> None:
        """Keep the last picture on the terminal."""
        self._live.stop()


Screen = PlainScreen | LiveScreen


class Display(Listener):
    """Passes the newest status to a screen when a refresh is due. `on_step` never blocks."""

    name = "display"

    def __init__(
        self, screen: Screen, pilot: Pilot, listeners: Listeners, period: float, *, last: bool
    ) -> None:
        """period: run time between two refreshes, s. last: True to draw the end of the flight even
        if no refresh is due."""
        self._screen = screen
        self._pilot = pilot
        self._period = period
        self._last = last
        self._watch = StatusSource(pilot, listeners)
        self._due = 0.0
        self.problem: str | None = None
        """Reason why drawing stopped, or None. A closed terminal is no problem."""
        self._waiting: deque[Status] = deque(maxlen=1)
        self._wake = threading.Event()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="display", daemon=True)
        self._thread.start()

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Queue a status if a refresh is due. The new status replaces an older status that is not
        drawn yet."""
        now = step.time
        if newest is None or (now < self._due and not (self._last and self._pilot.done)):
            return ()
        self._due += self._period  # whole periods, even if this status is late
        if self._due <= now:
            self._due = now + self._period
        self._waiting.append(self._watch.status(newest, now, recording_problem))
        self._wake.set()
        return ()

    def close(self) -> None:
        """Draw the newest status, if it is not drawn yet, and leave it on the terminal."""
        self._closing = True
        self._wake.set()
        self._thread.join(PATIENCE)

    def _run(self) -> None:
        """Draw waiting statuses until closed. Body of the drawing thread."""
        closing = False
        try:
            while not closing:
                self._wake.wait()
                self._wake.clear()
                closing = self._closing
                if self._waiting:
                    self._screen.draw(self._waiting.pop())
        except OSError:
            pass  # the terminal was closed: the flight continues
        except Exception as error:
            self.problem = f"display: stopped: {error!r}"
        with suppress(Exception):
            self._screen.close()


def display_for(
    console: Console,
    pilot: Pilot,
    listeners: Listeners,
    alarms: AlarmLog,
    title: str,
    speed: float,
) -> Display:
    """Return a live display for a terminal, else a plain one. speed: run seconds per real
    second."""
    if console.is_terminal and not console.is_dumb_terminal:
        picture = Picture(title, ascii_only=console.options.ascii_only)
        screen: Screen = LiveScreen(console, picture)
        # 4: refreshes of the live picture per real second. More cannot be read.
        return Display(screen, pilot, listeners, speed / 4, last=True)
    return Display(PlainScreen(console, alarms.begun), pilot, listeners, speed, last=False)


def one_line(status: Status) -> str:
    """Return a status as a line of text."""
    tick = status.tick
    error = None if tick.r is None else tick.r - tick.desired
    turn = in_degrees(tick.turn_rate)
    return (
        f"{tick.time:7.1f} s  {status.phase:<20}  range {shown(tick.r, '{:.2f} m'):>9}  "
        f"error {shown(error, '{:+.2f} m'):>9}  rate {shown(tick.r_dot, '{:+6.2f} m/s'):>10}  "
        f"turn {shown(turn, '{:+.1f} deg/s'):>11}  range age {shown(tick.range_age, '{:.2f} s')}  "
        f"link age {shown(tick.link_age, '{:.2f} s')}  mode {tick.mode}"
    )
