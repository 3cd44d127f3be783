"""Position error of a plane without GPS that flies home, 2 km away from the beacon, with positions
of the external position.

    python -m tests.tools.bench.bench_way_home --reach 500 --flights 4 [--change] [--heading 3]
        [--gusts 1 3]

The bundled ArduPlane flies in lockstep. Wind: 5 m/s from the west; with --change, 8 m/s from the
north after 130 s. GPS is lost after 100 s, and RTL begins after 260 s. One line per flight: error
of the reported position, m, at the end of the circle, at 150 m from home, and 60 s later. heading:
compass error from the start of RTL on, degrees. The emulated autopilot navigates home by its true
position.
"""

import argparse
from dataclasses import dataclass
from math import hypot

import numpy as np
from circnav_sim.world import HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG

from tests.extras.external_position.external_position_flight import (
    ExternalPositionFlight,
    external_position_flight,
)

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
    'sim.ranging.message="named_value_float"',
    'ranging.message="named_value_float"',
    'ranging.name="RANGE"',
    'exit.action="rtl"',
    f"limits.duration_s={LEAVES}",
)


@dataclass
class WayHome:
    """One flight. errors: time, s; error, m; distance from home, m."""

    options: argparse.Namespace
    changed: bool = False
    left: float | None = None

    def __post_init__(self) -> None:
        self.errors: list[tuple[float, float, float]] = []

    def watch(self, flown: ExternalPositionFlight) -> None:
        """Apply the events that are due and record the error."""
        flight = flown.vehicle._flight
        companion = flown.companion
        if self.options.change and not self.changed and flown.now > CHANGED:
            self.changed = True
            flight.air._config = flight.air._config.changed(from_deg=0.0)
            flight.air.blow(8.0)
        if flown.pilot.done and self.left is None:
            self.left = flown.now
            instruments = flight.instruments
            instruments._config = instruments._config.changed(heading_bias_deg=self.options.heading)
        assert companion is not None
        here = companion.reckoning.where
        truth = flown.vehicle.truth
        if here is not None and companion.plane is not None and flown.now > OFF:
            east, north = companion.plane.to_metres(HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG)
            error = hypot(here.east - east - truth.east, here.north - north - truth.north)
            self.errors.append((flown.now, error, hypot(truth.east, truth.north)))

    def fly(self, seed: int) -> tuple[float, float, float]:
        """Fly, and return the position errors at the end of the circle, at home and 60 s later,
        m."""
        rms, time = self.options.gusts
        changes = (f"sim.ranging.max_range_m={self.options.reach}", f"sim.wind.gust_rms_mps={rms}",
                   f"sim.wind.gust_time_s={time}", f"sim.seed={seed}")  # fmt: skip
        flown = external_position_flight("arduplane", *WORLD, *changes, law="auto")
        flown.solve_from = 60.0
        flown.solve_every = 30.0
        flown.fly(LONGEST, self.watch)
        times, errors, away = np.array(self.errors).T
        there = float(times[away < THERE][0])
        assert self.left is not None
        return tuple(
            float(np.interp(at, times, errors)) for at in (self.left, there, there + LATER)
        )  # type: ignore[return-value]


def main() -> None:
    """Print a line per flight, and their root mean squares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--reach", type=float, default=500.0, help="reach of the radio, m")
    parser.add_argument("--flights", type=int, default=4)
    parser.add_argument("--change", action="store_true", help="the wind changes during the flight")
    parser.add_argument("--heading", type=float, default=0.0, help="error of the compass, degrees")
    parser.add_argument(
        "--gusts", type=float, nargs=2, default=(0.5, 1.0), metavar=("RMS", "TIME"), help="m/s, s"
    )
    options = parser.parse_args()
    found = []
    for seed in range(1, 1 + options.flights):
        found.append(WayHome(options).fly(seed))
        print("| {} | {:.1f} | {:.1f} | {:.1f} |".format(seed, *found[-1]), flush=True)
    print("| all | {:.1f} | {:.1f} | {:.1f} |".format(*np.sqrt(np.mean(np.square(found), axis=0))))


if __name__ == "__main__":
    main()
