"""The display of a flight, as a picture or plain lines: it never delays the loop."""

import io
import threading

import pytest
from rich.console import Console

from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime import display as display_module
from circnav_mav.runtime.display import Display, LiveScreen, PlainScreen, display_for
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import AlarmLog, StatusSource
from tests.flight.lockstep import flight
from tests.process import PATIENCE


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """Allow long times for drawing, because the test machine may be busy."""
    monkeypatch.setattr(display_module, "PATIENCE", PATIENCE)


# --- no delay of the loop


class Screen:
    """A screen that records its pictures. It can be made to block or to fail."""

    def __init__(self, fails=None):
        self.seen = []
        self.fails = fails
        self.closed = False
        self.entered = threading.Event()
        self.go_on = threading.Event()
        self.go_on.set()

    def draw(self, status):
        self.seen.append(status.time)
        self.entered.set()
        assert self.go_on.wait(PATIENCE)
        if self.fails:
            raise self.fails

    def close(self):
        self.closed = True


def showing(display):
    """Return a function that updates the display like the runner after each step."""
    return lambda flown: display.on_step(
        flown.ticks[-1] if flown.ticks else None, LoopStep(flown.now), None
    )


def test_blocked_terminal_does_not_delay_ticks():
    """The terminal blocks while the first picture is drawn, as after Ctrl-S."""
    flown = flight("quickstart")
    screen = Screen()
    screen.go_on.clear()
    display = Display(screen, flown.pilot, Listeners(), 0.0, last=True)
    flown.fly(1.0, showing(display))
    assert screen.entered.wait(PATIENCE)
    # this call would never return if the display waited for the terminal
    flown.fly(20.0, showing(display))
    screen.go_on.set()
    display.close()
    assert screen.closed
    assert screen.seen[-1] == flown.now
    assert len(screen.seen) < 50 < len(flown.ticks)


@pytest.mark.parametrize(
    ("fails", "problem"),
    [
        (BrokenPipeError(), None),
        (ZeroDivisionError("why"), "display: stopped: ZeroDivisionError('why')"),
    ],
    ids=["closed terminal", "failing screen"],
)
def test_failing_screen_does_not_end_flight(fails, problem):
    flown = flight("quickstart")
    screen = Screen(fails)
    display = Display(screen, flown.pilot, Listeners(), 0.0, last=True)
    flown.fly(5.0, showing(display))
    display.close()
    assert flown.pilot.mission.outcome is None
    assert (screen.closed, len(screen.seen), display.problem) == (True, 1, problem)


def test_late_status_does_not_delay_next_status():
    flown = flight("quickstart").fly(5.0)
    screen = Screen()
    display = Display(screen, flown.pilot, Listeners(), 1.0, last=False)
    for now in (0.0, 0.97, 1.04, 1.99, 2.03, 2.9, 7.0, 7.5, 8.0):
        display.on_step(flown.ticks[-1], LoopStep(now), None)
        while display._waiting:
            pass
    display.close()
    assert screen.seen == [0.0, 1.04, 2.03, 7.0, 8.0]


# --- plain lines


def test_picture_is_drawn_only_on_capable_terminal(monkeypatch):
    pilot = flight("quickstart").pilot
    for term, is_terminal, screen in (
        ("xterm", True, LiveScreen),
        ("dumb", True, PlainScreen),
        ("xterm", False, PlainScreen),
    ):
        monkeypatch.setenv("TERM", term)
        display = display_for(
            Console(file=io.StringIO(), force_terminal=is_terminal),
            pilot,
            Listeners(),
            AlarmLog(pilot, Listeners()),
            "small",
            1.0,
        )
        display.close()
        assert type(display._screen) is screen


def test_plain_status_lines_are_printed_once_per_second():
    flown = flight("quickstart", "limits.duration_s=7.5")
    console = Console(record=True, width=300, file=io.StringIO())
    alarms = AlarmLog(flown.pilot, Listeners())
    display = display_for(console, flown.pilot, Listeners(), alarms, "small", 1.0)

    def show_and_let_print(now):
        showing(display)(now)
        while display._waiting:
            pass

    flown.fly(30.0, show_and_let_print)
    display.close()
    trusted = []
    lines = []
    for line in console.export_text().strip().splitlines():
        (trusted if "TRUSTED" in line else lines).append(line)
    assert flown.pilot.done
    assert trusted == ["  TRUSTED  1/1 at sim, ranges of 1/192"]
    assert len(lines) == 1 + int(flown.now)
    assert "engaged" in lines[5]
    assert "mode GUIDED" in lines[-1]


def printed(statuses):
    console = Console(width=80, file=io.StringIO(), color_system=None)
    screen = PlainScreen(console, [])
    for status in statuses:
        screen.draw(status)
    return console.file.getvalue()


def test_plain_output_shows_waiting_text_once(statuses):
    waiting = printed(statuses(4.0, "engage.request_mode=false"))
    assert waiting.count("  WAITING  mode GUIDED: the operator must enter it") == 1
    assert waiting.count("  WAITING") <= 2


def test_plain_output_shows_each_alarm_once_even_between_lines():
    """The outage of 4 s begins and ends between two lines."""
    events = '{at_s=6.0, action="mute_ranging"}, {at_s=10.0, action="unmute_ranging"}'
    flown = flight("quickstart", f"sim.events=[{events}]")
    console = Console(width=300, file=io.StringIO())
    alarms = AlarmLog(flown.pilot, Listeners())
    display = display_for(console, flown.pilot, Listeners(), alarms, "small", 30.0)

    def show(flown):
        step = flown.ticks[-1] if flown.ticks else None
        for listener in (alarms, display):
            listener.on_step(step, LoopStep(flown.now), None)

    flown.fly(20.0, show)
    display.close()
    assert console.file.getvalue().count(": RANGE STALE ") == 1


def test_plain_status_lines_end_with_flight():
    flown = flight("quickstart", "limits.duration_s=2.0").fly(40.0)
    out = io.StringIO()
    screen = PlainScreen(Console(file=out, width=200), [])
    watch = StatusSource(flown.pilot, Listeners())
    for second in range(30):
        screen.draw(watch.status(flown.ticks[-1], flown.now + second))
    assert flown.pilot.done
    assert out.getvalue().count(" ended ") == 1
