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


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A busy machine may draw slowly: how long is not judged here."""
    monkeypatch.setattr(display_module, "PATIENCE", PATIENCE)


def drawn(status, *, ascii_only=False, settings=None):
    """The picture of a status as lines of text."""
    console = Console(width=80, file=io.StringIO(), color_system=None)
    console.print(Picture(settings or flight("quickstart").pilot.settings, "small", ascii_only=ascii_only).draw(status))
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize(
    ("seconds", "overrides", "events", "shown"),
    [
        (0.1, (), [], ("WAITING FOR RANGING", "waiting     no ranging: no usable DISTANCE_SENSOR")),
        (4.0, ("engage.request_mode=false",), [], (" READY ", "mode GUIDED: the operator must enter it")),
        (12.0, (), [], (" ENGAGED ", "mode GUIDED", "law         smooth", "desired 100.0 m", "●", "alarms      none")),
        (9.0, (), [{"at_s": 6.0, "action": "mute_ranging"}], (" HOLDING ", "ALARM       RANGE STALE ", "ends at")),
        (9.0, ('engage.on_takeover="wait"',), [{"at_s": 6.0, "action": "mode", "mode": "LOITER"}],
         (" YIELDED ", "ALARM       OPERATOR HAS THE VEHICLE, mode LOITER", "enter GUIDED again")),
        (9.0, (), [{"at_s": 6.0, "action": "mode", "mode": "LOITER"}], (" ENDED ", "ABORTED: GUIDED left for LOITER")),
        (8.0, ("ranging.max_range_m=50.0",), [], ("above_max", "MOST RANGES REJECTED")),
    ],
    ids=["waiting", "ready", "engaged", "holding", "yielded", "ended", "rejecting"],
)  # fmt: skip
def test_every_phase_fits_a_small_terminal_and_says_what_matters_in_words(statuses, seconds, overrides, events, shown):
    lines = drawn(statuses(seconds, *overrides, events=events)[-1])
    assert len(lines) <= 24
    assert {len(line) for line in lines} == {80}
    assert [word for word in shown if word not in "\n".join(lines)] == []


@pytest.mark.parametrize("height", [6, 10, 14])
def test_a_low_terminal_shows_phase_and_alarm(statuses, height):
    """It has no room for all rows, and leaves out the last."""
    status = statuses(9.0, events=[{"at_s": 6.0, "action": "mute_ranging"}])[-1]
    console = Console(width=80, height=height, file=io.StringIO(), force_terminal=True, color_system=None)
    screen = LiveScreen(console, Picture(flight("quickstart").pilot.settings, "small", ascii_only=False))
    screen.draw(status)
    seen = console.file.getvalue()
    assert " HOLDING " in seen
    assert "RANGE STALE" in seen
    assert "Ctrl-C ends" not in seen


def test_a_dry_run_says_that_nothing_is_sent(statuses):
    settings = flight("quickstart").pilot.settings
    dry = replace(settings, output_mode=OutputMode.DRY_RUN)
    assert "DRY RUN: no setpoint" in "\n".join(drawn(statuses(6.0, output_mode=OutputMode.DRY_RUN)[-1], settings=dry))


def test_a_terminal_without_unicode_gets_ascii(statuses):
    lines = drawn(statuses(12.0)[-1], ascii_only=True)
    assert "".join(lines[1:-1]).replace("│", "").isascii()


def test_bars_lean_to_the_side_that_is_flown(statuses):
    """A clockwise circle turns right; the vehicle comes from outside the circle."""
    status = statuses(40.0)[-1]
    lines = drawn(status)
    turn = next(line for line in lines if "left " in line)
    assert status.tick.turn_rate < 0
    assert turn.index("●") > turn.index("┼")
    far = next(line for line in drawn(statuses(6.0)[-1]) if line.startswith("│             0 "))
    assert far.rstrip(" │").endswith("> 200 m")


def test_the_sparkline_falls_with_the_error(statuses):
    picture = Picture(flight("quickstart").pilot.settings, "small", ascii_only=False)
    flown = statuses(40.0)
    for status in flown:
        text = picture.draw(status).renderable.plain
    line = next(line for line in text.splitlines() if line.startswith("error"))
    levels = ["▁▂▃▄▅▆▇█".index(mark) for mark in line if mark in "▁▂▃▄▅▆▇█"]
    assert len(levels) == 27  # 1.5 s each
    assert (levels[0], levels[-1]) == (7, 0)
    assert "full 217" in line or "full 21" in line


class StuckScreen:
    """A terminal that was stopped with Ctrl-S while the first picture was drawn."""

    def __init__(self):
        self.seen, self.entered, self.go_on, self.closed = [], threading.Event(), threading.Event(), False

    def draw(self, status):
        self.seen.append(status.time)
        self.entered.set()
        assert self.go_on.wait(PATIENCE)

    def close(self):
        self.closed = True


def test_a_stuck_terminal_delays_no_tick_and_gets_the_newest_picture_later():
    flown, screen = flight("quickstart"), StuckScreen()
    display = Display(screen, flown.pilot, 0.0, last=True)
    flown.fly(1.0, lambda now: display.show(now.ticks[-1] if now.ticks else None, now.now))
    assert screen.entered.wait(PATIENCE)
    flown.fly(20.0, lambda now: display.show(now.ticks[-1], now.now))  # would never return if it waited
    screen.go_on.set()
    display.close()
    assert screen.closed
    assert screen.seen[-1] == flown.now
    assert len(screen.seen) < 50 < len(flown.ticks)


def test_a_terminal_that_has_gone_ends_no_flight():
    class GoneScreen(StuckScreen):
        def draw(self, status):
            raise BrokenPipeError

    flown = flight("quickstart")
    display = Display(GoneScreen(), flown.pilot, 0.0, last=True)
    flown.fly(5.0, lambda now: display.show(now.ticks[-1] if now.ticks else None, now.now))
    display.close()
    assert flown.pilot.outcome is None


def test_a_screen_that_fails_ends_no_flight_and_is_told_of():
    class BrokenScreen(StuckScreen):
        def draw(self, status):
            raise ZeroDivisionError("whatever")

    flown, screen = flight("quickstart"), BrokenScreen()
    display = Display(screen, flown.pilot, 0.0, last=True)
    flown.fly(5.0, lambda now: display.show(now.ticks[-1] if now.ticks else None, now.now))
    display.close()
    assert flown.pilot.outcome is None
    assert screen.closed
    assert display.problem == "display: stopped: ZeroDivisionError('whatever')"


def test_a_terminal_that_takes_nothing_does_not_keep_a_flight_from_its_start(statuses):
    """The first that is written to it, which may wait for ever, is written by the display's own thread."""
    console = Console(width=80, file=io.StringIO(), force_terminal=True)
    screen = LiveScreen(console, Picture(flight("quickstart").pilot.settings, "small", ascii_only=False))
    assert console.file.getvalue() == ""
    screen.draw(statuses(12.0)[-1])
    screen.close()
    assert "ENGAGED" in console.file.getvalue()


@pytest.mark.parametrize(
    ("term", "terminal", "screen"),
    [("xterm", True, LiveScreen), ("dumb", True, PlainScreen), ("xterm", False, PlainScreen)],
)
def test_only_a_terminal_that_can_be_drawn_on_gets_the_picture(monkeypatch, term, terminal, screen):
    monkeypatch.setenv("TERM", term)
    console = Console(file=io.StringIO(), force_terminal=terminal, width=80)
    display = display_for(console, flight("quickstart").pilot, "small", 1.0)
    display.close()
    assert type(display._screen) is screen


def test_plain_lines_come_once_a_second_and_none_between():
    flown = flight("quickstart", "limits.duration_s=7.5")
    console = Console(record=True, width=300, file=io.StringIO())
    display = display_for(console, flown.pilot, "small", 1.0)

    def show_and_let_print(now):
        if now.ticks:
            display.show(now.ticks[-1], now.now)
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


def test_a_status_that_comes_late_does_not_delay_the_next_drawing():
    drawn = []

    class Screen:
        def draw(self, status):
            drawn.append(status.tick.time)

        def close(self):
            pass

    flown = flight("quickstart").fly(5.0)
    display = Display(Screen(), flown.pilot, 1.0, last=False)
    for now in (0.0, 0.97, 1.04, 1.99, 2.03, 2.9, 7.0, 7.5, 8.0):
        display.show(replace(flown.ticks[-1], time=now), now)
        while display._waiting:
            pass
    display.close()
    assert drawn == [0.0, 1.04, 2.03, 7.0, 8.0]


def test_plain_output_tells_each_new_alarm_once(statuses):
    console = Console(width=80, file=io.StringIO(), color_system=None)
    screen = PlainScreen(console)
    for status in statuses(9.0, events=[{"at_s": 6.0, "action": "mute_ranging"}]):
        screen.draw(status)
    assert console.file.getvalue().count("  ALARM    RANGE STALE ") == 1


def test_plain_output_tells_once_what_is_waited_for(statuses):
    console = Console(width=80, file=io.StringIO(), color_system=None)
    screen = PlainScreen(console)
    for status in statuses(4.0, "engage.request_mode=false"):
        screen.draw(status)
    waiting = [line for line in console.file.getvalue().splitlines() if line.startswith("  WAITING")]
    assert waiting[-1] == "  WAITING  mode GUIDED: the operator must enter it"
    assert len(waiting) == len(set(waiting)) <= 2


def test_numbers_say_what_they_are_of(statuses):
    """Which range, what is turned how far, whose bearing."""
    status = statuses(12.0)[-1]
    tick = replace(status.tick, turn_gain=0.72, turn_delay=0.46)
    lines = "\n".join(
        drawn(replace(status, tick=tick, target="237 deg from the vehicle, drift 0.1 m/s towards 322 deg"))
    )
    assert " m horizontal   desired 100.0 m" in lines
    assert "deg/s (limit 20.0), gain 0.72, delay 0.46 s" in lines
    assert "target      237 deg from the vehicle, drift 0.1 m/s towards 322 deg" in lines
