"""The figures of a table with their confidence intervals, over all flights and for every value that was swept."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import ceil, floor, isfinite, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from circnav_mav.analysis.whole_file import write_whole

Z = 1.959964
"""Both intervals are of 95 %."""
Interval = tuple[float | None, float | None]


@dataclass(frozen=True, slots=True)
class Figures:
    """failed: could not be flown. wrong_way: went round in the wrong sense. rms_*: m, radius error of the last third.
    settled_*: s from the engagement until within 5 % for good, None where that is never. closest: m, of all flights."""

    flights: int
    failed: int
    kept: int
    kept_share: float
    kept_interval: Interval
    wrong_way: int
    rms_median: float | None
    rms_interval: Interval
    rms_p95: float | None
    settled_median: float | None
    settled_p95: float | None
    closest: float | None


def figures(rows: Sequence[dict[str, str]]) -> Figures:
    """The figures of some rows of the table."""
    kept = sum(row["kept"] == "true" for row in rows)
    rms = np.sort([float(row["rms_m"]) for row in rows if row["rms_m"]])
    settled = np.sort([float(row["settled_s"] or "inf") for row in rows if row["rms_m"]])
    return Figures(
        flights=len(rows),
        failed=sum(row["outcome"] == "error" for row in rows),
        kept=kept,
        kept_share=kept / len(rows) if rows else 0.0,
        kept_interval=wilson(kept, len(rows)),
        wrong_way=sum(row["right_way"] == "false" for row in rows),
        rms_median=_percentile(rms, 50),
        rms_interval=median_interval(rms),
        rms_p95=_percentile(rms, 95),
        settled_median=_percentile(settled, 50),
        settled_p95=_percentile(settled, 95),
        closest=min((float(row["closest_m"]) for row in rows if row["closest_m"]), default=None),
    )


def summarise(rows: Sequence[dict[str, str]], swept: Sequence[str]) -> dict[str, Any]:
    """summary.json: "all", and "by" swept key and value."""
    by: dict[str, dict[str, Any]] = {}
    for key in swept:
        values = dict.fromkeys(row[key] for row in rows)
        by[key] = {value: asdict(figures([row for row in rows if row[key] == value])) for value in values}
    return {"all": asdict(figures(rows)), "by": by}


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write summary.json, whole or not at all. Raises OSError."""
    write_whole(folder / "summary.json", json.dumps(summary, indent=2) + "\n")


def wilson(hits: int, of: int) -> Interval:
    """Wilson's score interval of a share."""
    if of == 0:
        return None, None
    share, spread = hits / of, Z**2 / of
    middle = (share + spread / 2) / (1 + spread)
    half = Z / (1 + spread) * sqrt(share * (1 - share) / of + spread / (4 * of))
    return max(0.0, middle - half), min(1.0, middle + half)


def median_interval(ordered: Any) -> Interval:
    """Order statistics that hold the median: ranks n/2 -+ z sqrt(n)/2, rounded outwards; whatever the distribution."""
    n = len(ordered)
    if n == 0:
        return None, None
    low, high = floor(n / 2 - Z * sqrt(n) / 2), ceil(n / 2 + Z * sqrt(n) / 2)
    return float(ordered[max(low - 1, 0)]), float(ordered[min(high, n - 1)])


def _percentile(ordered: Any, q: float) -> float | None:
    """The larger neighbour, for there is no mean of a number and never."""
    value = float(np.percentile(ordered, q, method="higher")) if len(ordered) else float("inf")
    return value if isfinite(value) else None
