"""`orbit.radius_m = [100, 60]`: the first circle, then the second; and what the survey knows after each."""

from math import atan2, degrees, pi

import numpy as np
import pytest

from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, load_mission
from sim.vehicle import Truth
from tests.flight.lockstep import CONFIG, true_radius
from tests.locate.flown import surveyed

BOTH = "orbit.radius_m=[100, 60]"
WORLD = (
    "sim.sensors.gps_error_m=0.5", "sim.wind.speed_mps=4", 'sim.vehicle.dynamics="airborne"',
    "sim.start.north_m=150", "sim.start.east_m=0", "sim.ranging.bias_m=1.5",
)  # fmt: skip
HEIGHT_AT_START = "orbit.height_above_target_m"


def swept(truths: list[Truth]) -> float:
    """Round the target, degrees."""
    angles = [atan2(one.north - one.target_north, one.east - one.target_east) for one in truths]
    return degrees(abs(np.unwrap(angles)[-1] - angles[0]))


def test_the_second_circle_begins_after_a_lap_of_the_first_and_its_height_is_known_only_then() -> None:
    """The emulated target stands at 584 m above the sea (home 584, sim.target.altitude_m 0)."""
    flown = surveyed("quickstart", BOTH, *WORLD, law="feedforward", gps_sigma=0.5)
    flown.solve_from = 1e9
    flown.fly(45.0)
    first = [one for one in flown.truths if abs(true_radius(one) - 100.0) < 10.0]
    assert flown.pilot.controller.orbit.radius == 100.0
    flown.fly(120.0)
    raise AssertionError((len(first), [(t.time, t.desired) for t in flown.ticks[::100]]))
