"""Comparison of emulator and firmware.

    python -m tests.tools.firmware.emulated --seeds 1 5

Flies the rows of docs/measured.md on the bundled vehicle in lockstep. Prints median RMS radius
error and standard deviation of the turn command over the last two laps, and their ratio to the
flights of flights.jsonl, which tests.tools.firmware.table writes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import degrees, pi
from statistics import median

import numpy as np

from tests.flight.lockstep import clockwise_turns, flight, rms_error, true_radius
from tests.tools import cells
from tests.tools.cells import Result
from tests.tools.firmware.flight import VEHICLES
from tests.tools.firmware.table import FLIGHTS

APPROACH = 90.0
"""Time before the evaluated laps, s."""
WIND = "sim.wind.speed_mps={}".format
GUST = "sim.wind.gust_rms_mps={}".format
"""Gusts of the emulator that replace ArduPilot's turbulence, which is nearly white. For a plane,
gusts of 3 s with 0.7 times its strength give the same radius error and turn command. For a copter,
gusts with 0.4 times its strength give the same spread of ground speed."""
TARGET = "sim.target.velocity_north_mps={}".format
GPS_OFF = 'sim.events=[{at_s=60.0, action="gps_off"}]'
UWB = (
    'sim.ranging.preset="uwb"',
    "sim.ranging.rate_hz=20",
    "ranging.rate_hz=20",
    "ranging.sigma_m=0.15",
)
LORA = 'sim.ranging.preset="lora"', "ranging.sigma_m=2.24"
ROWS: dict[str, tuple[str, ...]] = {
    "Plane R 150 V 22, calm": ("arduplane",),
    "Plane, wind 5 + turbulence 1": ("arduplane", WIND(5), GUST(0.7)),
    "Plane, wind 8": ("arduplane", WIND(8)),
    "Plane, wind 6 + turbulence 3": ("arduplane", WIND(6), GUST(2.1)),
    "Plane, target at 4 m/s": ("arduplane", TARGET(4)),
    "Plane, GPS off after 60 s, wind 5 + turbulence 1": ("arduplane", WIND(5), GUST(0.7), GPS_OFF),
    "Plane, 10 % outliers of 30 m + 30 % loss, wind 5": (
        "arduplane",
        WIND(5),
        "sim.ranging.outlier_fraction=0.1",
        "sim.ranging.dropout_fraction=0.3",
    ),
    "Plane, ranges 0.3 s late, wind 5": ("arduplane", WIND(5), "sim.ranging.latency_s=0.3"),
    "Plane, LoRa-like ranges, wind 5": ("arduplane", WIND(5), *LORA),
    "Plane, airspeed 15 % above the mission's": ("arduplane", "sim.vehicle.cruise_speed_mps=25.3"),
    "Plane, ROLL_LIMIT_DEG 35, wind 5": ("arduplane", WIND(5), "sim.vehicle.max_bank_deg=34.4"),
    "Copter R 30 V 5, calm": ("arducopter",),
    "Copter, wind 5 + turbulence 1": ("arducopter", WIND(5), GUST(0.4)),
    "Copter, target at 1 m/s": ("arducopter", TARGET(1)),
    "Copter, UWB ranges, wind 5": ("arducopter", WIND(5), *UWB),
    "Rover R 20 V 3": ("ardurover",),
    "PX4 copter R 50 V 5, calm": ("px4_copter",),
    "PX4 copter, wind 3": ("px4_copter", WIND(3)),
    "PX4 copter, target at 1.1 m/s": ("px4_copter", TARGET(1.1)),
    "PX4 plane R 60 V 10 by stick, calm": ("px4_plane",),
    "PX4 plane by stick, wind 2": ("px4_plane", WIND(2)),
}
CIRCLES = {one.mission: (one.radius, one.speed) for one in VEHICLES.values()}


@dataclass(frozen=True)
class Flown:
    """Figures of an emulated flight. rms, worst: RMS and largest radius error, m. turn_sd: standard
    deviation of the turn command, deg/s. at_limit: share of saturated commands. right: True if the
    direction of rotation was correct."""

    rms: float
    worst: float
    turn_sd: float
    at_limit: float
    right: bool


def fly(
    row: str,
    seed: int,
    direction: str = "clockwise",
    count: int = 2,
    rows: Mapping[str, tuple[str, ...]] = ROWS,
    approach: float = APPROACH,
) -> Flown:
    """Fly the emulated vehicle once and evaluate the last `count` laps. approach: time before these
    laps, s."""
    mission, *changes = rows[row]
    radius, speed = CIRCLES[mission]
    laps = count * 2 * pi * radius / speed
    changes.append(f'orbit.direction="{direction}"')
    circle = (
        f"orbit.radius_m={radius}",
        f"vehicle.speed_mps={speed}",
        f"limits.duration_s={approach + laps + 5}",
    )
    flown = flight(mission, *circle, *changes, f"sim.seed={seed}", law="auto").fly(approach + laps)
    truths = [truth for truth in flown.truths if truth.time > flown.now - laps]
    turns = [
        tick.turn_rate
        for tick in flown.ticks
        if tick.time > flown.now - laps and tick.turn_rate is not None
    ]
    turned = clockwise_turns(truths) if direction == "clockwise" else -clockwise_turns(truths)
    limit = flown.pilot.settings.orbit.max_turn_rate
    return Flown(
        rms_error(truths, radius),
        max(abs(true_radius(truth) - radius) for truth in truths),
        degrees(float(np.std(turns))),
        float(np.mean(np.abs(turns) > 0.99 * limit)),
        turned > count / 2,
    )


def cell(row: str, seed: int) -> Result:
    return asdict(fly(row, seed))


def compared(row: str, real: Sequence[Result], emulated: Sequence[Result]) -> tuple[str, ...]:
    """Return the line of the table for a row."""
    rms, sd, here, here_sd = (
        median(one[figure] for one in flights)
        for flights in (real, emulated)
        for figure in ("rms", "turn_sd")
    )
    wrong = "" if all(one["right"] for one in emulated) else ", wrong way round"
    ratios = f"{here / rms:.1f}, {here_sd / sd:.1f}{wrong}"
    return row, f"{rms:.2f}, {here:.2f}", f"{sd:.1f}, {here_sd:.1f}", ratios


def main() -> None:
    flown = cells.flown(cell, cells.parser(__doc__, ROWS, (1, 3)).parse_args())
    stored = cells.read(FLIGHTS).values()
    real = {
        row: [one for one in stored if one["row"] == row and "failed" not in one] for row in flown
    }
    head = "flight | RMS m: firmware, emulator | turn sd deg/s: firmware, emulator | ratio"
    rows = [compared(row, real[row], flown[row]) for row in flown if real[row]]
    print(cells.table(head, rows))


if __name__ == "__main__":
    main()
