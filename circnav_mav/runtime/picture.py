"""The picture that a terminal shows of a flight: 80 columns, at most 23 rows; words, not colours, carry the meaning."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from math import degrees, isfinite
from textwrap import wrap

from rich.panel import Panel
from rich.text import Text

from circnav_mav.guidance.types import TurnRate
from circnav_mav.mav.frames import yaw_rate_from_turn_rate
from circnav_mav.pilot import PilotSettings, TickRecord
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runtime.status import SILENCED, Status, shown

STYLES = {Phase.ENGAGED: "green", Phase.HOLDING: "yellow", Phase.YIELDED: "magenta", Phase.LEAVING: "cyan"}
WIDTH = 80
BAR = 41
"""Cells of a bar, an odd number: the middle one is a place of its own."""
CELLS, CELL = 40, 1.5
"""Cells of the sparkline, and the time that each stands for, s."""
ALARM, LABEL = "ALARM", 12
"""The label of an alarm, and the columns of all labels."""
MOST_ALARMS, MOST_REASONS = 3, 3
HOW_TO_STOP = "Ctrl-C ends the flight. Any other flight mode: circnav stops sending."


Row = tuple[str, str | Text]


@dataclass(frozen=True, slots=True)
class Signs:
    """The characters that pictures are made of. levels: of a sparkline, low to high."""

    line: str
    middle: str
    mark: str
    levels: str
    give_or_take: str


FINE = Signs("─", "┼", "●", "▁▂▃▄▅▆▇█", "±")
ASCII = Signs("-", "|", "O", "_.-=+*%#", "+-")


class Picture:
    """Draws the statuses of one flight; remembers the error for its sparkline."""

    def __init__(self, settings: PilotSettings, name: str, *, ascii_only: bool) -> None:
        self._settings, self._signs = settings, ASCII if ascii_only else FINE
        self._title = f"{name}: {settings.circles}"
        self._errors: deque[tuple[int, float]] = deque(maxlen=CELLS)

    def draw(self, status: Status) -> Panel:
        """The picture of now. Alarms are near the top: a terminal that is too low shows no more than the first rows."""
        alarms: list[Row] = [(ALARM, Text(line, "bold reverse red")) for line in _folded(status.alarms[:MOST_ALARMS])]
        rows: list[Row] = [
            *self._phase(status),
            *(alarms or [("alarms", "none")]),
            ("law", status.why or status.tick.law or "-"),
            *zip(("waiting", ""), _folded([status.waits]), strict=False),
            *self._circle(status.tick, status.target),
            *(("place", line) for line in _folded([status.place])[:1]),  # there is no room for more
            *_traffic(status, self._settings),
        ]
        text = Text(no_wrap=True, overflow="crop")
        for name, value in rows:
            text.append(f"{name:<{LABEL}}", "bold red" if name == ALARM else "").append(value).append("\n")
        text.right_crop()
        return Panel(
            text, title=f"{self._title}, t = {status.time:.1f} s", subtitle=HOW_TO_STOP,
            border_style=_style(status), width=WIDTH,
        )  # fmt: skip

    def _phase(self, status: Status) -> list[Row]:
        """Phase, mode and time, and whether anything is sent at all."""
        settings = self._settings
        badge = (f" {status.phase.upper()} ", f"bold reverse {_style(status)}")
        duration = f" of {settings.timing.duration:.0f} s" if isfinite(settings.timing.duration) else ""
        flown = "" if status.flown is None else f"   flown {status.flown:.0f} s{duration}"
        rows: list[Row] = [("phase", Text.assemble(badge, f"  mode {status.tick.mode}{flown}"))]
        if settings.output_mode in SILENCED:
            rows.append(("", Text(SILENCED[settings.output_mode], "bold")))
        return rows

    def _circle(self, tick: TickRecord, target: str) -> list[Row]:
        """Range, error, rate and turn."""
        desired, signs = tick.desired or self._settings.orbit.radius, self._signs
        limit, turn = self._settings.orbit.max_turn_rate, tick.turn_rate
        at_limit = "   AT ITS LIMIT" if tick.saturated else ""
        share = None if tick.r is None else tick.r / desired - 1
        to_right = None if turn is None else yaw_rate_from_turn_rate(TurnRate(turn)) / limit
        commanded = shown(None if turn is None else degrees(turn), "{:+.1f}")
        wanted = f" horizontal   desired {desired:.1f} m"
        rate = _with_sigma(tick.r_dot, tick.r_dot_sigma, "+.2f", "m/s", signs)
        if tick.measured_rate is not None:
            rate += f"   measured {tick.measured_rate:+.2f} m/s"
        answer = f"gain {tick.turn_gain:.2f}, delay {tick.turn_delay:.2f} s"
        return [
            ("range", _with_sigma(tick.r, tick.r_sigma, ".2f", "m", signs) + wanted),
            ("", f"0 {self._bar(share)} {2 * desired:.0f} m"),
            ("error", self._error(tick, desired)),
            ("range rate", rate),
            ("turn rate", f"commanded {commanded} deg/s (limit {degrees(limit):.1f}), {answer}{at_limit}"),
            ("", f"left {self._bar(to_right)} right"),
            ("target", target),
        ]

    def _bar(self, share: float | None) -> str:
        """A line with a mark at -1 .. 1, kept at its ends beyond that."""
        signs, half = self._signs, BAR // 2
        cells = [signs.line] * BAR
        cells[half] = signs.middle
        if share is not None:
            at = half + round(half * min(max(share, -1.0), 1.0))
            cells[at] = signs.mark if abs(share) <= 1 else "<" if share < 0 else ">"
        return "".join(cells)

    def _error(self, tick: TickRecord, desired: float) -> str:
        """The error, and its size over the last minute: the largest of each cell."""
        if tick.r is None:
            return "-"
        error = tick.r - desired
        cell = int(tick.time / CELL)
        if self._errors and self._errors[-1][0] == cell:
            self._errors[-1] = (cell, max(abs(error), self._errors[-1][1]))
        else:
            self._errors.append((cell, abs(error)))
        recent = [(at, size) for at, size in self._errors if cell - at < CELLS]
        full, levels = max(size for _, size in recent), self._signs.levels
        line = [" "] * (cell - recent[0][0] + 1)
        for at, size in recent:
            line[at - recent[0][0]] = levels[min(int(size / full * len(levels)), len(levels) - 1) if full else 0]
        return f"{error:+.2f} m   {''.join(line)} full {full:.1f} m"


def _traffic(status: Status, settings: PilotSettings) -> list[Row]:
    """What comes in and goes out."""
    tick = status.tick
    frames, accepted, _, setpoints = (shown(rate, "{:.1f}/s") for rate in status.rates or (None, None, None, None))
    range_age, link_age = (shown(age, "{:.2f} s") for age in (tick.range_age, tick.link_age))
    refused = sum(status.rejected.values())
    reasons = [f"{count} {reason}" for reason, count in list(status.rejected.items())[:MOST_REASONS]]
    more = ", ..." if len(status.rejected) > MOST_REASONS else ""
    why = f": {', '.join(reasons)}{more}" if reasons else ""
    others = f"; {status.others} of other senders" if status.others else ""
    stale = f"stale at {settings.timing.stale:.2f} s"
    return [
        ("ranging", f"{accepted} accepted, newest {range_age} old, {stale}"),
        ("rejected", f"{refused} of {refused + tick.accepted}{why}{others}"),
        ("link", f"{frames} frames, heartbeat {link_age} old  {status.believed}"),
        ("setpoints", f"{setpoints}, {status.setpoints} total"),
    ]


def _folded(texts: Iterable[str]) -> list[str]:
    """Texts in lines that fit, two for each at most."""
    return [line for text in texts for line in wrap(text, WIDTH - LABEL - 4, max_lines=2, placeholder=" ...")]


def _style(status: Status) -> str:
    return "red" if status.alarms else STYLES.get(status.tick.phase, "default")


def _with_sigma(value: float | None, sigma: float | None, form: str, unit: str, signs: Signs) -> str:
    if value is None:
        return "-"
    return f"{value:{form}} {unit}" if sigma is None else f"{value:{form}} {signs.give_or_take} {sigma:.2f} {unit}"
