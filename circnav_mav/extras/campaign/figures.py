"""Row of a flight in the table, computed from its true path, and figures of many rows with
confidence intervals."""

from collections.abc import Mapping, Sequence, Sized
from dataclasses import asdict
from math import atan2, degrees, hypot, isfinite, prod, sqrt
from typing import Any

import numpy as np

from circnav_mav.extras.campaign.lockstep import COMPLETED, FlightResult
from circnav_mav.extras.campaign.plan import Campaign, Run
from circnav_mav.runlog import metrics
from circnav_mav.runlog.many_flights import Interval, Z, median_interval, quantile
from circnav_mav.runlog.metrics import NAMES, late_figures

FIGURES = (
    "outcome",
    "start_range_m",
    "start_bearing_deg",
    "start_heading_deg",
    "engaged_s",
    "flown_s",
    "kept",
    "rms_m",
    "mean_error_m",
    "settled_s",
    "closest_m",
    *NAMES,
    "sense",
    "right_way",
    "error",
)
NUMBERS = frozenset(
    name for name in FIGURES if name.endswith(("_m", "_s", "_deg", "_at_limit", "_rad_s2"))
)
FAILED = "error"
"""Outcome of a run that could not be flown."""


def columns(campaign: Campaign) -> list[str]:
    """Return the header of the table."""
    return ["run", "sim.seed", *(key for key in campaign.specs if key != "sim.seed"), *FIGURES]


def row(run: Run, result: FlightResult) -> dict[str, Any]:
    """Return the row of a flight. The sense of rotation is that of the last third of the true path,
    and None below a quarter turn."""
    orbit = run.mission.orbit
    r = np.hypot(result.east, result.north)
    east, north, heading = result.start
    known: dict[str, Any] = {
        "run": run.number,
        **run.values,
        "outcome": result.outcome,
        "start_range_m": hypot(east, north),
        "start_bearing_deg": degrees(atan2(east, north)) % 360,
        "start_heading_deg": degrees(heading) % 360,
        "engaged_s": result.engaged,
        "kept": False,
    }
    if len(r) < 2:
        return known
    late = metrics.last_part(result.time, r)
    swept = metrics.swept_angle(
        *(metrics.last_part(result.time, values) for values in (result.north, result.east))
    )
    sense = metrics.direction_of(swept)
    rms = metrics.rms_error(late, orbit.radius)
    assert rms is not None
    turn = late_figures(result.turn_time, result.turn, result.turn_cut, orbit)
    # Condition of a kept flight: completed, in the required sense, and with an RMS radius error
    # below 10 % of the radius in its last third.
    kept = result.outcome == COMPLETED and sense is orbit.direction and rms < 0.1 * orbit.radius
    return known | {
        "flown_s": float(result.time[-1]),
        "kept": kept,
        "rms_m": rms,
        "mean_error_m": float(late.mean()) - orbit.radius,
        "settled_s": metrics.settled(result.time, r, orbit.radius),
        "closest_m": float(r.min()),
        **(asdict(turn) if turn else {}),
        "sense": sense.value if sense else None,
        "right_way": None if sense is None else sense is orbit.direction,
    }


def failed_row(number: int, values: dict[str, Any], error: str) -> dict[str, Any]:
    """Return the row of a run that could not be flown."""
    return {"run": number, **values, "outcome": FAILED, "kept": False, "error": error}


SUMMARY = "summary.json"
Rows = Sequence[dict[str, str]]
"""Rows of the table, as text."""


def figures(rows: Rows, points: int = 1) -> dict[str, Any]:
    """Return the figures of some rows of the table. For the intervals, flights with the same draws
    and noise are counted as one flight.

    points: number of grid points. In each pass over the grid, all points have the same draws.
    failed: number of runs that could not be flown.
    not_engaged: number of flights that ended before the engagement. Like failed runs, they have no
        RMS error and no settling time, so these figures cover the other flights.
    wrong_way: number of flights in the wrong sense.
    rms_*: RMS radius error of the last third, m.
    settled_*: time from the engagement to settling (`metrics.settled`), s; None: never.
    closest: closest approach of all flights, m.
    worlds: number of different draws.
    turn_*: medians of the figures of the turn command (see `TurnFigures`).
    limit_cycles: number of flights with a limit cycle.
    """
    flown = [row for row in rows if row["rms_m"]]
    worlds, worlds_flown = (
        len({int(row["run"]) // points for row in some}) for some in (rows, flown)
    )
    kept = sum(row["kept"] == "true" for row in rows)
    rms = known(rows, "rms_m")
    settled = np.sort([float(row["settled_s"] or "inf") for row in flown])
    share = kept / len(rows) if rows else 0.0
    return {
        "flights": len(rows),
        "worlds": worlds,
        "failed": sum(row["outcome"] == FAILED for row in rows),
        "not_engaged": sum(row["outcome"] != FAILED and not row["rms_m"] for row in rows),
        "kept": kept,
        "kept_share": share,
        "kept_interval": wilson(share, worlds),
        "wrong_way": sum(row["right_way"] == "false" for row in rows),
        "rms_median": percentile(rms, 50),
        "rms_interval": median_interval(rms, worlds_flown),
        "rms_p95": percentile(rms, 95),
        "settled_median": percentile(settled, 50),
        "settled_p95": percentile(settled, 95),
        "closest": min(known(rows, "closest_m"), default=None),
        **{name: percentile(known(rows, name), 50) for name in NAMES if name != "turn_limit_cycle"},
        "limit_cycles": sum(row["turn_limit_cycle"] == "true" for row in rows),
    }


def known(rows: Rows, name: str) -> Any:
    """Return the numbers of a column, sorted, without empty cells."""
    return np.sort([float(row[name]) for row in rows if row[name]])


def summarize(rows: Rows, swept: Mapping[str, Sized]) -> dict[str, Any]:
    """Return the contents of summary.json: figures of all rows ("all"), and of the rows of each
    swept key and value ("by"). swept: values of the grid by key.

    Each value except the first also has the paired differences from the first value.
    """
    points = prod(len(values) for values in swept.values())
    by: dict[str, dict[str, Any]] = {}
    for key in swept:
        others = [other for other in swept if other != key]
        of = {
            value: [row for row in rows if row[key] == value]
            for value in dict.fromkeys(row[key] for row in rows)
        }
        by[key] = {value: figures(some, points) for value, some in of.items()}
        for value in list(of)[1:]:
            by[key][value] |= _paired(of[next(iter(of))], of[value], others, points)
    return {"all": figures(rows, points), "by": by}


def _paired(before: Rows, after: Rows, others: Sequence[str], points: int) -> dict[str, Any]:
    """Return the differences of the RMS error (m) between flights with the same draws, the same
    noise and the same other values of the grid.

    pairs: number of pairs in which both flights have this error.
    """

    def errors(rows: Rows) -> dict[tuple[Any, ...], float]:
        return {
            (int(row["run"]) // points, *(row[key] for key in others)): float(row["rms_m"])
            for row in rows
            if row["rms_m"]
        }

    first = errors(before)
    then = errors(after)
    pairs = first.keys() & then.keys()
    differences = np.sort([then[pair] - first[pair] for pair in pairs])
    return {
        "pairs": len(pairs),
        "difference_median": percentile(differences, 50),
        "difference_interval": median_interval(differences, len({pair[0] for pair in pairs})),
    }


def wilson(share: float, worlds: int) -> Interval:
    """Return Wilson's score interval of a share.

    worlds: number of independent random draws. All flights with the same draws count as one flight,
        because they may all have the same result. If their results differ, the interval is wider
        than necessary.
    """
    if worlds == 0:
        return None, None
    spread = Z**2 / worlds
    middle = (share + spread / 2) / (1 + spread)
    half = Z / (1 + spread) * sqrt(share * (1 - share) / worlds + spread / (4 * worlds))
    return 0.0 if share == 0 else middle - half, 1.0 if share == 1 else middle + half


def percentile(values: Any, q: float) -> float | None:
    """Return a percentile, or None if it is infinite (an event that never occurs) or there are no
    values: JSON has no infinity."""
    value = quantile(values, q / 100)
    return value if isfinite(value) else None
