"""Plots of a run: flight.png (track if estimated, range, error, turn rate) and replay.png, and
functions that all plots share."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from circnav_mav.guidance.types import Orbit
from circnav_mav.report.chart_data import Track, broken, fresh, known_track, steady_command
from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runlog.metrics import TOLERANCE
from circnav_mav.runlog.ticks import Column, Ticks, Truth

STYLE: Any = {"font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "axes.axisbelow": True}
PAPER: Any = STYLE | {"font.size": 8, "pdf.fonttype": 42, "svg.hashsalt": "circnav"}
"""Style of figures for a paper: fonts embedded as text, equal files for equal data."""
COLUMN = 3.5
PAGE = 7.16
"""Figure widths for an IEEE paper: one column, and the full page of two columns, inches."""


def literal(text: str) -> str:
    """Return a text that matplotlib draws literally: a "$" in the name of a file or mission does
    not begin a formula."""
    return text.replace("$", r"\$")


def save(figure: Figure, path: Path, dpi: int = 110) -> None:
    """Write a PNG, PDF or SVG atomically, without a date. Raises OSError, and then keeps an older
    file."""
    form = path.suffix[1:]
    undated: dict[str, Any] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    with atomic_write(path) as fresh:
        figure.savefig(fresh, dpi=dpi, format=form, metadata=undated.get(form))


ESTIMATE = "#0063a6"
MEASURED = "#9aa9ba"
TRUE = "#d55e00"
DESIRED = "#007a5a"
LIMIT = "#777777"
HOLD_BAND = "#f6d8a8"


def plot_flight(path: Path, ticks: Ticks, truth: Truth | None, orbit: Orbit, title: str) -> None:
    """Draw a run and write it as PNG. Raises OSError."""
    time = ticks.time
    desired = ticks.desired(orbit.radius)
    track = known_track(ticks, truth)
    new = fresh(ticks)
    coasting = np.array([phase == "coasting" for phase in ticks.words["phase"]])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 7))  # no automatic layout: it draws everything twice
        figure.suptitle(literal(title), y=0.985)
        sides = {
            "left": 0.06,
            "right": 0.99,
            "bottom": 0.07,
            "top": 0.92,
            "hspace": 0.32,
            "wspace": 0.17,
        }
        grid = figure.add_gridspec(3, 2, width_ratios=[1.1, 1] if track else [0.001, 1], **sides)
        if track is not None:
            _track(figure.add_subplot(grid[:, 0]), track, ticks.radii(orbit.radius))
        axes = r, error, turn = [figure.add_subplot(grid[row, 1]) for row in range(3)]
        r.plot(
            time[new], ticks.numbers["measured"][new], ".", ms=2, color=MEASURED, label="measured"
        )
        _estimated_and_true(r, ticks, truth, less=0 * desired)
        _steps(r, time, desired, "desired")
        band = TOLERANCE * desired
        error.fill_between(
            time, -band, band, color=DESIRED, alpha=0.12, lw=0, label=f"±{100 * TOLERANCE:.0f} %"
        )
        _estimated_and_true(error, ticks, truth, less=desired)
        error.set_ylim(-3 * band.max(), 3 * band.max())
        _turn_rate(turn, ticks, truth, orbit)
        labels = "range, m", "range - radius, m", "turn rate, deg/s\n(left positive)"
        for axis, label in zip(axes, labels, strict=True):
            axis.set_ylabel(label)
            # Mark intervals without ranges, in which the vehicle kept its turn.
            if coasting.any():
                limits = axis.get_ylim()
                label = "no range, coasting"
                axis.fill_between(
                    time, *limits, where=coasting, color=HOLD_BAND, alpha=0.7, lw=0, label=label
                )
                axis.set_ylim(*limits)
            _legend_above(axis)
            axis.set_xlim(float(time[0]), float(time[-1]))
        turn.set_xlabel("time, s")
        save(figure, path)


def plot_replay(path: Path, was: Ticks | None, would: Ticks, orbit: Orbit, title: str) -> None:
    """Draw estimates and commands of the replay, and of the flight (`was`) if given. Raises
    OSError."""
    columns = (
        ("r", "range, m", 1.0),
        ("r_dot", "range rate, m/s", 1.0),
        ("turn_rate", "turn rate, deg/s", 180 / np.pi),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11, 8), layout="constrained")
        figure.suptitle(literal(title))
        for axis, (column, label, scale) in zip(
            figure.subplots(3, 1, sharex=True), columns, strict=True
        ):
            if was is not None:
                axis.plot(
                    *broken(was.time, scale * was.numbers[column]),
                    color=MEASURED,
                    lw=2.5,
                    label="as flown",
                )
            axis.plot(
                *broken(would.time, scale * would.numbers[column]),
                color=ESTIMATE,
                lw=1,
                label="replayed",
            )
            axis.set_ylabel(label)
        _steps(figure.axes[0], would.time, would.desired(orbit.radius), "desired")
        _legend_above(figure.axes[0])
        figure.axes[-1].set_xlabel("time, s")
        save(figure, path)


def _track(axis: Any, track: Track, radii: list[float]) -> None:
    angle = np.linspace(0, 2 * np.pi, 361)
    colour, label = (TRUE, "flown (truth)") if track.true else (ESTIMATE, "flown (estimate)")
    for at, radius in enumerate(radii):
        circle = radius * np.cos(angle), radius * np.sin(angle)
        label_once = None if at else "desired"
        axis.plot(
            *circle, "--", color=DESIRED, lw=1.5, label=label_once, zorder=3
        )  # draw the circle above the track
    axis.plot(track.east, track.north, color=colour, lw=1.0, label=label)
    east, north = track.east[track.known], track.north[track.known]
    begins = (
        {"mfc": "black", "label": "start"}
        if track.true
        else {"mfc": "none", "label": "first estimate"}
    )
    axis.plot(east[0], north[0], "^", mec="black", ms=9, **begins)
    axis.plot(0, 0, "k+", ms=12, mew=2, label="target")
    for at in _arrow_places(east, north):
        if np.hypot(east[at + 1] - east[at], north[at + 1] - north[at]) > 0:
            begin, end = (east[at], north[at]), (east[at + 1], north[at + 1])
            looks = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 18}
            axis.annotate("", xy=end, xytext=begin, arrowprops=looks)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="east of the target, m", ylabel="north of the target, m")
    _legend_above(axis)


def _arrow_places(east: Column, north: Column) -> list[int]:
    """Return the indices of direction arrows: one on the way to the circle, and one at the last
    pass of each of four bearings."""
    late = len(east) // 2
    bearing = np.arctan2(north, east)[late:-1]
    quarters = (np.angle(np.exp(1j * (bearing - quarter * np.pi / 2))) for quarter in range(4))
    found = [
        late + int(np.flatnonzero(np.abs(off) <= np.abs(off).min() + 0.1)[-1])
        for off in quarters
        if len(off)
    ]
    return [int(0.05 * (len(east) - 2)), *found]


def _legend_above(axis: Any) -> None:
    """Place the legend above the axis, where it covers no data."""
    axis.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=6,
        fontsize=8,
        frameon=False,
        borderaxespad=0.1,
        columnspacing=1.2,
        handlelength=1.6,
        handletextpad=0.5,
    )


def _steps(axis: Any, time: Column, values: Column, label: str) -> None:
    axis.plot(time, values, ls="--", color=DESIRED, lw=1, label=label, drawstyle="steps-post")


def _estimated_and_true(axis: Any, ticks: Ticks, truth: Truth | None, less: Column) -> None:
    """Draw estimated and true range, minus `less` (m, one value per tick)."""
    axis.plot(
        *broken(ticks.time, ticks.numbers["r"] - less), color=ESTIMATE, lw=1, label="estimated"
    )
    if truth is not None:
        then = less[np.maximum(np.searchsorted(ticks.time, truth.time, side="right") - 1, 0)]
        axis.plot(*broken(truth.time, truth.radius - then), color=TRUE, lw=0.8, label="true")


def _turn_rate(axis: Any, ticks: Ticks, truth: Truth | None, orbit: Orbit) -> None:
    name = "commanded" if np.isfinite(ticks.numbers["yaw_rate_sent"]).any() else "would command"
    axis.plot(
        *broken(ticks.time, np.degrees(ticks.numbers["turn_rate"])),
        color=ESTIMATE,
        lw=0.8,
        label=name,
    )
    if (command := steady_command(ticks, orbit)) is not None:
        label = f"steady command, gain {ticks.numbers['turn_gain'][-1]:.2f}"
        axis.plot(ticks.time, np.degrees(command), "--", color=ESTIMATE, lw=1.2, label=label)
    if truth is not None:
        axis.plot(
            *broken(truth.time, np.degrees(-truth.turn_rate)),
            color=TRUE,
            lw=0.6,
            alpha=0.7,
            label="true",
        )
    _steps(axis, ticks.time, np.degrees(ticks.steady_turn(orbit)), "steady circle")
    limit = np.degrees(orbit.max_turn_rate)
    for sign in (-1, 1):
        axis.axhline(sign * limit, ls=":", color=LIMIT, lw=1, label="limit" if sign > 0 else None)
