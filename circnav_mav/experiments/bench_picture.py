"""The benchmark's table as a picture: median RMS radius error in colour, flights kept in words."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from circnav_mav.experiments.bench_table import Cell, median_or_lost
from circnav_mav.report.plots import save


def draw(cells: Sequence[Cell], path: Path) -> None:
    """Situations down, laws across."""
    rows, columns = list(dict.fromkeys(c.situation for c in cells)), list(dict.fromkeys(c.policy for c in cells))
    values = np.full((len(rows), len(columns)), np.nan)
    width = max(5.5, 2 + 1.1 * len(columns))  # inches, of which the title needs 5.5
    figure = Figure(figsize=(width, 1.5 + 0.42 * len(rows)), layout="constrained")
    axes = figure.subplots()
    for cell in cells:
        i, j = rows.index(cell.situation), columns.index(cell.policy)
        values[i, j] = max(cell.rms_median, 1e-3)
        kept = "" if cell.kept == cell.flights else f"\n{100 * cell.kept / cell.flights:.0f} % kept"
        axes.text(j, i, median_or_lost(cell) + kept, ha="center", va="center", fontsize=7)
    image = axes.imshow(values, norm=LogNorm(0.05, 50), cmap="RdYlGn_r", aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=35, ha="right", fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    axes.set_title(f"Median RMS radius error, m, last 100 of 400 s, {cells[0].flights} flights a cell", fontsize=9)
    figure.colorbar(image, ax=axes, label="m")
    save(figure, path, dpi=130)
