"""Section of the report: figures of the fleet, and its phases and gaps over time, from
fleet.csv."""

import csv
from base64 import b64encode
from collections.abc import Sequence
from io import BytesIO
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from circnav_mav.extras.fleet.evenness import gap_error
from circnav_mav.foreign import read_lines
from circnav_mav.report.page import rows
from circnav_mav.runlog.run_folder import Run

COLORS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")
"""Line colors: Paul Tol's bright scheme, distinct for color-blind readers."""

Ring = dict[str, float]
"""Phases of the members on the circle, deg, by id."""


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
        "compass_deg": ("standard deviation of the gaps by compass errors, at the end", " deg"),
        "nearest_layer_m": ("smallest vertical distance to another member", " m"),
        "nearest_m": ("smallest measured distance to another member", " m"),
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
        # 0.5: smallest time between two drawn samples, s.
        if not found or time >= found[-1][0] + 0.5:
            pairs = (pair.split(":") for pair in (row.get("ring") or "").split())
            found.append((time, {str(int(member)): float(phase) for member, phase in pairs}))
    return found


def _charts(rings: Sequence[tuple[float, Ring]], own: str) -> str:
    """Return the charts of phases and gap errors as HTML."""
    if len(rings) < 2:
        return ""
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    time = [at for at, _ in rings]
    members = sorted({member for _, ring in rings for member in ring} - {own}, key=int)
    for i, member in enumerate(members):
        ahead = [
            (ring[member] - ring[own]) % 360 if {member, own} <= ring.keys() else np.nan
            for _, ring in rings
        ]
        # Interrupt the line where the phase wraps or the ring changes.
        broken = np.where(np.abs(np.diff(ahead, prepend=ahead[0])) > 90.0, np.nan, ahead)
        above.plot(time, broken, color=COLORS[i % len(COLORS)], label=f"vehicle {member}")
    errors = [degrees(gap_error([radians(one) for one in ring.values()])) for _, ring in rings]
    below.plot(time, errors, color=COLORS[0])
    above.set(ylabel="phase ahead of\nthis vehicle, deg", ylim=(0, 360), yticks=range(0, 361, 90))
    below.set(ylabel="largest gap\nerror, deg", ylim=(0, 60), xlabel="time, s")
    if members:
        above.legend(loc="upper right", fontsize=8)
    drawn = BytesIO()
    figure.savefig(drawn, dpi=100)
    data = b64encode(drawn.getvalue()).decode()
    return f'<img alt="phases and gap errors" src="data:image/png;base64,{data}">'
