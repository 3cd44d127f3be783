"""Live picture of a flight on a terminal: at least 80 columns, about 20 rows. Colors add no
information to the words."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from textwrap import wrap

from rich.panel import Panel
from rich.text import Text

from circnav_mav.foreign import printable
from circnav_mav.guidance.types import TurnRate
from circnav_mav.mav.frames import yaw_rate_from_turn_rate
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runtime.status import SILENCED, Status, status_facts

STYLES = {
    Phase.ENGAGED: "green",
    Phase.COASTING: "yellow",
    Phase.YIELDED: "magenta",
    Phase.LEAVING: "cyan",
}
NARROWEST = 80
"""Least width of the picture, columns: the usual width of a terminal."""
WIDEST = 160
"""Largest width of the picture, columns."""
CELLS = 30
"""Number of cells of the sparkline in the narrowest picture."""
CELL = 2.0
"""Time that a cell of the sparkline shows, s."""
ALARM = "ALARM"
"""Label of an alarm."""
LABEL = 12
"""Width of a label, columns."""
MOST_ALARMS = 3
"""Largest number of alarms that the picture shows."""
MOST_REASONS = 3
"""Largest number of reasons for rejected ranges that the picture shows."""
HOW_TO_STOP = "Ctrl-C ends the flight. In any other flight mode, circnav stops sending."


Row = tuple[str, str | Text]


@dataclass(frozen=True, slots=True)
class Symbols:
    """Characters of the picture. levels: bars of the sparkline, low to high."""

    line: str
    middle: str
    mark: str
    levels: str
    plus_minus: str


FINE = Symbols("─", "┼", "●", "▁▂▃▄▅▆▇█", "±")
ASCII = Symbols("-", "|", "O", "_.-=+*%#", "+-")


class Picture:
    """Draws the statuses of a flight, and keeps the recent radius errors for the sparkline."""

    def __init__(self, name: str, *, ascii_only: bool) -> None:
        self._name = name
        self._signs = ASCII if ascii_only else FINE
        self._errors: deque[tuple[int, float]] = deque(maxlen=CELLS + WIDEST - NARROWEST)
        self._width = NARROWEST

    def draw(self, status: Status, columns: int = NARROWEST) -> Panel:
        """Return the picture of a status: a panel of texts and bars. Alarms are near the top,
        because a terminal with few rows shows only the first rows.

        columns: width of the terminal. The panel is at least NARROWEST and at most WIDEST wide.
        """
        self._width = min(max(columns, NARROWEST), WIDEST)
        folded = self._folded(status.alarms[:MOST_ALARMS])
        alarms: list[Row] = [(ALARM, Text(line, "bold reverse red")) for line in folded]
        facts = status_facts(status, MOST_REASONS)
        rows: list[Row] = [
            *self._phase(status, facts["flown"]),
            *(alarms or [("alarms", "none")]),
            ("law", facts["law"]),
            *zip(("waiting", ""), self._folded([facts["waiting"]]), strict=False),
            *self._circle(status, facts),
            ("target", status.target),
            *(
                (label, line)
                for label, words in status.added.items()
                for line in self._folded([words])[:1]
            ),
            *(
                (name, facts[name])
                for name in ("ranging", "rejected", "link", "senders", "setpoints")
                if facts[name]
            ),
        ]
        text = Text(no_wrap=True, overflow="crop")
        for name, value in rows:
            shown = self._fitted(value) if isinstance(value, str) else value
            text.append(f"{name:<{LABEL}}", "bold red" if name == ALARM else "").append(
                shown
            ).append("\n")
        text.right_crop()
        title = f"{self._name}: {status.view.circle.words()}, t = {status.time:.1f} s"
        return Panel(
            text, title=title, subtitle=HOW_TO_STOP, border_style=_style(status), width=self._width
        )

    def _phase(self, status: Status, flown: str) -> list[Row]:
        """Return the rows of phase, mode and time flown, and a notice if nothing is sent."""
        badge = (f" {status.phase.upper()} ", f"bold reverse {_style(status)}")
        rows: list[Row] = [
            ("phase", Text.assemble(badge, f"  mode {status.tick.mode}", flown and f"   {flown}"))
        ]
        if silenced := SILENCED.get(status.view.output_mode):
            rows.append(("", Text(silenced, "bold")))
        return rows

    def _circle(self, status: Status, facts: dict[str, str]) -> list[Row]:
        """Return the rows of range, radius error, range rate and turn rate."""
        tick = status.tick
        desired = tick.desired
        limit = status.view.settings.orbit.max_turn_rate
        share = None if tick.r is None else tick.r / desired - 1
        to_right = (
            None
            if tick.turn_rate is None
            else yaw_rate_from_turn_rate(TurnRate(tick.turn_rate)) / limit
        )
        return [
            ("range", facts["range"]),
            ("", f"0 {self._bar(share)} {2 * desired:.0f} m"),
            ("error", facts["error"] + self._sparkline(tick)),
            ("range rate", facts["range rate"]),
            ("turn rate", facts["turn rate"]),
            ("", f"left {self._bar(to_right)} right"),
        ]

    def _bar(self, share: float | None) -> str:
        """Return a bar from -1 to 1 with a mark at `share`. A value outside this range is marked at
        the end of the bar. None has no mark."""
        signs = self._signs
        # 41: cells of a bar in the narrowest picture, an odd number, so that the bar has a middle
        # cell.
        half = (41 + self._width - NARROWEST) // 2
        cells = [signs.line] * (2 * half + 1)
        cells[half] = signs.middle
        if share is not None:
            at = half + round(half * min(max(share, -1.0), 1.0))
            cells[at] = signs.mark if abs(share) <= 1 else "<" if share < 0 else ">"
        return "".join(cells)

    def _sparkline(self, tick: TickRecord) -> str:
        """Return the sparkline of the radius error with its time span and maximum. Each cell shows
        the largest error of CELL seconds. In the narrowest picture, the line covers the last
        minute."""
        if tick.r is None:
            return ""
        error = abs(tick.r - tick.desired)
        cell = int(tick.time / CELL)
        if self._errors and self._errors[-1][0] == cell:
            error = max(error, self._errors.pop()[1])
        self._errors.append((cell, error))
        recent = [
            (at, size) for at, size in self._errors if cell - at < CELLS + self._width - NARROWEST
        ]
        full = max(size for _, size in recent)
        levels = self._signs.levels
        line = [" "] * (cell - recent[0][0] + 1)
        for at, size in recent:
            line[at - recent[0][0]] = levels[
                min(int(size / full * len(levels)), len(levels) - 1) if full else 0
            ]
        return f"   {''.join(line)} {tick.time - recent[0][0] * CELL:.0f} s, max {full:.1f} m"

    def _fitted(self, text: str) -> str:
        """Return a text as one line. A text that is too long is cut after a word and ends with
        dots."""
        shown = self._printable(text)
        return shown if len(shown) <= self._room else next(iter(self._folded([text], most=1)))

    def _printable(self, text: str) -> str:
        return printable(text).replace("±", self._signs.plus_minus)

    @property
    def _room(self) -> int:
        """Number of columns beside the labels."""
        return self._width - LABEL - 4

    def _folded(self, texts: Iterable[str], most: int = 2) -> list[str]:
        """Return the texts as lines that fit, at most `most` lines each."""
        room = self._room
        return [
            line
            for text in texts
            for line in wrap(self._printable(text), room, max_lines=most, placeholder=" ...")
        ]


def _style(status: Status) -> str:
    return "red" if status.alarms else STYLES.get(status.tick.phase, "default")
