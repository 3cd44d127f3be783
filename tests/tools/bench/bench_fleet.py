"""Table of the fleet: evenness, separation and radius of whole fleets on the emulated plane and
copter.

    python -m tests.tools.bench.bench_fleet --seeds 1 3 --rows plane-6 plane-6-wind
    python -m tests.tools.bench.bench_fleet --seeds 1 5 --study --keep study.jsonl --minutes 5

The members have the product's noisy sensors and estimate the drift. Standard deviations: 2 deg of
the compass biases (5 deg in the rows "plane-6-wind-5" and "ranges"), and 2 % of the planes'
airspeeds. In the rows with wind 30 % of the reports are lost. The study changes one condition of
six planes at a time. A flight takes about 9 s of processor time for each member and 200 s.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from circnav_mav.extras.fleet.evenness import even_from
from circnav_mav.extras.fleet.flight import Tracks
from circnav_mav.extras.fleet.metrics import figures, gap_errors
from circnav_mav.extras.fleet.report import State
from tests.extras.fleet.bare import bare_fleet
from tests.flight.lockstep import CONFIG
from tests.tools import cells
from tests.tools.cells import Result

PLANE = (
    "vehicle.speed_mps=15",
    "sim.vehicle.cruise_speed_mps=15.0",
    "sim.start.speed_mps=15.0",
    "orbit.radius_m=100",
    "sim.start.north_m=160",
    "sim.start.east_m=-80",
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
EVENTS = {
    ("leave", LEAVER): ["limits.duration_s=140"],
    ("join", JOINER): [
        f'sim.events=[{{at_s=0.0, action="mute_ranging"}}, '
        f'{{at_s={JOINS_AT}, action="unmute_ranging"}}]',
        "link.wait_s=200",
        "limits.duration_s=130",
    ],
}
"""Overrides of one member, by event and member."""
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
    f"wind-{wind}": replace(SIX, overrides=(*PLANE, f"sim.wind.speed_mps={wind}"))
    for wind in (0, 2.5, 7.5)
} | {
    f"{name}-{value}": replace(SIX, **{name: value})
    for name, values in (
        ("loss", (0.3, 0.6, 0.9)),
        ("delay", (0.1, 0.2, 0.4)),
        ("compass", (0, 1, 4)),
        ("airspeed", (0, 0.01, 0.04)),
        ("size", (2, 3, 10)),
    )
    for value in values
}
"""Rows that change one condition of six planes in calm air. Reports that are more than 0.5 s late
are rejected."""


FIGURES = ("even_after_s", "even_again_s", "worst_gap_deg", "radius_rms_m", "smallest_horizontal_m")


def fly(name: str, seed: int) -> Result:
    """Fly one fleet and return its figures."""
    row = (ROWS | STUDY)[name]
    rng = np.random.default_rng(seed)
    compass = row.compass * rng.normal(size=row.size)
    speeds = 1 + row.airspeed * rng.normal(size=row.size)

    def each(member: int) -> list[str]:
        found = [f"sim.sensors.heading_bias_deg={compass[member - 1]:.3f}"]
        if row.mission == "arduplane":
            ratio = TRUE_OVER_INDICATED * speeds[member - 1]
            found.append(f"sim.vehicle.airspeed_scale={ratio:.4f}")
        return found + EVENTS.get((row.event, member), [])

    flight = bare_fleet(
        CONFIG / f"{row.mission}.toml",
        row.size,
        (*row.overrides, f"limits.duration_s={row.duration}", f"sim.seed={seed}"),
        each,
        loss=row.loss,
        delay=row.delay,
        seed=seed,
    ).fly()
    found = figures(flight.tracks).plain()
    outcomes = [member.pilot.mission.outcome for member in flight.members]
    found["completed"] = sum(one is not None and "end" in one.reason for one in outcomes)
    floor = np.abs(np.diff(np.append(compass, compass[:1]))).max()
    found["compass_floor_deg"] = round(float(floor), 2)
    found["trims"] = [round(member.fleet.spacing.trim, 4) for member in flight.members]
    if row.event == "join" and found["even_after_s"] is not None:
        again = found["all_on_circle_s"] + found["even_after_s"] - JOINS_AT
        found["even_again_s"] = round(again, 1)
    if row.event == "leave":
        found["even_again_s"] = even_again(flight.tracks)
    return found


def even_again(tracks: Tracks) -> float | None:
    """Return the time from the start of leaving until the fleet is even again, s."""
    times = tracks.time
    leaving = [k for k, states in enumerate(tracks.state) if states[LEAVER - 1] is State.LEAVING]
    if not leaving:
        return None
    even = even_from(times, gap_errors(tracks), times[leaving[0] + 1])
    return None if even is None else round(even - times[leaving[0]], 1)


def cell(flights: Sequence[Result], figure: str) -> str:
    """Return median and largest of a figure, and the number of flights that have the figure."""
    known = [one[figure] for one in flights if one.get(figure) is not None]
    if not known:
        return "-"
    missing = "" if len(known) == len(flights) else f" {len(known)}/{len(flights)}"
    return f"{median(known):.1f} ({max(known):.1f}){missing}"


def main() -> None:
    parser = cells.parser(__doc__, ROWS | STUDY, (1, 3))
    parser.add_argument("--study", action="store_const", const=[*STUDY], dest="rows")
    parser.set_defaults(rows=[*ROWS])
    rows = [
        (name, len(flights), *(cell(flights, one) for one in FIGURES),
         sum(one["too_near"] for one in flights))
        for name, flights in cells.flown(fly, parser.parse_args()).items() if flights
    ]  # fmt: skip
    head = "row | flights | even, s | again, s | worst gap, deg | radius rms, m | beside, m"
    print(cells.table(f"{head} | too near", rows))
    print("\nMedian (largest); n/m: in so many of the flights.")


if __name__ == "__main__":
    main()
