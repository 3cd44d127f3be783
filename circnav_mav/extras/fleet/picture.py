"""Picture of a fleet: snapshots of its tracks, and phases and gaps over time."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from circnav_mav.extras.fleet.flight import SAMPLE_EVERY, Tracks
from circnav_mav.extras.fleet.metrics import gap_errors, true_phases
from circnav_mav.extras.fleet.phase import LAP
from circnav_mav.extras.fleet.report import State
from circnav_mav.extras.fleet.section import COLORS

FRAMES = 6
"""Number of snapshots; chosen."""
TRAIL = 15.0
"""Length of the trails, s."""


def draw_fleet(tracks: Tracks, path: Path) -> None:
    """Write the picture. Raises OSError."""
    figure = Figure(figsize=(12.0, 10.5), layout="constrained")
    grid = figure.add_gridspec(3, 3, height_ratios=(1.0, 1.0, 0.9))
    on = np.flatnonzero([State.ON_CIRCLE in states for states in tracks.state])
    first, last = (on[0], on[-1]) if len(on) else (0, len(tracks.time) - 1)
    # Most changes happen at the start: the snapshots are closer together there.
    share = np.array([0.0, 0.08, 0.2, 0.34, 0.52, 0.95])
    for place, index in enumerate((first + share * (last - first)).astype(int)):
        _frame(figure.add_subplot(grid[place // 3, place % 3]), tracks, int(index))
    _phases(figure.add_subplot(grid[2, :2]), tracks)
    _gaps(figure.add_subplot(grid[2, 2]), tracks)
    figure.savefig(path, dpi=110)


def _color(member: int) -> str:
    return COLORS[member % len(COLORS)]


def _frame(axes: Axes, tracks: Tracks, index: int) -> None:
    """Draw one snapshot with the trail of each member."""
    east, north = np.array(tracks.east), np.array(tracks.north)
    since = max(index - round(TRAIL / SAMPLE_EVERY), 0)
    angle = np.linspace(0.0, LAP, 200)
    axes.plot(tracks.radius * np.cos(angle), tracks.radius * np.sin(angle), color="0.75", ls="--", lw=0.8)
    axes.plot(0, 0, "x", color="0.3")
    extent = 1.35 * tracks.radius
    for member in range(east.shape[1]):
        trail = slice(since, index + 1)
        axes.plot(east[trail, member], north[trail, member], color=_color(member), lw=1.4)
        here = east[index, member], north[index, member]
        if max(map(abs, here)) < extent:
            axes.plot(*here, "o", color=_color(member), ms=7)
            text = str(member + 1)
            axes.annotate(text, here, textcoords="offset points", xytext=(6, 5), fontsize=9, annotation_clip=False)
    drift = np.array(tracks.drift[index])
    if np.hypot(*drift) > 0.3:
        tail = np.array([-0.95, 0.95]) * extent
        tip = tail + 0.35 * extent * drift / tracks.speed / max(np.hypot(*drift) / tracks.speed, 0.3)
        axes.annotate("", (tip[0], tip[1]), (tail[0], tail[1]), arrowprops={"arrowstyle": "->", "color": "0.4"})
        axes.text(tail[0], tail[1] - 0.45 * extent, f"drift {np.hypot(*drift):.0f} m/s", fontsize=8, color="0.4")
    axes.set(xlim=(-extent, extent), ylim=(-extent, extent), aspect="equal", title=f"{tracks.time[index]:.0f} s")
    axes.set_xticks([-tracks.radius, 0, tracks.radius], [f"{-tracks.radius:g}", "0", f"{tracks.radius:g} m"])
    axes.set_yticks([-tracks.radius, 0, tracks.radius], ["", "", ""])


def _phases(axes: Axes, tracks: Tracks) -> None:
    """Draw the phases relative to the mean motion. A member that keeps its slot is a level line."""
    time, phases = np.array(tracks.time), true_phases(tracks)
    on = np.array([[state is State.ON_CIRCLE for state in row] for row in tracks.state])
    unwrapped = np.unwrap(phases, axis=0)
    whole = on.all(axis=1)
    if not whole.any():
        axes.set(title="Phases of the members: never all on the circle", xticks=[], yticks=[])
        return
    mean = np.where(whole, unwrapped.mean(axis=1), np.nan)
    for member in range(phases.shape[1]):
        relative = np.degrees(unwrapped[:, member] - mean)
        axes.plot(time, relative, color=_color(member), label=str(member + 1), lw=1.3)
    axes.set(xlabel="time, s", ylabel="temporal phase less the mean, deg", title="Phases of the members")
    axes.grid(alpha=0.3)


def _gaps(axes: Axes, tracks: Tracks) -> None:
    """Draw the worst gap error over time."""
    errors = np.degrees(gap_errors(tracks))
    axes.semilogy(tracks.time, np.maximum(errors, 0.1), color="0.2", lw=1.2)
    axes.axhline(5.0, color="#ee6677", ls="--", lw=1.0)
    axes.set(xlabel="time, s", title="Worst gap error, deg (aim: 5)", ylim=(0.1, 400))
    axes.grid(alpha=0.3, which="both")
