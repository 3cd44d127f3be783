"""Position error of a plane without GPS that flies home, 2 km away from the beacon, with positions
of the external position.

    python -m tests.tools.bench.bench_way_home --seeds 1 4

The bundled ArduPlane flies in lockstep; its radio has a reach of 500 m. GPS is lost after 100 s,
and RTL begins after 260 s. One line per flight: error of the reported position, m, at the end of
the circle, at 150 m from home, and 60 s later. The emulated autopilot navigates home by its true
position.
"""

from dataclasses import dataclass
from math import hypot

import numpy as np
from circnav_sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG

from tests.extras.external_position.external_position_flight import (
    ExternalPositionFlight,
    external_position_flight,
)
from tests.tools import cells
from tests.tools.cells import Result

AWAY = 2000.0
OFF = 100.0
CHANGED = 130.0
LEAVES = 260.0
LONGEST = 480.0
THERE = 150.0
LATER = 60.0
WORLD = (
    f'sim.events=[{{at_s={OFF}, action="gps_off"}}]',
    "sim.sensors.gps_error_m=1",
    "sim.sensors.dead_reckoning_mps=1",
    "sim.wind.speed_mps=5",
    "sim.wind.from_deg=270",
    f"sim.target.north_m={-AWAY}",
    f"sim.start.north_m={150 - AWAY}",
    "sim.start.east_m=-100",
    "sim.ranging.max_range_m=500",
    'sim.ranging.message="named_value_float"',
    'ranging.message="named_value_float"',
    'ranging.name="RANGE"',
    'exit.action="rtl"',
    f"limits.duration_s={LEAVES}",
)


@dataclass(frozen=True)
class Conditions:
    """Conditions of a row. changes: True if the wind of 5 m/s from the west becomes 8 m/s from the
    north after 130 s. heading: compass error from the start of RTL on, degrees. gusts: m/s (RMS)
    and s."""

    changes: bool = False
    heading: float = 0.0
    gusts: tuple[float, float] = (0.5, 1.0)


ROWS = {
    "steady wind": Conditions(),
    "changing wind": Conditions(changes=True),
    "compass error of 3 deg": Conditions(heading=3.0),
    "gusts of 1 m/s, 3 s": Conditions(gusts=(1.0, 3.0)),
}


def fly(row: str, seed: int) -> Result:
    """Fly, and return the position errors, m, at the end of the circle, at home and 60 s later."""
    given = ROWS[row]
    rms, time = given.gusts
    gusts = f"sim.wind.gust_rms_mps={rms}", f"sim.wind.gust_time_s={time}"
    flown = external_position_flight("arduplane", *WORLD, *gusts, f"sim.seed={seed}", law="auto")
    flown.solve_from = 60.0
    flown.solve_every = 30.0
    errors: list[tuple[float, float, float]] = []
    changed: list[float] = []
    left: list[float] = []

    def watch(flown: ExternalPositionFlight) -> None:
        if given.changes and flown.now > CHANGED and not changed:
            changed.append(flown.now)
            air = flown.vehicle._flight.air
            air._config = air._config.changed(from_deg=0.0)
            air.blow(8.0)
        if flown.pilot.done and not left:
            left.append(flown.now)
            instruments = flown.vehicle._flight.instruments
            instruments._config = instruments._config.changed(heading_bias_deg=given.heading)
        assert flown.companion is not None
        here = flown.companion.reckoning.where
        truth = flown.vehicle.truth
        if here is not None and flown.companion.plane is not None and flown.now > OFF:
            east, north = flown.companion.plane.to_metres(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG)
            error = hypot(here.east - east - truth.east, here.north - north - truth.north)
            errors.append((flown.now, error, hypot(truth.east, truth.north)))

    flown.fly(LONGEST, watch)
    times, off, away = np.array(errors).T
    there = float(times[away < THERE][0])
    found = np.interp((left[0], there, there + LATER), times, off)
    return dict(zip(("circle", "home", "later"), map(float, found), strict=True))


def main() -> None:
    """Print a line per flight, and the root mean square of each row."""
    rows = []
    for row, flights in cells.flown(fly, cells.parser(__doc__, ROWS, (1, 4)).parse_args()).items():
        found = [(one["circle"], one["home"], one["later"]) for one in flights]
        rows += [(row, one["seed"], *errors) for one, errors in zip(flights, found, strict=True)]
        rows.append((row, "all", *np.sqrt(np.mean(np.square(found), axis=0))))
    print(cells.table("row | seed | end of the circle, m | home, m | 60 s later, m", rows))


if __name__ == "__main__":
    main()
