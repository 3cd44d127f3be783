"""Contents of summary.json of a run. The keys are stable, because users' scripts read them."""

from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runlog import metrics
from circnav_mav.runlog.metrics import NAMES, late_figures
from circnav_mav.runlog.ticks import Ticks, Truth

NOT_OURS = [
    phase.value
    for phase in (Phase.WAIT_LINK, Phase.WAIT_RANGING, Phase.READY, Phase.YIELDED, Phase.ENDED)
]
"""Phases in which circnav does not control the vehicle."""
FIGURES = ("settled_s", "radius_mean_m", "radius_rms_error_m")
UNRECORDED = 1.0
"""The summary reports an unrecorded end of a flight that is longer than this, s."""


@dataclass(frozen=True, slots=True)
class FlightFacts:
    """Facts known at the end of a flight. The summary has them under the same names, except orbit
    and the last three.

    engaged_s: run time of the engagement, s; None: take it from the recorded ticks.
    until_s: run time of the last tick, recorded or not, s; None: take it from the recorded ticks.
    clock_speed: speed of the autopilot's clock if it differed from real time.
    orbit: first circle.
    """

    mission: str
    outcome: str
    reason: str
    orbit: Orbit
    samples_accepted: int
    samples_rejected: dict[str, int]
    setpoints_sent: int
    firmware: str | None
    version: str
    epoch_us: int
    recording_problem: str | None
    frames_refused: dict[str, int] = field(default_factory=dict)
    output_mode: str = "fly"
    clock_speed: float | None = None
    engaged_s: float | None = None
    until_s: float | None = None


def summarise(facts: FlightFacts, ticks: Ticks, truth: Truth | None) -> dict[str, Any]:
    """Return the summary as plain values.

    The figures of the circle cover the last circle that was begun. They are null if the flight
    never engaged. They use only recorded ticks that steered by a fresh range, because predictions
    in an outage are not measurements. If parts were not recorded, `recording_problem` reports it.
    """
    engaged = ticks.engaged_at if facts.engaged_s is None else facts.engaged_s
    # A flight that never engaged starts after all ticks.
    start = inf if engaged is None else engaged
    end = ticks.end if facts.until_s is None else facts.until_s
    flown = ticks.time >= start
    phases = np.array(ticks.words["phase"], str)
    steered = phases == Phase.ENGAGED.value
    known = flown & steered & ~np.isnan(ticks.numbers["r"])
    circles = _circles(ticks, known, facts.orbit, engaged or 0.0)
    newest = circles[-1]
    orbit = replace(
        facts.orbit,
        radius=newest["desired_radius_m"],
        direction=Direction(newest["direction"]),
    )
    begun = newest["begun_s"]
    known &= ticks.time >= begun
    # Ticks in which circnav did not steer, because the operator flew or there was no link.
    # Unrecorded time is assumed to be steered.
    without = (flown & np.isin(phases, NOT_OURS))[:-1]
    # Smoothness of the turn command, over the ticks over which the radius is judged.
    turn = late_figures(
        ticks.time[known],
        ticks.numbers["turn_rate"][known],
        ticks.numbers["saturated"][known],
        orbit,
    )
    height = ticks.numbers["height"][flown & steered]
    heights = height[~np.isnan(height)].tolist()
    # Sense of the commanded turn, summed over the last third of the newest circle. Turns on the way
    # to the circle are left out.
    lately = flown & steered & (ticks.time >= begun)
    turned = np.nansum(metrics.last_part(ticks.time[lately], ticks.numbers["turn_rate"][lately]))
    senses = {direction.turn_sign: direction.value for direction in Direction}
    summary = asdict(facts)
    for used in ("orbit", "engaged_s", "until_s"):
        del summary[used]
    return summary | {
        "desired_radius_m": orbit.radius,
        "direction": orbit.direction.value,
        "direction_commanded": senses.get(int(np.sign(turned))),
        "engaged_s": engaged,
        "flown_s": max(end - start, 0.0),
        "steered_s": max(end - start - float(np.diff(ticks.time)[without].sum()), 0.0),
        **{name: circles[-1][name] for name in (*FIGURES, "radius_sigma_m")},
        "circles": circles,
        "height_min_m": min(heights, default=None),
        "height_max_m": max(heights, default=None),
        **(asdict(turn) if turn else dict.fromkeys(NAMES)),
        **_vehicle(ticks, flown & steered),
        "truth": None if truth is None else _truth(truth, max(start, begun), end, orbit),
        "recording_problem": _problem(facts.recording_problem, ticks, truth, end),
    }


def _problem(problem: str | None, ticks: Ticks, truth: Truth | None, end: float) -> str | None:
    """Return the recorder's problem, and the end time of the figures if they do not cover the whole
    flight, or None."""
    # Truth that ends early without a recording problem was not received: that is no gap in the
    # record.
    ends = {"estimates": ticks.end}
    if truth is not None and problem is not None:
        ends["truth"] = float(truth.time[-1])
    short = ", ".join(
        f"{what} up to {until:.0f} s" for what, until in ends.items() if end - until > UNRECORDED
    )
    return (
        "; ".join(filter(None, [problem, short and f"figures cover {short} of {end:.0f} s"]))
        or None
    )


def _circles(
    ticks: Ticks, known: NDArray[np.bool_], first: Orbit, start: float
) -> list[dict[str, Any]]:
    """Return the figures of each circle that was begun, in order. Each circle ends where the next
    one begins."""
    desired = ticks.desired(first.radius)
    directions = np.array([word or first.direction.value for word in ticks.words["direction"]])
    at = np.flatnonzero(known)
    circles: list[dict[str, Any]] = []
    changed = (np.diff(desired[at]) != 0) | (directions[at][1:] != directions[at][:-1])
    for part in np.split(at, np.flatnonzero(changed) + 1):
        radius = float(desired[part[0]]) if len(part) else first.radius
        direction = str(directions[part[0]]) if len(part) else first.direction.value
        begun = float(ticks.time[part[0]]) if circles else start
        figures = _circle(ticks.time[part], ticks.numbers["r"][part], radius)
        sigma = metrics.last_part(ticks.time[part], ticks.numbers["r_sigma"][part])
        figures["radius_sigma_m"] = metrics.rms_error(sigma[~np.isnan(sigma)], 0.0)
        begins = {"desired_radius_m": radius, "direction": direction, "begun_s": begun}
        circles.append(begins | figures)
    return circles


def _circle(
    time: metrics.Column, radius: metrics.Column, desired: float
) -> dict[str, float | None]:
    last = metrics.last_part(time, radius)
    settled = metrics.settled(time, radius, desired)
    return dict(
        zip(FIGURES, (settled, metrics.mean(last), metrics.rms_error(last, desired)), strict=True)
    )


def _vehicle(ticks: Ticks, steered: NDArray[np.bool_]) -> dict[str, float | int | None]:
    """Return turn gain and turn delay at the end, the remaining fraction of the law's gain after
    oscillations reduced it, and the number of law changes."""
    figures: dict[str, float | int | None] = {}
    for name, column in (
        ("turn_gain", "turn_gain"),
        ("turn_delay_s", "turn_delay"),
        ("gain_share", "gain_share"),
    ):
        values = ticks.numbers[column][steered]
        known = values[~np.isnan(values)]
        figures[name] = float(known[-1]) if len(known) else None
    laws = [law for law, ours in zip(ticks.words["law"], steered, strict=True) if ours and law]
    return figures | {"law_changes": sum(before != after for before, after in pairwise(laws))}


def _truth(truth: Truth, start: float, end: float, orbit: Orbit) -> dict[str, Any] | None:
    flown = (truth.time >= start) & (truth.time <= end)
    if not flown.any():
        return None
    time = truth.time[flown]
    radius = truth.radius[flown]
    ways = truth.north - truth.target_north, truth.east - truth.target_east
    # sense of rotation on the circle only, not on the way to it
    direction = metrics.direction_of(
        metrics.swept_angle(*(metrics.last_part(time, way[flown]) for way in ways))
    )
    return {
        **_circle(time, radius, orbit.radius),
        "direction": direction.value if direction else None,
        "closest_approach_m": float(radius.min()),
    }
