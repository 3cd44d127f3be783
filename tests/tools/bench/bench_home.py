"""Flights home of a plane without GPS to its beacon, 2 km away: share that arrives, and duration.

    python -m tests.tools.bench.bench_home --seeds 1 100 [--keep FILE] [--wind 0.33]
        [--set KEY=VALUE]

`config/home.toml` in lockstep. The seed determines the wind's direction, the bearing of the start,
the heading and the direction of the circle. The flights are judged by the true track. Prints the
share that came home, and quantiles.

    straight   time of the straight path to within 150 m, in this wind with a crab angle, s
    home       time from the engagement to within 150 m, s
    ratio      home over straight
    farthest   largest distance from the beacon in the two laps after that, m
    nearest    smallest distance from the beacon in these laps, m
    rms        radius error over the second lap, m
    away       largest distance from the beacon less the distance at the engagement, m
"""

from collections.abc import Iterable
from functools import partial
from math import cos, inf, isfinite, pi, radians, sin
from random import Random

import numpy as np

from tests.flight.lockstep import Flight, clockwise_turns, flight, true_radius
from tests.tools import cells
from tests.tools.cells import Result
from tests.tools.straight_way import straight_way

HOME = 150.0
"""Distance from the beacon at which the plane has arrived, m."""
LAPS = 2.0
SPEED = 15.0
"""Speed V of the mission, m/s."""
QUANTILES = (0.0, 0.5, 0.95, 0.99, 1.0)


def prepared(
    seed: int, overrides: Iterable[str] = (), *, wind: float = 0.33, away: float = 2000.0
) -> tuple[Flight, Result]:
    """Return a flight that has not started, and its angles: direction from which the wind blows,
    bearing of the start from the beacon, heading, all in degrees. wind: wind speed in units of V.
    away: distance of the start from the beacon, m."""
    chance = Random(seed)
    angles = {name: chance.uniform(0.0, 360.0) for name in ("wind_from", "bearing", "heading")}
    bearing = radians(angles["bearing"])
    flown = flight(
        "home",
        f"sim.seed={seed}",
        f"sim.wind.speed_mps={wind * SPEED}",
        f"sim.wind.from_deg={angles['wind_from']}",
        f"sim.start.north_m={away * cos(bearing)}",
        f"sim.start.east_m={away * sin(bearing)}",
        f"sim.start.heading_deg={angles['heading']}",
        f'orbit.direction="{chance.choice(("clockwise", "counterclockwise"))}"',
        *overrides,
        law="auto",
    )
    return flown, angles


def fly(row: str, seed: int, overrides: Iterable[str] = (), **changes: float) -> Result:
    """Fly until the laps are flown or the mission has ended."""
    flown, angles = prepared(seed, overrides, **changes)
    orbit = flown.pilot.settings.orbit
    lap = 2 * pi * orbit.radius / orbit.speed
    arrived = inf

    def watch(now: Flight) -> None:
        nonlocal arrived
        if arrived == inf and now.truths and true_radius(now.truths[-1]) < HOME:
            arrived = now.now

    flown.fly(5.0, watch)
    while not flown.pilot.done and flown.now <= arrived + LAPS * lap:
        flown.fly(flown.now + 1.0, watch)
    return {**angles, **figures(flown, arrived, lap)}


def figures(flown: Flight, arrived: float, lap: float) -> Result:
    """Return the figures of a flight. arrived: time at which it came within HOME, s. lap: duration
    of a lap, s."""
    orbit = flown.pilot.settings.orbit
    engaged = flown.pilot.mission.engaged_at
    assert engaged is not None
    under_way = [truth for truth in flown.truths if truth.time >= engaged]
    start = under_way[0]
    straight = straight_way(
        (-start.north, -start.east), (start.wind_north, start.wind_east), start.airspeed, HOME
    )
    late = [truth for truth in under_way if truth.time > arrived]
    # A plane that is not on the circle, or flies it in the wrong direction, has not arrived.
    right = -orbit.direction.turn_sign * clockwise_turns(late) >= 0.7 * LAPS
    home = arrived - engaged if right or not late else inf
    ranges = [true_radius(truth) for truth in late] or [inf]
    last = [true_radius(truth) - orbit.radius for truth in late if truth.time > flown.now - lap]
    return {
        "straight": straight,
        "home": home,
        "ratio": home / straight,
        "farthest": max(ranges),
        "nearest": min(ranges),
        "rms": float(np.sqrt(np.mean(np.square(last or [inf])))),
        "away": max(map(true_radius, under_way)) - true_radius(start),
    }


def came(one: Result) -> bool:
    """Return True if the plane arrived at the beacon and stayed there."""
    return isfinite(one["home"]) and one["farthest"] <= HOME


def main() -> None:
    """Print the share that came home, and quantiles over all flights."""
    parser = cells.parser(__doc__, ("home",), (1, 20))
    parser.add_argument("--wind", type=float, default=0.33, help="share of the airspeed")
    parser.add_argument("--away", type=float, default=2000.0, help="distance at the start, m")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    one = partial(fly, overrides=options.set, wind=options.wind, away=options.away)
    flights = cells.flown(one, options)["home"]
    print(f"{sum(map(came, flights))} of {len(flights)} home: on the circle, and within {HOME:g} m")
    names = ("ratio", "farthest", "nearest", "rms", "away")
    rows = (
        (name, *np.quantile([one[name] for one in flights], QUANTILES, method="nearest"))
        for name in names
    )
    print(cells.table("figure | least | median | 95 % | 99 % | most", rows))


if __name__ == "__main__":
    main()
