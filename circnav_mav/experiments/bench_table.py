"""The benchmark as the two tables of BENCHMARK.md."""

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

from circnav_mav.experiments.batch.situations import SITUATIONS

if TYPE_CHECKING:
    from circnav_mav.experiments.bench import Cell

OWN = "auto"
"""The policy that has a table of its own, with all figures."""
LOST = 300.0
"""RMS error, m, of the median flight from which on it is called lost."""
HEADER = (
    "situation", "kept", "RMS radius error, m: median / 95th percentile / worst; median peak", "asked for",
    "settled to +-10 %", "to +-2 %", "turn command: sd deg/s / at the limit / rad/s per s", "limit cycles",
    "closest (1st pct., starts outside), m", "r' RMSE, m/s", "mean NEES / in 95 % band",
)  # fmt: skip


def markdown(cells: Sequence["Cell"]) -> str:
    """The table of `auto`, then that of the other laws: median RMS radius error, in brackets the flights kept where it
    is not all, after it the standard deviation of the turn command; whichever was flown."""
    own, others = ([cell for cell in cells if (cell.policy == OWN) is mine] for mine in (True, False))
    tables = [_table(HEADER, [_whole(cell) for cell in own])] if own else []
    if others:
        laws = list(dict.fromkeys(cell.policy for cell in others))
        found = {(cell.situation, cell.policy): _short(cell) for cell in others}
        rows = dict.fromkeys(cell.situation for cell in others)
        tables.append(
            _table(("situation", *laws), [(row, *(found.get((row, law), "") for law in laws)) for row in rows])
        )
    return "\n".join(tables)


def _whole(cell: "Cell") -> tuple[str, ...]:
    need = SITUATIONS[cell.situation].required
    return (
        cell.situation,
        f"{cell.kept} of {cell.flights}",
        f"**{cell.rms_median:.3f}** / {cell.rms_p95:.3f} / {cell.rms_max:.2f}; {cell.peak_median:.2f}",
        "report" if need is None else f"{need:.2f}",
        f"{_times(cell.settled10_median)} / {_times(cell.settled10_p95)}",
        f"{_times(cell.settled2_median)} / {_times(cell.settled2_p95)}",
        f"{cell.turn_std_deg_s:.1f} / {100 * cell.turn_at_limit:.0f} % / {cell.turn_variation_rad_s2:.2f}",
        f"{cell.limit_cycles}",
        f"{cell.closest_outside:.0f}",
        f"{cell.rate_rmse:.3f}",
        f"{cell.nees_mean:.1f} / {100 * cell.nees_in_band:.0f} %",
    )


def _short(cell: "Cell") -> str:
    error = f"{cell.rms_median:.2f}" if cell.rms_median < LOST else "lost"
    kept = "" if cell.kept == cell.flights else f" ({cell.kept})"
    return f"{error}{kept}, sd {cell.turn_std_deg_s:.1f}"


def _times(value: float) -> str:
    return f"{value:.2f}" if isfinite(value) else "never"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (header, ["---"] * len(header), *rows))
