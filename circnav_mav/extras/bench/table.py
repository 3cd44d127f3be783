"""Results of the benchmark, as one cell per law and situation: printed line, tables of
docs/measured.md."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path

from circnav_mav.extras.bench.situations import SITUATIONS
from circnav_mav.runlog.atomic_write import atomic_write

OWN = "auto"
"""Law for which the results have a separate table with all figures."""
LOST = 300.0
"""Median RMS radius error from which the tables show "lost" instead of the number, m."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One law in one situation. Lengths in m, times in s. *_p95, *_p99: 95th and 99th percentile
    over the flights.

    kept: number of flights that kept the circle.
    rms_*: RMS radius error over the last 100 s. rms_low, rms_high: 95 % interval of its median (NaN
        below six flights).
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
        100 s. rate_p99: median of the 99th percentile of the absolute error in a flight.
    nees_mean: mean normalized estimation error squared (NEES) of the position over the accepted
        ranges of the last 100 s: of (r, theta) for `auto`, of (x, y) for a user-defined estimator
        that returns `RelativeMotion.position_covariance`, NaN for the others.
    nees_in_band: fraction of steps with this NEES in its 95 % band.
    nees_last, nis_last: mean NEES, and mean normalized innovation squared (NIS), at the last range
        of each flight. These values are independent. consistency_flights: their number.
    difference_*: RMS radius error minus the RMS error of the situation's first policy in the same
    world: median, and its 95 % interval (NaN below six flights).
    seconds: processor time of all flights.
    """

    situation: str
    policy: str
    flights: int
    kept: int
    rms_median: float
    rms_low: float
    rms_high: float
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
    nees_last: float
    nis_last: float
    consistency_flights: int
    difference_median: float
    difference_low: float
    difference_high: float
    seconds: float


def line(cell: Cell) -> str:
    """Return the printed line of a cell. Settling: median and 95th percentile, in ideal times
    (Dubins times)."""
    situation = SITUATIONS.get(cell.situation)  # None for one that the caller has defined
    need = None if situation is None else situation.required
    required = "" if need is None or cell.policy != OWN else f" (<= {need:.2f})"
    wrong = f"wrong way {cell.wrong_way}  " if cell.wrong_way else ""
    cycles = f", limit cycles {cell.limit_cycles}" if cell.limit_cycles else ""
    paired = ""
    if cell.difference_median:
        between = interval(cell.difference_low, cell.difference_high, "+.3f")
        paired = f", minus the first law's {cell.difference_median:+.3f}{between}"
    return (
        f"{cell.situation:24s} {cell.policy:22s} kept {cell.kept:4d} of {cell.flights}  {wrong}RMS"
        f" {cell.rms_median:7.3f} m{interval(cell.rms_low, cell.rms_high)} p95"
        f" {cell.rms_p95:8.3f}{required}{paired}, peak {cell.peak_median:.2f} "
        f" settled to 10 % in {cell.settled10_median:.2f}/{cell.settled10_p95:.2f} ideal times, to"
        f" 2 % in {cell.settled2_median:.2f}  turn sd {cell.turn_std_deg_s:.1f} deg/s, at the limit"
        f" {100 * cell.turn_at_limit:.0f} %, varies {cell.turn_variation_rad_s2:.2f} rad/s per"
        f" s{cycles}  r' {cell.rate_rmse:.3f}  {cell.seconds:.0f} s"
    )


def interval(low: float, high: float, form: str = ".3f") -> str:
    """Return the text of a 95 % interval, or an empty string if the interval is unknown."""
    return f" ({low:{form}} to {high:{form}})" if isfinite(low) else ""


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
    "RMS radius error, m: median (95 % interval) / 95th percentile / worst; peak": lambda cell: (
        f"**{cell.rms_median:.3f}**{interval(cell.rms_low, cell.rms_high)} / {cell.rms_p95:.3f} /"
        f" {cell.rms_max:.2f}; {cell.peak_median:.2f}"
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

    A cell of the second table has four figures: the median RMS radius error, its 95 % interval
    (from six flights on), the number of flights that kept the circle, and the standard deviation of
    the turn command. The number (in brackets)
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
                f"{median_or_lost(cell)}{interval(cell.rms_low, cell.rms_high, '.2f')}{kept}, sd"
                f" {cell.turn_std_deg_s:.1f}"
            )
        fewest, most = (pick(cell.flights for cell in others) for pick in (min, max))
        count = f"{most}" if fewest == most else f"{fewest} to {most}"
        heading = f"situation ({count} flights a cell; median RMS radius error, m, 95 % interval)"
        tables.append(
            _table((heading, *laws), [(row, *texts.values()) for row, texts in rows.items()])
        )
    return "\n".join(tables)


def median_or_lost(cell: Cell) -> str:
    """Return the median RMS radius error for the tables, or "lost"."""
    return f"{cell.rms_median:.2f}" if cell.rms_median < LOST else "lost"


def _times(value: float) -> str:
    return f"{value:.2f}" if isfinite(value) else "never"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (header, ["---"] * len(header), *rows))
