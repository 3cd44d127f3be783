"""Results of the benchmark, as one cell per law and situation: printed line, tables of
docs/measured.md, picture."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from circnav_mav.extras.bench.situations import SITUATIONS
from circnav_mav.runlog.atomic_write import atomic_write

OWN = "auto"
"""Law for which the results have a separate table with all figures."""
LOST = 300.0
"""From this median RMS radius error on, m, the tables show "lost" instead of the number."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One law in one situation. Lengths in m, times in s. *_p95, *_p99: 95th and 99th percentile
    over the flights.

    kept: number of flights that kept the circle.
    rms_*: RMS radius error over the last 100 s.
    peak_median: median of the largest radius error over the last 100 s.
    mean_error: mean radius error over the last 100 s.
    settled10_*, settled2_*: time of the last exit from ±10 % and ±2 % of the radius, divided by the
    Dubins time to the tangent point, for starts outside 1.3 radii.
    closest_outside: 1st percentile of the closest approach to the target, for starts outside.
    overshoot_inside: median overshoot of starts inside the circle.
    wrong_way: number of flights that swept at least a quarter turn the wrong way.
    turn_*: medians of the figures of the turn command over the last 100 s.
    limit_cycles: number of flights with a limit cycle (see `TurnFigures`).
    range_rmse, rate_rmse: RMS error of the estimated range (m) and range rate (m/s) over the last
        100 s.
    nees_mean: mean normalized estimation error squared (NEES) of (r, theta).
    nees_in_band: fraction of steps with this NEES in its 95 % band.
    difference_*: RMS radius error minus the RMS error of the situation's first policy in the same
    world: median, and its 95 % interval (NaN below six flights).
    seconds: processor time of all flights.
    """

    situation: str
    policy: str
    flights: int
    kept: int
    rms_median: float
    rms_p95: float
    rms_max: float
    peak_median: float
    mean_error: float
    settled10_median: float
    settled10_p95: float
    settled2_median: float
    settled2_p95: float
    closest_outside: float
    overshoot_inside: float
    wrong_way: int
    turn_std_deg_s: float
    turn_at_limit: float
    turn_variation_rad_s2: float
    limit_cycles: int
    range_rmse: float
    rate_rmse: float
    rate_p99: float
    nees_mean: float
    nees_in_band: float
    difference_median: float
    difference_low: float
    difference_high: float
    seconds: float


def line(cell: Cell) -> str:
    """Return the printed line of a cell. Settling: median and 95th percentile, in ideal times
    (Dubins times)."""
    need = SITUATIONS[cell.situation].required
    required = "" if need is None or cell.policy != OWN else f" (<= {need:.2f})"
    wrong = f"wrong way {cell.wrong_way}  " if cell.wrong_way else ""
    cycles = f", limit cycles {cell.limit_cycles}" if cell.limit_cycles else ""
    interval = ""
    if isfinite(cell.difference_low):
        interval = f" ({cell.difference_low:+.3f} to {cell.difference_high:+.3f})"
    paired = ""
    if cell.difference_median:
        paired = f", minus the first law's {cell.difference_median:+.3f}{interval}"
    return (
        f"{cell.situation:24s} {cell.policy:22s} kept {cell.kept:4d} of {cell.flights}  {wrong}RMS"
        f" {cell.rms_median:7.3f} p95 {cell.rms_p95:8.3f}{required}{paired}, peak"
        f" {cell.peak_median:.2f} "
        f" settled to 10 % in {cell.settled10_median:.2f}/{cell.settled10_p95:.2f} ideal times, to"
        f" 2 % in {cell.settled2_median:.2f}  turn sd {cell.turn_std_deg_s:.1f} deg/s, at the limit"
        f" {100 * cell.turn_at_limit:.0f} %, varies {cell.turn_variation_rad_s2:.2f} rad/s per"
        f" s{cycles}  r' {cell.rate_rmse:.3f}  {cell.seconds:.0f} s"
    )


def write_csv(cells: list[Cell], path: Path) -> None:
    with atomic_write(path) as fresh, fresh.open("w", newline="", encoding="utf-8") as file:
        rows = [asdict(cell) for cell in cells]
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(
            {k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows
        )


COLUMNS: dict[str, Callable[[Cell], str]] = {
    "situation": lambda cell: cell.situation,
    "flights that kept the circle": lambda cell: f"{cell.kept} of {cell.flights}",
    "RMS radius error, m: median / 95th percentile / worst; median peak": lambda cell: (
        f"**{cell.rms_median:.3f}** / {cell.rms_p95:.3f} / {cell.rms_max:.2f};"
        f" {cell.peak_median:.2f}"
    ),
    "required RMS, m": lambda cell: (
        "report" if (need := SITUATIONS[cell.situation].required) is None else f"{need:.2f}"
    ),
    "settled to ±10 %, Dubins times: median / 95th percentile": lambda cell: (
        f"{_times(cell.settled10_median)} / {_times(cell.settled10_p95)}"
    ),
    "settled to ±2 %, Dubins times: median": lambda cell: (
        f"{_times(cell.settled2_median)} / {_times(cell.settled2_p95)}"
    ),
    "turn command: standard deviation, deg/s / share at the limit / total variation, rad/s per s": (
        lambda cell: (
            f"{cell.turn_std_deg_s:.1f} / {100 * cell.turn_at_limit:.0f} % /"
            f" {cell.turn_variation_rad_s2:.2f}"
        )
    ),
    "limit cycles": lambda cell: f"{cell.limit_cycles}",
    "closest approach to the target, m: 1st percentile of the starts outside": lambda cell: (
        f"{cell.closest_outside:.0f}"
    ),
    "RMS error of the range rate, m/s": lambda cell: f"{cell.rate_rmse:.3f}",
    "NEES (squared estimation error over its variance): mean / share of steps in the 95 % band": (
        lambda cell: f"{cell.nees_mean:.1f} / {100 * cell.nees_in_band:.0f} %"
    ),
}
"""Columns of the table of the law OWN: value of a cell, by the heading of the column."""


def markdown(cells: Sequence[Cell]) -> str:
    """Return the table of `auto`, and then the table of the other laws that were flown.

    A cell of the second table has three figures: the median RMS radius error, the number of flights
    that kept the circle, and the standard deviation of the turn command. The number (in brackets)
    is left out if all flights kept the circle.
    """
    own, others = (
        [cell for cell in cells if (cell.policy == OWN) is mine] for mine in (True, False)
    )
    tables = (
        [_table(tuple(COLUMNS), [[text(cell) for text in COLUMNS.values()] for cell in own])]
        if own
        else []
    )
    if others:
        laws = list(dict.fromkeys(cell.policy for cell in others))
        rows: dict[str, dict[str, str]] = {
            cell.situation: dict.fromkeys(laws, "") for cell in others
        }
        for cell in others:
            kept = "" if cell.kept == cell.flights else f" ({cell.kept})"
            rows[cell.situation][cell.policy] = (
                f"{median_or_lost(cell)}{kept}, sd {cell.turn_std_deg_s:.1f}"
            )
        tables.append(
            _table(("situation", *laws), [(row, *texts.values()) for row, texts in rows.items()])
        )
    return "\n".join(tables)


def median_or_lost(cell: Cell) -> str:
    """Return the median RMS radius error for the tables, or "lost"."""
    return f"{cell.rms_median:.2f}" if cell.rms_median < LOST else "lost"


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
        figure = Figure(figsize=(width, max(2.2, 1.3 + 0.22 * len(rows))), layout="constrained")
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
            axes.text(j, i, text + kept, ha="center", va="center", fontsize=5.5, color=ink)
        image = axes.imshow(values, norm=scale, cmap="viridis", aspect="auto")
        axes.set_xticks(range(len(columns)), columns, rotation=35, ha="right")
        axes.set_yticks(range(len(rows)), rows)
        axes.set_xlabel(f"in brackets: flights of {cells[0].flights} that kept the circle")
        figure.colorbar(image, ax=axes, label="median RMS radius error, m", format="%g")
        save(figure, path, dpi=200)


def _times(value: float) -> str:
    return f"{value:.2f}" if isfinite(value) else "never"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (header, ["---"] * len(header), *rows))
