"""Section of the report: figures of the fleet, and its phases and gaps over time, from
fleet.csv."""

import csv
from collections.abc import Sequence
from itertools import pairwise
from math import degrees, radians
from pathlib import Path
from typing import Any

from circnav_mav.extras.fleet.evenness import gap_error
from circnav_mav.foreign import read_lines
from circnav_mav.report.page import escape, rows
from circnav_mav.runlog.run_folder import Run

EVERY = 0.5
"""Smallest time between two drawn samples, s."""
COLORS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")
"""Paul Tol's bright scheme: distinct for color-blind readers."""
WIDTH = 1000
HEIGHT = 190
LEFT = 44
TOP = 8
BOTTOM = 20
"""Size and margins of a chart, px."""
LARGEST_ERROR = 60.0
"""Upper end of the axis of gap errors, deg."""
BREAK = 90.0
"""Change between two samples, deg, at which a line is interrupted: the phase has wrapped, or the
ring has changed."""

Ring = dict[str, float]
"""Phases of the members on the circle, deg, by id."""
Line = tuple[str, list[tuple[float, float]]]
"""Color and points."""


def report_section(run: Run) -> str:
    """Return the section "Fleet" of a run, empty for a single vehicle. Raises OSError,
    ValueError."""
    path = run.folder / "fleet.csv"
    summary = run.summary.get("fleet")
    if not path.is_file():
        return ""
    found: dict[str, Any] = summary if isinstance(summary, dict) else {}
    charts = _charts(_rings(path), str(found.get("id", "")))
    return f"<h2>Fleet</h2><table>{rows(_figures(found))}</table>{charts}"


def _figures(found: dict[str, Any]) -> dict[str, str]:
    """Return the figures of summary.json as texts, by label."""
    labels = {
        "id": ("id of this vehicle", ""),
        "members": ("ids of all members", ""),
        "even_after_s": ("time from entering the circle to even within 5 deg", " s"),
        "worst_gap_deg": ("largest gap error from then on, rms", " deg"),
        "nearest_layer_m": ("smallest vertical distance to another member", " m"),
    }
    return {
        label: "unknown" if found[key] is None else f"{found[key]}{unit}".strip("[]")
        for key, (label, unit) in labels.items()
        if key in found
    }


def _rings(path: Path) -> list[tuple[float, Ring]]:
    """Return time and ring of each sample to be drawn. Raises OSError, ValueError."""
    found: list[tuple[float, Ring]] = []
    for row in csv.DictReader(read_lines(path)):
        time = float(row["time"])
        if not found or time >= found[-1][0] + EVERY:
            pairs = (pair.split(":") for pair in (row.get("ring") or "").split())
            found.append((time, {str(int(member)): float(phase) for member, phase in pairs}))
    return found


def _charts(rings: Sequence[tuple[float, Ring]], own: str) -> str:
    """Return the charts of phases and gap errors as HTML."""
    if len(rings) < 2:
        return ""
    members = sorted({member for _, ring in rings for member in ring}, key=int)
    colors = {member: COLORS[i % len(COLORS)] for i, member in enumerate(members)}
    lines = [
        (
            colors[one],
            [
                (time, (ring[one] - ring[own]) % 360)
                for time, ring in rings
                if {one, own} <= ring.keys()
            ],
        )
        for one in members
        if one != own
    ]
    keys = "".join(
        f'<span class="key"><i style="--c:{colors[one]}"></i>{escape(one)}</span>'
        for one in members
        if one != own
    )
    errors = [
        (time, min(degrees(gap_error([radians(phase) for phase in ring.values()])), LARGEST_ERROR))
        for time, ring in rings
        if len(ring) > 1
    ]
    span = rings[0][0], rings[-1][0]
    return _chart(
        f"phase ahead of this vehicle{keys}", span, lines, [0, 90, 180, 270, 360]
    ) + _chart(
        "largest gap error", span, [(COLORS[0], errors)], [0, 5, 20, 40, round(LARGEST_ERROR)]
    )


def _chart(
    title: str, span: tuple[float, float], lines: Sequence[Line], levels: Sequence[int]
) -> str:
    """Return one chart as HTML. levels: values of the grid lines, deg; the axis ends at the last
    one."""
    (first, last), top = span, levels[-1]

    def point(time: float, value: float) -> tuple[float, float]:
        x = LEFT + (WIDTH - LEFT) * (time - first) / max(last - first, 1.0)
        return round(x, 1), round(TOP + (HEIGHT - TOP - BOTTOM) * (1 - value / top), 1)

    parts = []
    for level in levels:
        _, y = point(first, level)
        parts.append(
            f'<path d="M{LEFT},{y}H{WIDTH}" class="grid"/><text x="4" y="{y + 4}">{level}</text>'
        )
    for share in range(5):
        time = first + share / 4 * (last - first)
        x, _ = point(time, 0)
        anchor = "start" if share == 0 else "end" if share == 4 else "middle"
        parts.append(f'<text x="{x}" y="{HEIGHT - 4}" text-anchor="{anchor}">{time:.0f} s</text>')
    for color, points in lines:
        drawn = [f"M{x},{y}" for x, y in (point(*one) for one in points[:1])]
        for before, one in pairwise(points):
            x, y = point(*one)
            drawn.append(f"{'M' if abs(one[1] - before[1]) > BREAK else 'L'}{x},{y}")
        parts.append(f'<path d="{"".join(drawn)}" class="line" style="--c:{color}"/>')
    return (
        f'<figure><figcaption><b>{title}</b> <span class="unit">deg</span></figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">{"".join(parts)}</svg></figure>'
    )
