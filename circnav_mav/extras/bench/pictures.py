"""Pictures of the benchmark: the table, and the consistency of the estimator."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from circnav_mav.extras.bench.table import LOST, Cell, median_or_lost


def draw(cells: Sequence[Cell], path: Path) -> None:
    """Draw the table: color by median RMS error, text with error and number of flights that kept
    the circle. Rows are situations, columns are laws."""
    import matplotlib as mpl  # the workers do not need matplotlib
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    from circnav_mav.report.plots import COLUMN, PAGE, PAPER, save

    rows = list(dict.fromkeys(c.situation for c in cells))
    columns = list(dict.fromkeys(c.policy for c in cells))
    values = np.full((len(rows), len(columns)), np.nan)
    scale = LogNorm(0.05, 50)
    with mpl.rc_context(PAPER | {"axes.grid": False, "font.size": 7}):
        # 2.7: width of the names of the situations (1.9) and of the color scale (0.8), inches.
        width = min(max(COLUMN, 2.7 + 0.5 * len(columns)), PAGE)
        figure = Figure(figsize=(width, max(2.8, 1.3 + 0.28 * len(rows))), layout="constrained")
        axes = figure.subplots()
        for cell in cells:
            i = rows.index(cell.situation)
            j = columns.index(cell.policy)
            values[i, j] = max(cell.rms_median, 1e-3)
            kept = "" if cell.kept == cell.flights else f" ({cell.kept})"
            ink = "white" if scale(values[i, j]) < 0.55 else "black"
            text = median_or_lost(cell)
            if 10 <= cell.rms_median < LOST:
                text = f"{cell.rms_median:.3g}"
            between = ""
            if np.isfinite(cell.rms_low):
                between = f"\n{cell.rms_low:.2g} to {cell.rms_high:.2g}"
            axes.text(
                j, i, text + kept + between, ha="center", va="center", fontsize=5.5, color=ink
            )
        image = axes.imshow(values, norm=scale, cmap="viridis", aspect="auto")
        axes.set_xticks(range(len(columns)), columns, rotation=35, ha="right")
        axes.set_yticks(range(len(rows)), rows)
        axes.set_xlabel(
            f"{cells[0].flights} flights a cell; in brackets: kept the circle\n"
            "second line: 95 % interval"
        )
        figure.colorbar(image, ax=axes, label="median RMS radius error, m", format="%g")
        save(figure, path, dpi=200)


def draw_consistency(cells: Sequence[Cell], path: Path) -> None:
    """Draw the mean NEES and NIS of each cell with its 95 % band.

    The values are those at the last range of each flight, so they are independent. If the
    covariance of the estimator is right, n times their mean has a chi-squared distribution with n
    times the degrees of freedom.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from scipy.special import gammaincinv

    from circnav_mav.report.plots import COLUMN, PAPER, save

    shown = [cell for cell in cells if cell.consistency_flights]
    names = [f"{cell.situation}, {cell.policy} (n = {cell.consistency_flights})" for cell in shown]
    n = np.array([cell.consistency_flights for cell in shown])
    spots = np.arange(len(shown))
    with mpl.rc_context(PAPER):
        figure = Figure(figsize=(2 * COLUMN, 1.2 + 0.22 * len(shown)), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        for axes, name, freedom in ((left, "nees_last", 2), (right, "nis_last", 1)):
            # Quantiles of chi-squared. scipy.stats would be imported for seconds.
            low, high = (2 * gammaincinv(freedom * n / 2, share) / n for share in (0.025, 0.975))
            axes.barh(spots, high - low, left=low, height=0.6, color="#cfdcec", label="95 % band")
            axes.axvline(freedom, color="#777777", lw=0.8)
            values = [getattr(cell, name) for cell in shown]
            axes.plot(values, spots, "o", ms=4, color="#d55e00", label="mean")
        left.set(yticks=spots, xlabel="NEES of the position (expected: 2)")
        left.set_yticklabels(names)
        left.invert_yaxis()
        right.set_xlabel("NIS of the range (expected: 1)")
        right.legend()
        save(figure, path, dpi=200)
