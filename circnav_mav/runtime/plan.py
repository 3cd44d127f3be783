"""Two drawings for a large terminal, in text: the track seen from above, and the range over time."""

from collections.abc import Iterable
from math import cos, degrees, pi, sin

from rich.text import Text

from circnav_mav.pilot import TickRecord

MOST_POINTS = 1000
"""Maximum number of points kept. Beyond it, every second one is dropped. Chosen: drawing them takes milliseconds."""
LAPS = 2.0
"""Duration of the track that is shown, in laps of the desired circle. Chosen: beside a long approach, the circle would
be drawn small."""
ARROWS, ASCII_ARROWS = "↑↗→↘↓↙←↖", "^/>\\v/<\\"
"""Signs of the vehicle, by its heading in steps of 45 degrees."""
DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character, by row and column."""
TRACK, CIRCLE = "bold cyan", "green"
NO_TRACK = "No position yet: a range alone shows no direction."


class Canvas:
    """Drawing of dots and letters in character cells. A cell is one unit wide and two high; y grows downwards."""

    def __init__(self, columns: int, rows: int, *, ascii_only: bool) -> None:
        self._columns, self._rows, self._ascii = columns, rows, ascii_only
        self._bits: dict[tuple[int, int], int] = {}
        self._styles: dict[tuple[int, int], str] = {}
        self._letters: dict[tuple[int, int], str] = {}

    def dot(self, x: float, y: float, style: str) -> None:
        """Set the dot at a place. Outside the canvas nothing is drawn."""
        column, row = int(x // 1), int(y // 2)
        if 0 <= column < self._columns and 0 <= row < self._rows:
            bit = 1 if self._ascii else DOTS[int(2 * y) % 4][int(2 * x) % 2]
            self._bits[column, row] = self._bits.get((column, row), 0) | bit
            self._styles[column, row] = style

    def line(self, begin: tuple[float, float], end: tuple[float, float], style: str) -> None:
        """Draw a straight line."""
        (x, y), (to_x, to_y) = begin, end
        steps = min(int(2 * max(abs(to_x - x), abs(to_y - y))) + 1, 4 * (self._columns + 2 * self._rows))
        for step in range(steps + 1):
            share = step / steps
            self.dot(x + share * (to_x - x), y + share * (to_y - y), style)

    def write(self, x: float, y: float, letters: str) -> None:
        """Write letters over the drawing."""
        for number, letter in enumerate(letters):
            self._letters[int(x // 1) + number, int(y // 2)] = letter

    def text(self) -> Text:
        """Return the drawing."""
        drawn = Text(no_wrap=True, overflow="crop")
        for row in range(self._rows):
            for cell in ((column, row) for column in range(self._columns)):
                if cell in self._letters:
                    drawn.append(self._letters[cell], "bold")
                else:
                    bits = self._bits.get(cell, 0)
                    drawn.append(
                        (("." if self._ascii else chr(0x2800 | bits)) if bits else " "), self._styles.get(cell)
                    )
            drawn.append("\n")
        drawn.right_crop()
        return drawn


class History:
    """Ticks shown so far, thinned out evenly."""

    def __init__(self) -> None:
        self._ticks: list[TickRecord] = []
        self._every, self._count = 1, 0

    def add(self, tick: TickRecord) -> None:
        if self._count % self._every == 0:
            self._ticks.append(tick)
        self._count += 1
        if len(self._ticks) > MOST_POINTS:
            self._ticks, self._every = self._ticks[::2], 2 * self._every

    @property
    def span(self) -> float:
        """Time between the first and the last tick with a range, s."""
        known = [tick.time for tick in self._ticks if tick.r is not None]
        return known[-1] - known[0] if known else 0.0

    def plan(self, desired: float, lap: float, columns: int, rows: int, *, ascii_only: bool) -> Text:
        """Return the track relative to the target, north up. desired: radius, m. lap: time of one lap, s."""
        canvas = Canvas(columns, rows, ascii_only=ascii_only)
        places = [(tick, tick.x, tick.y) for tick in self._ticks if tick.x is not None and tick.y is not None]
        recent = [(x, y) for tick, x, y in places if tick.time > self._ticks[-1].time - LAPS * lap]
        middle_x, middle_y = columns / 2, float(rows)
        reach = max([1.15 * desired, *(1.05 * abs(part) for place in recent for part in place)])
        scale = min(middle_x, middle_y) / reach
        parts = max(24, int(2 * pi * desired * scale / 1.5))
        for part in range(parts):
            angle = 2 * pi * part / parts
            canvas.dot(middle_x + scale * desired * cos(angle), middle_y + scale * desired * sin(angle), CIRCLE)
        drawn = [(middle_x + scale * x, middle_y - scale * y) for x, y in recent]
        _join(canvas, drawn, TRACK)
        canvas.write(middle_x, middle_y, "+")
        newest = self._ticks[-1]
        if not drawn:
            canvas.write(max(0.0, middle_x - len(NO_TRACK) / 2), middle_y + 4, NO_TRACK)
        elif newest.heading is None or newest.x is None:
            canvas.write(*drawn[-1], "o")
        else:
            arrows = ASCII_ARROWS if ascii_only else ARROWS
            canvas.write(*drawn[-1], arrows[round(degrees(newest.heading) / 45) % 8])
        canvas.write(columns - 2, 0, "N")
        return canvas.text()

    def ranges(self, desired: float, columns: int, rows: int, *, ascii_only: bool) -> Text:
        """Return the range over time, with the desired circle."""
        canvas = Canvas(columns, rows, ascii_only=ascii_only)
        known = [(tick.time, tick.r) for tick in self._ticks if tick.r is not None]
        if not known:
            return canvas.text()
        low, high = (end(desired, *(r for _, r in known)) for end in (min, max))
        room = max(0.06 * (high - low), 0.02 * desired)
        low, high, begin = max(low - room, 0.0), high + room, known[0][0]
        top, bottom, left = f"{high:.0f} m", f"{low:.0f} m", 7
        wide, tall = (columns - left - 1) / max(known[-1][0] - begin, 1.0), 2 * rows - 0.5
        at = tall * (high - desired) / (high - low)
        for number in range(int((columns - left) / 2)):
            canvas.dot(left + 2 * number, at, CIRCLE)
        _join(canvas, [(left + wide * (time - begin), tall * (high - r) / (high - low)) for time, r in known], TRACK)
        for y, words in ((0.0, top), (2.0 * rows - 2, bottom)):
            canvas.write(0, y, words)
        if 2 <= at < 2 * rows - 2:
            canvas.write(0, at, f"{desired:.0f} m")
        return canvas.text()


def _join(canvas: Canvas, places: Iterable[tuple[float, float]], style: str) -> None:
    """Draw a line through the places."""
    before: tuple[float, float] | None = None
    for place in places:
        canvas.line(before or place, place, style)
        before = place
