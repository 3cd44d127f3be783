"""A track as one row of the table, from the true path alone, whichever engine flew it; and the figures of many rows
with their confidence intervals."""

from collections.abc import Mapping, Sequence, Sized
from dataclasses import asdict
from math import atan2, ceil, degrees, floor, hypot, isfinite, prod, sqrt
from typing import Any

import numpy as np

from circnav_mav.extras.campaign.lockstep import COMPLETED, Track
from circnav_mav.extras.campaign.plan import Campaign, Run
from circnav_mav.runlog import metrics
from circnav_mav.runlog.metrics import NAMES, late_figures

KEPT_WITHIN = 0.1
"""A flight is kept when it was completed, went round in the sense asked for, and the RMS radius error of its last third
is below this share of the radius."""
FIGURES = (
    "engine", "outcome", "start_range_m", "start_bearing_deg", "start_heading_deg", "engaged_s", "flown_s", "kept",
    "rms_m", "mean_error_m", "settled_s", "closest_m", *NAMES, "sense", "right_way", "error",
)  # fmt: skip
NUMBERS = frozenset(name for name in FIGURES if name.endswith(("_m", "_s", "_deg", "_at_limit", "_rad_s2")))
FAILED = "error"
"""The outcome of a run that could not be flown."""


def columns(campaign: Campaign) -> list[str]:
    """The header of the table."""
    return ["run", "sim.seed", *(key for key in campaign.specs if key != "sim.seed"), *FIGURES]


def row(run: Run, track: Track) -> dict[str, Any]:
    """The row of a flight. The sense of rotation is that of the true path's last third; None below a quarter turn."""
    orbit, r = run.mission.orbit, np.hypot(track.east, track.north)
    east, north, heading = track.start
    known: dict[str, Any] = {
        "run": run.number,
        **run.values,
        "engine": track.engine,
        "outcome": track.outcome,
        "start_range_m": hypot(east, north),
        "start_bearing_deg": degrees(atan2(east, north)) % 360,
        "start_heading_deg": degrees(heading) % 360,
        "engaged_s": track.engaged,
        "kept": False,
    }
    if len(r) < 2:
        return known
    late = metrics.last_part(track.time, r)
    swept = metrics.swept_angle(*(metrics.last_part(track.time, values) for values in (track.north, track.east)))
    sense = metrics.direction_of(swept)
    rms = metrics.rms_error(late, orbit.radius)
    assert rms is not None
    turn = late_figures(track.turn_time, track.turn, track.turn_cut, orbit)
    kept = track.outcome == COMPLETED and sense is orbit.direction and rms < KEPT_WITHIN * orbit.radius
    return known | {
        "flown_s": float(track.time[-1]),
        "kept": kept,
        "rms_m": rms,
        "mean_error_m": float(late.mean()) - orbit.radius,
        "settled_s": metrics.settled(track.time, r, orbit.radius),
        "closest_m": float(r.min()),
        **(asdict(turn) if turn else {}),
        "sense": sense.value if sense else None,
        "right_way": None if sense is None else sense is orbit.direction,
    }


def failed_row(number: int, values: dict[str, Any], error: str) -> dict[str, Any]:
    """The row of a run that could not be flown."""
    return {"run": number, **values, "outcome": FAILED, "kept": False, "error": error}


SUMMARY = "summary.json"
Z = 1.959964
"""Both intervals are of 95 %."""
LEAST_WORLDS = 6
"""Worlds from which on order statistics hold a median in 95 % of all cases: 1 - 2/2^6 is 97 %, 1 - 2/2^5 is 94 %."""
Interval = tuple[float | None, float | None]
Rows = Sequence[dict[str, str]]
"""Of the table, as text."""


def figures(rows: Rows, points: int = 1) -> dict[str, Any]:
    """The figures of some rows of the table. points: of the grid, which all share the draws of a round.

    failed: could not be flown. not_engaged: ended before it was ours; neither has an RMS error or a settling time, and
    those figures are of the others. wrong_way: went round in the wrong sense. rms_*: m, radius error of the last third.
    settled_*: s from the engagement until within 5 % for good, all of the last third included, None where that is
    never. closest: m, of all flights. worlds: flights that share their draws and their noise at several points of the
    grid count as one in the intervals. turn_*: medians of the flights' figures of the turn command (see `TurnFigures`).
    limit_cycles: flights whose command was in one."""
    flown = [row for row in rows if row["rms_m"]]
    worlds, worlds_flown = (len({int(row["run"]) // points for row in some}) for some in (rows, flown))
    kept, rms = sum(row["kept"] == "true" for row in rows), known(rows, "rms_m")
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
    """The numbers of a column where there are any, in their order of size."""
    return np.sort([float(row[name]) for row in rows if row[name]])


def summarise(rows: Rows, swept: Mapping[str, Sized]) -> dict[str, Any]:
    """summary.json: "all", and "by" swept key and value. swept: the values of the grid by key."""
    points = prod(len(values) for values in swept.values())
    by: dict[str, dict[str, Any]] = {}
    for key in swept:
        values = dict.fromkeys(row[key] for row in rows)
        by[key] = {value: figures([row for row in rows if row[key] == value], points) for value in values}
    return {"all": figures(rows, points), "by": by}


def wilson(share: float, worlds: int) -> Interval:
    """Wilson's score interval of a share, over so many worlds that are independent of one another. Flights in one world
    may all fare alike, so that they tell no more than one of them; where they do not, the interval is wider than need
    be."""
    if worlds == 0:
        return None, None
    spread = Z**2 / worlds
    middle = (share + spread / 2) / (1 + spread)
    half = Z / (1 + spread) * sqrt(share * (1 - share) / worlds + spread / (4 * worlds))
    return 0.0 if share == 0 else middle - half, 1.0 if share == 1 else middle + half


def median_interval(ordered: Any, worlds: int) -> Interval:
    """Order statistics that hold the median whatever the distribution: ranks n/2 -+ z n / (2 sqrt(worlds)), rounded
    outwards. Of fewer than six worlds even the least and the largest hold it in less than 95 % of all cases: none."""
    n = len(ordered)
    if worlds < LEAST_WORLDS:
        return None, None
    half = Z * n / (2 * sqrt(worlds))
    low, high = floor(n / 2 - half), ceil(n / 2 + half)
    return float(ordered[max(low - 1, 0)]), float(ordered[min(high, n - 1)])


def percentile(ordered: Any, q: float) -> float | None:
    """The larger neighbour, for there is no mean of a number and never; None of nothing, and for never."""
    value = float(np.percentile(ordered, q, method="higher")) if len(ordered) else float("inf")
    return value if isfinite(value) else None
