"""What a terminal shows: a picture that fits 80 by 24 in every phase, and never in the way of the loop."""

import io
import threading
from dataclasses import replace

import pytest
from rich.console import Console

from circnav_mav.pilot import OutputMode
from circnav_mav.runtime import display as display_module
from circnav_mav.runtime.display import Display, LiveScreen, PlainScreen, display_for
from circnav_mav.runtime.picture import Picture
from tests.flight.lockstep import flight
from tests.process import PATIENCE

SETTINGS = flight("quickstart").pilot.settings


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A busy machine may draw slowly: how long is not judged here."""
    monkeypatch.setattr(display_module, "PATIENCE", PATIENCE)


def terminal(**options):
    return Console(width=80, file=io.StringIO(), color_system=None, **options)


def drawn(status, *, ascii_only=False, settings=SETTINGS):
    """The picture of a status as lines of text."""
    console = terminal()
    console.print(Picture(settings, "small", ascii_only=ascii_only).draw(status))
    return console.file.getvalue().splitlines()


# --- the picture ---


@pytest.mark.parametrize(
    ("seconds", "overrides", "event", "shown"),
    [
        (0.1, (), None, ("WAITING FOR RANGING", "waiting     no ranging: no usable DISTANCE_SENSOR")),
        (4.0, ("engage.request_mode=false",), None, (" READY ", "mode GUIDED: the operator must enter it")),
        (12.0, (), None, (" ENGAGED ", "mode GUIDED", "law         smooth", "●", "alarms      none")),
        (9.0, (), "outage", (" HOLDING ", "ALARM       RANGE STALE ", "ends at")),
        (9.0, ('engage.on_takeover="wait"',), "takeover",
         (" YIELDED ", "ALARM       OPERATOR HAS THE VEHICLE, mode LOITER", "enter GUIDED again")),
        (9.0, (), "takeover", (" ENDED ", "ABORTED: GUIDED left for LOITER")),
        (8.0, ("ranging.max_range_m=50.0",), None, ("above_max", "MOST RANGES REJECTED")),
    ],
    ids=["waiting", "ready", "engaged", "holding", "yielded", "ended", "rejecting"],
)  # fmt: skip
def test_every_phase_fits_a_small_terminal_and_says_what_matters_in_words(statuses, seconds, overrides, event, shown):
    lines = drawn(statuses(seconds, *overrides, event=event)[-1])
    assert len(lines) <= 24
    assert {len(line) for line in lines} == {80}
    assert [word for word in shown if word not in "\n".join(lines)] == []
    plain = drawn(statuses(seconds, *overrides, event=event)[-1], ascii_only=True)
    assert "".join(plain[1:-1]).replace("│", "").isascii(), "a terminal without Unicode gets none"


@pytest.mark.parametrize("height", [6, 14])
def test_a_low_terminal_shows_phase_and_alarm(statuses, height):
    """It has no room for all rows, and leaves out the last. Nothing is written before the first picture: by the
    display's own thread, for it may have to wait for ever."""
    console = terminal(height=height, force_terminal=True)
    screen = LiveScreen(console, Picture(SETTINGS, "small", ascii_only=False))
    assert console.file.getvalue() == ""
    screen.draw(statuses(9.0, event="outage")[-1])
    seen = console.file.getvalue()
    screen.close()
    assert [words in seen for words in (" HOLDING ", "RANGE STALE", "Ctrl-C ends")] == [True, True, False]


def test_bars_lean_to_the_side_that_is_flown_and_the_sparkline_falls_with_the_error(statuses):
    """A clockwise circle turns right; the vehicle comes from outside the circle."""
    far = next(line for line in drawn(statuses(6.0)[-1]) if line.startswith("│             0 "))
    assert far.rstrip(" │").endswith("> 200 m")
    picture, flown = Picture(SETTINGS, "small", ascii_only=False), statuses(40.0)
    for status in flown:
        lines = picture.draw(status).renderable.plain.splitlines()
    turn = next(line for line in lines if "left " in line)
    assert flown[-1].tick.turn_rate < 0
    assert turn.index("●") > turn.index("┼")
    error = next(line for line in lines if line.startswith("error"))
    levels = ["▁▂▃▄▅▆▇█".index(mark) for mark in error if mark in "▁▂▃▄▅▆▇█"]
    assert len(levels) == 27  # 1.5 s each
    assert (levels[0], levels[-1]) == (7, 0)
    assert "full 21" in error


def test_numbers_say_what_they_are_of(statuses):
    """Which range, what is turned how far, whose bearing, and that nothing is sent."""
    status = statuses(12.0)[-1]
    tick, target = replace(status.tick, turn_gain=0.72, turn_delay=0.46), "237 deg, drift 0.1 m/s towards 322 deg"
    dry = replace(SETTINGS, output_mode=OutputMode.DRY_RUN)
    lines = "\n".join(drawn(replace(status, tick=tick, target=target), settings=dry))
    assert "DRY RUN: no setpoint" in lines
    assert " m horizontal   desired 100.0 m" in lines
    assert "deg/s (limit 20.0), gain 0.72, delay 0.46 s" in lines
    assert f"target      {target}" in lines


# --- never in the way ---


class Screen:
    """A screen that remembers what was drawn on it, and may be stuck or broken."""

    def __init__(self, fails=None):
        self.seen, self.fails, self.closed = [], fails, False
        self.entered, self.go_on = threading.Event(), threading.Event()
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
    """What the runner does after each step."""
    return lambda flown: display.show(flown.ticks[-1] if flown.ticks else None, flown.now)


def test_a_stuck_terminal_delays_no_tick_and_gets_the_newest_picture_later():
    """One that was stopped with Ctrl-S while the first picture was drawn."""
    flown, screen = flight("quickstart"), Screen()
    screen.go_on.clear()
    display = Display(screen, flown.pilot, 0.0, last=True)
    flown.fly(1.0, showing(display))
    assert screen.entered.wait(PATIENCE)
    flown.fly(20.0, showing(display))  # would never return if it waited
    screen.go_on.set()
    display.close()
    assert screen.closed
    assert screen.seen[-1] == flown.now
    assert len(screen.seen) < 50 < len(flown.ticks)


@pytest.mark.parametrize(
    ("fails", "problem"),
    [(BrokenPipeError(), None), (ZeroDivisionError("why"), "display: stopped: ZeroDivisionError('why')")],
    ids=["a terminal that has gone", "a screen that fails"],
)
def test_a_screen_that_cannot_draw_ends_no_flight_and_is_told_of_if_somebody_looks(fails, problem):
    flown, screen = flight("quickstart"), Screen(fails)
    display = Display(screen, flown.pilot, 0.0, last=True)
    flown.fly(5.0, showing(display))
    display.close()
    assert flown.pilot.outcome is None
    assert (screen.closed, len(screen.seen), display.problem) == (True, 1, problem)


def test_a_status_that_comes_late_does_not_delay_the_next_drawing():
    flown, screen = flight("quickstart").fly(5.0), Screen()
    display = Display(screen, flown.pilot, 1.0, last=False)
    for now in (0.0, 0.97, 1.04, 1.99, 2.03, 2.9, 7.0, 7.5, 8.0):
        display.show(flown.ticks[-1], now)
        while display._waiting:
            pass
    display.close()
    assert screen.seen == [0.0, 1.04, 2.03, 7.0, 8.0]


# --- plain lines ---


@pytest.mark.parametrize(
    ("term", "is_terminal", "screen"),
    [("xterm", True, LiveScreen), ("dumb", True, PlainScreen), ("xterm", False, PlainScreen)],
)
def test_only_a_terminal_that_can_be_drawn_on_gets_the_picture(monkeypatch, term, is_terminal, screen):
    monkeypatch.setenv("TERM", term)
    display = display_for(terminal(force_terminal=is_terminal), flight("quickstart").pilot, "small", 1.0)
    display.close()
    assert type(display._screen) is screen


def test_plain_lines_come_once_a_second_and_none_between():
    flown = flight("quickstart", "limits.duration_s=7.5")
    console = Console(record=True, width=300, file=io.StringIO())
    display = display_for(console, flown.pilot, "small", 1.0)

    def show_and_let_print(now):
        showing(display)(now)
        while display._waiting:
            pass

    flown.fly(30.0, show_and_let_print)
    display.close()
    believed, lines = [], []
    for line in console.export_text().strip().splitlines():
        (believed if "BELIEVED" in line else lines).append(line)
    assert flown.pilot.done
    assert believed == ["  BELIEVED 1/1 at sim, ranges of 1/192"]
    assert len(lines) == 1 + int(flown.now)
    assert "engaged" in lines[5]
    assert "mode GUIDED" in lines[-1]


def printed(statuses):
    console = terminal()
    screen = PlainScreen(console)
    for status in statuses:
        screen.draw(status)
    return console.file.getvalue()


def test_plain_output_tells_each_new_alarm_and_what_is_waited_for_once(statuses):
    assert printed(statuses(9.0, event="outage")).count("  ALARM    RANGE STALE ") == 1
    waiting = printed(statuses(4.0, "engage.request_mode=false"))
    assert waiting.count("  WAITING  mode GUIDED: the operator must enter it") == 1
    assert waiting.count("  WAITING") <= 2
