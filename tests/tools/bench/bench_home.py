"""Flights home of a plane without GPS to its beacon, 2 km away: share that arrives, and duration.

    python -m tests.tools.bench.bench_home --seeds 1 100 [--out FILE] [--wind 0.33]
        [--set KEY=VALUE]

`config/home.toml` in lockstep. The seed determines the wind's direction, the bearing of the start,
the heading and the direction of the circle. One line per flight, judged by the true track. Seeds
that FILE already has are not flown again. At the end it prints the share that came home, and
quantiles.

    straight   time of the straight path to within 150 m, in this wind with a crab angle, s
    home       time from the engagement to within 150 m, s
    ratio      home over straight
    farthest   largest distance from the beacon in the two laps after that, m
    nearest    smallest distance from the beacon in these laps, m
    rms        radius error over the second lap, m
    away       largest distance from the beacon less the distance at the engagement, m
"""

import argparse
from dataclasses import astuple, dataclass, fields
from math import cos, inf, isfinite, pi, radians, sin
from pathlib import Path
from random import Random

import numpy as np

from tests.flight.lockstep import Flight, clockwise_turns, flight, true_radius
from tests.tools.straight_way import straight_way

HOME = 150.0
"""Distance from the beacon at which the plane has arrived, m."""
LAPS = 2.0
SPEED = 15.0
"""Speed V of the mission, m/s."""


@dataclass(frozen=True)
class Homing:
    """One line of the output. Angles are in degrees from north: direction from which the wind
    blows, bearing of the start from the beacon, and heading of the plane."""

    seed: int
    wind_from: float
    bearing: float
    heading: float
    straight: float
    home: float
    ratio: float
    farthest: float
    nearest: float
    rms: float
    away: float

    @property
    def came(self) -> bool:
        """True if the plane arrived at the beacon and stayed there."""
        return isfinite(self.home) and self.farthest <= HOME

    @property
    def row(self) -> str:
        return " ".join(
            f"{value:g}" if isinstance(value, int) else f"{value:.2f}" for value in astuple(self)
        )


NAMES = [one.name for one in fields(Homing)]


def prepared(
    seed: int, *overrides: str, wind: float = 0.33, away: float = 2000.0
) -> tuple[Flight, list[float]]:
    """Return a flight that has not started, and its angles for the output. wind: wind speed in
    units of V. away: distance of the start from the beacon, m."""
    chance = Random(seed)
    wind_from, bearing, heading = (chance.uniform(0.0, 360.0) for _ in range(3))
    direction = chance.choice(("clockwise", "counterclockwise"))
    north, east = away * cos(radians(bearing)), away * sin(radians(bearing))
    flown = flight(
        "home",
        f"sim.seed={seed}",
        f"sim.wind.speed_mps={wind * SPEED}",
        f"sim.wind.from_deg={wind_from}",
        "sim.truth.rate_hz=0",
        f"sim.start.north_m={north}",
        f"sim.start.east_m={east}",
        f"sim.start.heading_deg={heading}",
        f'orbit.direction="{direction}"',
        *overrides,
        law="auto",
    )
    return flown, [wind_from, bearing, heading]


def fly(seed: int, *overrides: str, **changes: float) -> Homing:
    """Fly until the laps are flown or the mission has ended."""
    flown, angles = prepared(seed, *overrides, **changes)
    orbit = flown.pilot.settings.orbit
    lap = 2 * pi * orbit.radius / orbit.speed
    arrived: list[float] = []

    def watch(now: Flight) -> None:
        if not arrived and now.truths and true_radius(now.truths[-1]) < HOME:
            arrived.append(now.now)

    flown.fly(5.0, watch)
    while not flown.pilot.done and not (arrived and flown.now > arrived[0] + LAPS * lap):
        flown.fly(flown.now + 1.0, watch)
    engaged = flown.pilot.mission.engaged_at
    assert engaged is not None
    under_way = [truth for truth in flown.truths if truth.time >= engaged]
    start = under_way[0]
    radii = np.array([true_radius(truth) for truth in under_way])
    wind = start.wind_north, start.wind_east
    straight = straight_way((-start.north, -start.east), wind, start.airspeed, HOME)
    home = arrived[0] - engaged if arrived else inf
    late = [truth for truth in under_way if arrived and truth.time > arrived[0]]
    last = np.array([true_radius(one) for one in late if one.time > flown.now - lap]) - orbit.radius
    away = radii.max() - radii[0]
    if late and -orbit.direction.turn_sign * clockwise_turns(late) < 0.7 * LAPS:
        home = inf  # not on the circle, or in the wrong direction
    ranges = [true_radius(truth) for truth in late] or [inf]
    rms = float(np.sqrt(np.mean(last**2))) if len(last) else inf
    return Homing(
        seed, *angles, straight, home, home / straight, max(ranges), min(ranges), rms, float(away)
    )


def summary(lines: list[Homing]) -> str:
    """Return the share that came home, and quantiles over all flights."""
    text = [
        f"{sum(one.came for one in lines)} of {len(lines)} home: on the circle, and within {HOME:g}"
        " m from then on"
    ]
    for name in ("ratio", "farthest", "nearest", "rms", "away"):
        values = np.array([getattr(one, name) for one in lines])
        share = np.quantile(values, [0.0, 0.5, 0.95, 0.99, 1.0], method="nearest")
        text.append(
            f"{name:<9}"
            + " ".join(f"{value:9.2f}" for value in share)
            + "   least, median, 95 %, 99 %, most"
        )
    return "\n".join(text)


def read(path: Path | None) -> dict[int, Homing]:
    """Return the lines of earlier flights."""
    rows = path.read_text().splitlines() if path is not None and path.is_file() else []
    table = [row.split() for row in rows if row[:1].isdigit()]
    return {int(seed): Homing(int(seed), *map(float, rest)) for seed, *rest in table}


def main() -> None:
    """Print a line per flight, then the summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 20), metavar=("FIRST", "LAST"))
    parser.add_argument("--out", type=Path, help="file of the lines, to be continued")
    parser.add_argument(
        "--wind", type=float, default=0.33, help="wind speed, as a share of the airspeed"
    )
    parser.add_argument("--away", type=float, default=2000.0, help="distance at the start, m")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="mission key to set"
    )
    options = parser.parse_args()
    lines = read(options.out)
    print(" ".join(NAMES))
    for seed in range(options.seeds[0], options.seeds[1] + 1):
        if seed in lines:
            continue
        lines[seed] = fly(seed, *options.set, wind=options.wind, away=options.away)
        print(lines[seed].row, flush=True)
        if options.out is not None:
            with options.out.open("a") as file:
                file.write(lines[seed].row + "\n")
    print(summary(list(lines.values())))


if __name__ == "__main__":
    main()
