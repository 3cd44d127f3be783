"""Pictures of a fleet: snapshots of its tracks with the gaps over time, and an animation."""

from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from circnav_mav.extras.fleet.flight import SAMPLE_EVERY, Tracks
from circnav_mav.extras.fleet.metrics import gap_errors
from circnav_mav.extras.fleet.phase import LAP
from circnav_mav.extras.fleet.report import State
from circnav_mav.extras.fleet.section import COLORS


def draw_fleet(tracks: Tracks, path: Path) -> None:
    """Write the picture: a strip of snapshots, and gap errors over time. Raises OSError."""
    figure = Figure(figsize=(13.0, 4.4), layout="constrained")
    # 6: number of snapshots; chosen.
    grid = figure.add_gridspec(2, 6, height_ratios=(1.0, 0.8))
    first, last = _flown(tracks)
    # Times of the snapshots, as shares of the flight. They are closer together at the start, where
    # most changes happen.
    share = np.array([0.0, 0.08, 0.2, 0.34, 0.52, 0.95])
    for place, index in enumerate((first + share * (last - first)).astype(int)):
        _frame(figure.add_subplot(grid[0, place]), tracks, int(index))
    _gaps(figure.add_subplot(grid[1, :]), tracks)
    figure.savefig(path, dpi=110)


def animate_fleet(tracks: Tracks, path: Path) -> None:
    """Write the flight as an animation of 5 s. Raises OSError."""
    figure = Figure(figsize=(4.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    writer = PillowWriter(fps=10)
    first, last = _flown(tracks)
    with writer.saving(figure, path, dpi=90):
        for index in np.linspace(first, last, 50).astype(int):
            axes.clear()
            _frame(axes, tracks, int(index))
            writer.grab_frame()


def _flown(tracks: Tracks) -> tuple[int, int]:
    """Return the index of the first and the last sample with a member on the circle. Without any,
    return the first and last sample of the record."""
    on = np.flatnonzero([State.ON_CIRCLE in states for states in tracks.state])
    return (int(on[0]), int(on[-1])) if len(on) else (0, len(tracks.time) - 1)


def _frame(axes: Axes, tracks: Tracks, index: int) -> None:
    """Draw one snapshot with the fading trail of each member."""
    # 15.0: length of the trails, s.
    since = max(index - round(15.0 / SAMPLE_EVERY), 0)
    angle = np.linspace(0.0, LAP, 200)
    circle = tracks.radius * np.cos(angle), tracks.radius * np.sin(angle)
    axes.plot(*circle, color="0.75", ls="--", lw=0.8)
    axes.plot(0, 0, "x", color="0.3", ms=5)
    extent = 1.35 * tracks.radius
    trails = np.array([tracks.east, tracks.north])[:, since : index + 1]
    fading = np.linspace(0.0, 1.0, trails.shape[1])
    for member, trail in enumerate(trails.transpose(2, 1, 0)):
        color = COLORS[member % len(COLORS)]
        pieces = np.stack([trail[:-1], trail[1:]], axis=1)
        axes.add_collection(LineCollection(list(pieces), colors=color, alpha=fading[1:], lw=1.6))
        east, north = trail[-1]
        axes.plot(east, north, "o", color=color, ms=9)
        axes.text(
            east,
            north,
            str(member + 1),
            color="white",
            fontsize=6.5,
            weight="bold",
            ha="center",
            va="center_baseline",
            clip_on=True,
        )
    axes.set(xlim=(-extent, extent), ylim=(-extent, extent), aspect="equal", xticks=[], yticks=[])
    axes.set_title(f"{tracks.time[index]:.0f} s", fontsize=10)
    axes.spines[:].set_visible(False)


def _gaps(axes: Axes, tracks: Tracks) -> None:
    """Draw the worst gap error over time."""
    errors = np.degrees(gap_errors(tracks))
    axes.semilogy(tracks.time, np.maximum(errors, 0.5), color="0.2", lw=1.2)
    axes.axhline(5.0, color="#ee6677", ls="--", lw=1.0)
    axes.set(
        xlabel="time, s",
        title=f"Worst gap error, deg (aim: 5), circle of {tracks.radius:g} m",
        ylim=(0.5, 400),
    )
    axes.title.set_fontsize(10)
    axes.grid(alpha=0.3, which="both")
