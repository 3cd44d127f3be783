"""Table of the fleet: evenness, separation and radius of whole fleets on the emulated plane and
copter.

    python -m tests.tools.bench.bench_fleet --flights 3 --rows plane-6 plane-6-wind
    python -m tests.tools.bench.bench_fleet --flights 5 --study --keep study.jsonl --minutes 5

The members have the product's noisy sensors and estimate the drift. Standard deviations: 2 deg of
the compass biases (5 deg in the rows "plane-6-wind-5" and "ranges"), and 2 % of the planes'
airspeeds. In the rows with wind 30 % of the reports are lost. The study changes one condition of
six planes at a time. A flight takes about 9 s of processor time for each member and 200 s. `--keep
FILE` adds every flight to a file of JSON lines and skips the flights already in it.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from circnav_mav.extras.fleet.evenness import even_from
from circnav_mav.extras.fleet.metrics import figures, gap_errors
from circnav_mav.extras.fleet.report import State
from tests.extras.fleet.bare import bare_fleet

CONFIG = Path(__file__).parents[3] / "config"
PLANE = (
    *(
        "vehicle.speed_mps=15",
        "sim.vehicle.cruise_speed_mps=15.0",
        "sim.start.speed_mps=15.0",
        "orbit.radius_m=100",
    ),
    *("sim.start.north_m=160", "sim.start.east_m=-80"),
)
COPTER = ("sim.start.north_m=50", "sim.start.east_m=-20")
WIND = ("sim.wind.speed_mps=5",)
RANGES = (
    "fleet.ranging=100",
    'ranging.message="ranging_beacon"',
    "ranging.beacon_id=1",
    'sim.ranging.message="ranging_beacon"',
    'sim.ranging.via="direct"',
    'ranging.endpoint="sim"',
)
LEAVER = 3
JOINER = 6
JOINS_AT = 110.0
"""Time at which the joiner receives its first range, s."""
TRUE_OVER_INDICATED = 1.065
"""True over indicated airspeed of the emulated ArduPlane."""


@dataclass(frozen=True)
class Row:
    """Conditions of one row. loss: share of lost reports. delay: delay of the reports, s. compass:
    standard deviation of the compass biases, deg. airspeed: standard deviation of the airspeeds,
    share. event: one member leaves ("leave") or joins ("join"). duration: s."""

    mission: str
    size: int
    overrides: tuple[str, ...]
    loss: float = 0.0
    delay: float = 0.0
    compass: float = 2.0
    airspeed: float = 0.02
    event: str = ""
    duration: float = 160.0


SIX = Row("arduplane", 6, PLANE)
WINDY = replace(SIX, overrides=(*PLANE, *WIND), loss=0.3)
ROWS = {
    "plane-6-wind-5": replace(WINDY, compass=5.0),
    "plane-6-ranges": replace(SIX, overrides=(*PLANE, *RANGES), compass=5.0),
    "plane-6-wind": WINDY,
    "plane-6-join": replace(WINDY, event="join", duration=230.0),
    "plane-6-leave": replace(WINDY, event="leave", duration=220.0),
    "plane-6": SIX,
    "copter-4-ranges": Row("arducopter", 4, (*COPTER, *RANGES), compass=5.0),
    "copter-4": Row("arducopter", 4, COPTER),
    "plane-3": Row("arduplane", 3, PLANE),
    "plane-6-late": replace(WINDY, loss=0.7, delay=0.4),
    "plane-10": replace(SIX, size=10),
}
STUDY = {
    **{
        f"wind-{wind}": replace(SIX, overrides=(*PLANE, f"sim.wind.speed_mps={wind}"))
        for wind in (0, 2.5, 7.5)
    },
    **{f"loss-{loss}": replace(SIX, loss=loss) for loss in (0.3, 0.6, 0.9)},
    **{f"delay-{delay}": replace(SIX, delay=delay) for delay in (0.1, 0.2, 0.4)},
    **{f"compass-{compass}": replace(SIX, compass=compass) for compass in (0, 1, 4)},
    **{f"airspeed-{airspeed}": replace(SIX, airspeed=airspeed) for airspeed in (0, 0.01, 0.04)},
    **{f"size-{size}": replace(SIX, size=size) for size in (2, 3, 10)},
}
"""Rows that change one condition of six planes in calm air. Reports that are more than 0.5 s late
are rejected."""


def fly(row: Row, seed: int) -> dict[str, Any]:
    """Fly one fleet and return its figures."""
    rng = np.random.default_rng(seed)
    compass = row.compass * rng.normal(size=row.size)
    speeds = 1 + row.airspeed * rng.normal(size=row.size)

    def each(member: int) -> list[str]:
        found = [f"sim.sensors.heading_bias_deg={compass[member - 1]:.3f}"]
        if row.mission == "arduplane":
            ratio = TRUE_OVER_INDICATED * speeds[member - 1]
            found.append(f"sim.vehicle.airspeed_scale={ratio:.4f}")
        if row.event == "leave" and member == LEAVER:
            found.append("limits.duration_s=140")
        if row.event == "join" and member == JOINER:  # the joiner waits for its first range
            muted = (
                f'{{at_s=0.0, action="mute_ranging"}}, {{at_s={JOINS_AT}, action="unmute_ranging"}}'
            )
            found += [
                f"sim.events=[{muted}]",
                "link.wait_s=200",
                f"limits.duration_s={row.duration - 100}",
            ]
        return found

    overrides = (*row.overrides, f"limits.duration_s={row.duration}", f"sim.seed={seed}")
    path = CONFIG / f"{row.mission}.toml"
    flight = bare_fleet(
        path, row.size, overrides, each, loss=row.loss, delay=row.delay, seed=seed
    ).fly()
    found = figures(flight.tracks).plain()
    found["completed"] = sum(
        m.pilot.mission.outcome is not None and "end" in m.pilot.mission.outcome.reason
        for m in flight.members
    )
    found["compass_floor_deg"] = round(
        float(np.max(np.abs(np.diff(np.append(compass, compass[:1]))))), 2
    )
    found["trims"] = [round(member.fleet.spacing.trim, 4) for member in flight.members]
    if row.event == "join" and found["even_after_s"] is not None:
        found["even_again_s"] = round(
            found["all_on_circle_s"] + found["even_after_s"] - JOINS_AT, 1
        )
    if row.event == "leave":
        states = [row_[LEAVER - 1] for row_ in flight.tracks.state]
        first = next((k for k, s in enumerate(states) if s is State.LEAVING), None)
        times = flight.tracks.time
        even = (
            None if first is None else even_from(times, gap_errors(flight.tracks), times[first + 1])
        )
        found["even_again_s"] = (
            None if even is None or first is None else round(even - times[first], 1)
        )
    return found


def fly_before(until: float, name: str, seed: int) -> dict[str, Any] | None:
    """Fly one fleet of a row, unless the end time (monotonic clock, s) has passed."""
    if time.monotonic() > until:
        return None
    return {"row": name, "seed": seed, **fly((ROWS | STUDY)[name], seed)}


def table(flights: Sequence[dict[str, Any]]) -> str:
    """Return the table of the flights."""

    def value(rows: list[dict[str, Any]], key: str) -> str:
        known = [one[key] for one in rows if one.get(key) is not None]
        if not known:
            return "-"
        return f"{median(known):.1f} ({max(known):.1f})" + (
            "" if len(known) == len(rows) else f" {len(known)}/{len(rows)}"
        )

    keys = (
        "even_after_s",
        "even_again_s",
        "worst_gap_deg",
        "radius_rms_m",
        "smallest_horizontal_m",
    )
    lines = [
        "| row | flights | even, s | again, s | worst gap, deg | radius rms, m |"
        " beside, m | too near |"
    ]
    lines.append("|---|---|---|---|---|---|---|---|")
    for name in (*ROWS, *STUDY):
        rows = [one for one in flights if one["row"] == name]
        if rows:
            near = sum(one["too_near"] for one in rows)
            cells = " | ".join(value(rows, key) for key in keys)
            lines.append(f"| {name} | {len(rows)} | {cells} | {near} |")
    return "\n".join([*lines, "", "Median (largest); n/m: in so many of the flights."])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--flights", type=int, default=3, help="flights of each row")
    parser.add_argument("--first", type=int, default=1, help="seed of the first flight")
    parser.add_argument("--rows", nargs="*", choices=[*ROWS, *STUDY], help="[all of the table]")
    parser.add_argument("--study", action="store_true", help="fly the rows of the study instead")
    parser.add_argument(
        "--keep",
        type=Path,
        help="JSON lines file for the flights; flights already in it are not flown again",
    )
    parser.add_argument("--workers", type=int, help="processes [one a core]")
    parser.add_argument(
        "--minutes", type=float, default=inf, help="start no flight after this time"
    )
    given = parser.parse_args()
    until = time.monotonic() + 60 * given.minutes
    kept = given.keep.read_text().splitlines() if given.keep and given.keep.exists() else []
    flights = [json.loads(line) for line in kept]
    names = given.rows or (STUDY if given.study else ROWS)
    with ProcessPoolExecutor(given.workers) as pool:
        # Fly seed by seed, so that an interrupted table has all rows.
        jobs = [
            pool.submit(fly_before, until, name, seed)
            for seed in range(given.first, given.first + given.flights)
            for name in names
            if not any((one["row"], one["seed"]) == (name, seed) for one in flights)
        ]
        for job in as_completed(jobs):
            if (flown := job.result()) is None:
                continue
            flights.append(flown)
            print(json.dumps(flown), file=sys.stderr, flush=True)
            if given.keep:
                with given.keep.open("a") as file:
                    file.write(json.dumps(flown) + "\n")
    print(table(flights))


if __name__ == "__main__":
    main()
