"""Strip charts over time and a track, as inline SVG: small, sharp in print, no script needed to see them."""

import re
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from math import floor, log10

import numpy as np

from circnav_mav.report.segments import broken
from circnav_mav.runlog.ticks import Column

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 960, 64, 12, 8, 22
COLUMNS = 800
"""Most points of a line are twice this: the least and the largest value of each column of pixels."""
DIGIT = 7.0
"""Width of a digit of a label, px."""
FAR = 100
"""Heights of a chart beyond which a line is not followed: browsers lose count of pixels somewhere."""
MOST_DOTS = 4000
"""Of all dots of a line, about this many are drawn beside the least and the largest of each column."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line over time (or dots), with its name for the legend."""

    name: str
    time: Column
    values: Column
    colour: str
    dots: bool = False
    width: float = 1.2


@dataclass(frozen=True, slots=True)
class Chart:
    """A strip chart. levels: (name, value, colour) horizontal dashed lines. band: shaded from, to. shown: limits of the
    y axis, None for those of the data. height: of the whole, px."""

    title: str
    unit: str
    lines: list[Line]
    levels: list[tuple[str, float, str]] = field(default_factory=list)
    band: tuple[float, float] | None = None
    shown: tuple[float, float] | None = None
    height: int = 190

    def draw(self, span: tuple[float, float]) -> str:
        """As SVG, over a span of time."""
        low, high = self.shown or self._limits()
        scale = _Scale(span, (low, high), self.height)
        parts = [scale.frame()]
        if self.band:
            top, bottom = scale.y(min(self.band[1], high)), scale.y(max(self.band[0], low))
            size = f'width="{scale.width}" height="{bottom - top:.1f}"'
            parts.append(f'<rect x="{LEFT}" y="{top:.1f}" {size} class="band"/>')
        parts += [scale.level(value, colour) for _, value, colour in self.levels if low <= value <= high]
        parts.append(scale.clipped("".join(map(scale.line, self.lines)), self.title))
        return _figure(self.title, self.unit, self._legend(), self.height, "".join(parts), span)

    def _limits(self) -> tuple[float, float]:
        values = np.concatenate([line.values for line in self.lines] + [np.array([v for _, v, _ in self.levels])])
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        room = (high - low or abs(high) or 1.0) * 0.06
        return low - room, high + room

    def _legend(self) -> list[tuple[str, str]]:
        return [(line.name, line.colour) for line in self.lines] + [(name, colour) for name, _, colour in self.levels]


def spans_chart(title: str, time: Column, words: list[str], colours: dict[str, str], span: tuple[float, float]) -> str:
    """Words over time as a coloured band."""
    scale = _Scale(span, (0.0, 1.0), 56)
    parts, begins = [], [i for i, word in enumerate(words) if i == 0 or word != words[i - 1]]
    for begin, end in zip(begins, [*begins[1:], len(words) - 1], strict=True):
        left, right = scale.x(float(time[begin])), scale.x(float(time[end]))
        colour = colours.get(words[begin], "#bbb")
        parts.append(
            f'<rect x="{left:.1f}" y="{TOP}" width="{max(right - left, 0.6):.1f}" height="26" fill="{colour}">'
            f"<title>{escape(words[begin])} from {time[begin]:.1f} s</title></rect>"
        )
    seen = [(word, colours.get(word, "#bbb")) for word in dict.fromkeys(words)]
    return _figure(title, "", seen, 56, "".join(parts) + scale.times(), span)


def bars_chart(title: str, unit: str, bars: list[tuple[str, Column, str]], span: tuple[float, float]) -> str:
    """Moments counted in equal bins over the span, drawn one behind the other: (name, times, colour)."""
    bins = int(min(240, max(1, span[1] - span[0])))
    counts = [np.histogram(times, bins=bins, range=span)[0] * bins / (span[1] - span[0]) for _, times, _ in bars]
    scale = _Scale(span, (0.0, max(1.0, *(float(c.max()) for c in counts)) * 1.05), 120)
    parts = [scale.frame()]
    width = scale.width / bins
    for (_, _, colour), heights in zip(bars, counts, strict=True):
        steps = "".join(
            f"M{LEFT + at * width:.1f},{scale.y(0):.1f}V{scale.y(float(rate)):.1f}h{width:.2f}V{scale.y(0):.1f}Z"
            for at, rate in enumerate(heights)
            if rate
        )
        parts.append(f'<path d="{steps}" fill="{colour}"/>')
    return _figure(title, unit, [(name, colour) for name, _, colour in bars], 120, "".join(parts), span)


def track(x: Column, y: Column, radius: float, colour: str, *, side: int = 520, whole: bool = True) -> str:
    """A track round the target at the origin: desired circle dashed, start, target, arrows in the sense of flight. NaN
    breaks it. whole: the track begins where the flight did, else its beginning is marked hollow."""
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    stretch = known - np.arange(len(known))  # the same as long as nothing is left out
    x, y = x[known], y[known]
    reach = max(radius, float(np.max(np.abs(x))), float(np.max(np.abs(y)))) * 1.08
    scale, half = side / (2 * reach), side / 2
    keep = np.linspace(0, len(x) - 1, min(len(x), 3000)).astype(int)
    points = [f"{half + scale * a:.1f},{half - scale * b:.1f}" for a, b in zip(x[keep], y[keep], strict=True)]
    pens = np.where(np.diff(stretch[keep], prepend=-1) != 0, "M", "L").tolist()
    path = "".join(pen + point for pen, point in zip(pens, points, strict=True))
    start = 'fill="red"' if whole else 'fill="none" stroke="red" stroke-width="2"'
    parts = [
        f'<rect width="{side}" height="{side}" class="plot"/>', _rose(reach, side),
        f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.2"/>',
        f'<circle cx="{half}" cy="{half}" r="{scale * radius:.1f}" class="desired"/>',  # on the track, not under it
        *(_arrow(x, y, share, scale, half, colour) for share in (0.08, 0.25, 0.45, 0.65, 0.85, 0.99)),
        f'<path d="M{half - 8},{half}h16M{half},{half - 8}v16" stroke="black" stroke-width="2"/>',
        f'<path d="M{points[0]}m0,-8l7,13h-14z" {start}/>',
    ]  # fmt: skip
    return f'<svg viewBox="0 0 {side} {side}" class="track" role="img" aria-label="track">{"".join(parts)}</svg>'


def _rose(reach: float, side: int) -> str:
    """A length to compare with, and where north is."""
    length = _nice(reach / 2)
    pixels = length * side / (2 * reach)
    return (
        f'<path d="M12,{side - 14}h{pixels:.1f}" stroke="#444" stroke-width="3"/>'
        f'<text x="12" y="{side - 20}">{length:g} m</text><path d="M{side - 18},34v-22l-5,9m5,-9l5,9" class="axis"/>'
        f'<text x="{side - 22}" y="48">N</text>'
    )


def _arrow(x: Column, y: Column, share: float, scale: float, half: float, colour: str) -> str:
    at = max(int(share * (len(x) - 1)) - 1, 0)
    ahead = next((i for i in range(at + 1, len(x)) if (x[i], y[i]) != (x[at], y[at])), None)
    if ahead is None:
        return ""
    turn = np.degrees(np.arctan2(-(y[ahead] - y[at]), x[ahead] - x[at]))
    place = f"translate({half + scale * x[at]:.1f},{half - scale * y[at]:.1f}) rotate({turn:.0f})"
    return f'<path d="M-6,-6L8,0L-6,6Z" transform="{place}" fill="{colour}"/>'


class _Scale:
    """From seconds and values to pixels."""

    def __init__(self, span: tuple[float, float], limits: tuple[float, float], height: int) -> None:
        self._span, self._limits, self._height = span, limits, height
        self.width = WIDTH - LEFT - RIGHT

    def x(self, time: float) -> float:
        return LEFT + self.width * (time - self._span[0]) / (self._span[1] - self._span[0])

    def y(self, value: float) -> float:
        low, high = self._limits
        return TOP + (self._height - TOP - BOTTOM) * (high - value) / (high - low)

    def frame(self) -> str:
        """Background, grid and numbers of both axes."""
        height = self._height - TOP - BOTTOM
        parts = [f'<rect x="{LEFT}" y="{TOP}" width="{self.width}" height="{height}" class="plot"/>']
        for value in _ticks(*self._limits, 4):
            y = self.y(value)
            parts.append(f'<path d="M{LEFT},{y:.1f}h{self.width}" class="grid"/>')
            parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
        return "".join(parts) + self.times()

    def times(self) -> str:
        """The numbers of the time axis."""
        bottom, labels = self._height - 6, [(time, f"{time:g}") for time in _ticks(*self._span, 10)]
        return "".join(
            f'<text x="{min(self.x(time), WIDTH - DIGIT * len(label) / 2):.1f}" y="{bottom}" text-anchor="middle">'
            f"{label}</text>"
            for time, label in labels
        )

    def level(self, value: float, colour: str) -> str:
        return f'<path d="M{LEFT},{self.y(value):.1f}h{self.width}" stroke="{colour}" class="level"/>'

    def clipped(self, drawn: str, title: str) -> str:
        """What is drawn cut off at the frame. title: of the chart, which no other one on the page has."""
        name = "frame-" + re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
        size = f'width="{self.width}" height="{self._height - TOP - BOTTOM}"'
        frame = f'<clipPath id="{name}"><rect x="{LEFT}" y="{TOP}" {size}/></clipPath>'
        return f'{frame}<g clip-path="url(#{name})">{drawn}</g>'

    def line(self, line: Line) -> str:
        """The least and the largest value of each column of pixels, broken where nothing is known."""
        if line.dots:
            return self._dots(line)
        low, high = self._limits
        far = FAR * (high - low)
        time, values = broken(line.time, np.clip(line.values, low - far, high + far))
        time, values = thin(time, values)
        parts, pen = [], "M"
        for t, v in zip(time.tolist(), values.tolist(), strict=True):
            if v != v:
                pen = "M"
                continue
            parts.append(f"{pen}{self.x(t):.1f},{self.y(v):.1f}")
            pen = "L"
        return f'<path d="{"".join(parts)}" fill="none" stroke="{line.colour}" stroke-width="{line.width}"/>'

    def _dots(self, line: Line) -> str:
        """As of a line, and every n-th, so that they are dense where most of them are. What lies beyond the frame is a
        triangle at its edge that points there."""
        (low, high), every = self._limits, max(1, -(-len(line.values) // MOST_DOTS))
        time, values = thin(line.time, line.values)
        time, values = np.concatenate([time, line.time[::every]]), np.concatenate([values, line.values[::every]])
        dots, beyond = [], []
        for t, v in zip(time.tolist(), values.tolist(), strict=True):
            if low <= v <= high:
                dots.append(f"M{self.x(t):.1f},{self.y(v):.1f}h0")
            elif v == v:
                edge, inwards = (high, 5) if v > high else (low, -5)
                beyond.append(f"M{self.x(t):.1f},{self.y(edge):.1f}l-3,{inwards}h6Z")
        drawn = f'<path d="{"".join(dots)}" stroke="{line.colour}" stroke-width="3" stroke-linecap="round"/>'
        return drawn + (f'<path d="{"".join(beyond)}" fill="{line.colour}" class="beyond"/>' if beyond else "")


def thin(time: Column, values: Column, columns: int = COLUMNS) -> tuple[Column, Column]:
    """At most two points per column that still show every peak."""
    if len(values) <= 2 * columns:
        return time, values
    keep: list[int] = []
    edges = np.linspace(0, len(values), columns + 1).astype(int).tolist()
    for begin, end in pairwise(edges):
        part = values[begin:end]
        known = np.flatnonzero(np.isfinite(part))
        if len(known):
            found = {int(known[part[known].argmin()]), int(known[part[known].argmax()])}
            keep += [begin + at for at in sorted(found)]
        if len(known) < len(part):
            keep.append(begin + int(np.flatnonzero(~np.isfinite(part))[-1]))
    order = np.unique(keep)
    return time[order], values[order]


def _ticks(low: float, high: float, about: int) -> list[float]:
    step = _nice((high - low) / about)
    first = np.ceil(low / step)
    return [round(float(n * step), 10) for n in np.arange(first, high / step + 1e-9)]


def _nice(length: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a length."""
    power = 10.0 ** floor(log10(length))
    return float(max(n * power for n in (1, 2, 5) if n * power <= length * (1 + 1e-9)))


def _figure(
    title: str, unit: str, legend: list[tuple[str, str]], height: int, inside: str, span: tuple[float, float]
) -> str:
    named = [(escape(name), colour) for name, colour in legend if name]
    keys = "".join(f'<span class="key"><i style="background:{colour}"></i>{name}</span>' for name, colour in named)
    unit = f' <span class="unit">{escape(unit)}</span>' if unit else ""
    svg = (
        f'<svg viewBox="0 0 {WIDTH} {height}" class="strip" data-from="{span[0]}" data-to="{span[1]}" role="img" '
        f'aria-label="{escape(title)}">{inside}<path class="cursor" d="M0,{TOP}V{height - BOTTOM}"/></svg>'
    )
    return f"<figure><figcaption><b>{escape(title)}</b>{unit}{keys}</figcaption>{svg}</figure>"
