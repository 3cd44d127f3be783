"""A track as one row of the table: the same figures for every engine, from the true path alone."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from circnav_mav.experiments.campaign.lockstep import COMPLETED, Track
from circnav_mav.experiments.campaign.plan import Campaign, Run
from circnav_mav.runlog import metrics
from circnav_mav.runlog.turn_command import NAMES, late_figures

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
        "start_range_m": math.hypot(east, north),
        "start_bearing_deg": math.degrees(math.atan2(east, north)) % 360,
        "start_heading_deg": math.degrees(heading) % 360,
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
