"""Whether the bundled vehicle of a mission is the one that the mission means to fly."""

from collections.abc import Iterator
from math import cos, hypot, radians, sin

from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.check_result import Check, Grade
from circnav_mav.mission.checks import drift_allowed
from circnav_mav.mission.mission import Mission
from sim.config import VehicleConfig
from sim.starting import CRUISE_MPS

FLIES = {
    profile: (autopilot, kind.split()[0])
    for (autopilot, kind), vehicle in AUTOPILOTS.items()
    for profile in vehicle.bundled
}
"""Autopilot and kind that each profile imitates."""
SPEED_OFF = 0.05
"""Fraction by which a plane's own cruise speed may differ from the mission's."""


def check_bundled(mission: Mission, config: VehicleConfig) -> Iterator[Check]:
    """Lines for what of the [sim] table does not fit the mission; none where all does."""
    wanted, profile = mission.file.vehicle, config.vehicle.profile
    autopilot, kind = FLIES[profile]
    if kind != wanted.kind or wanted.autopilot not in ("auto", autopilot):
        yield Check(
            Grade.FAIL, "sim", f"sim.vehicle.profile {profile} is no {wanted.autopilot} {wanted.kind} of [vehicle]"
        )
        return
    cruise = config.vehicle.cruise_speed_mps or CRUISE_MPS.get(profile, wanted.speed_mps)
    cruises = any(vehicle.cruises for vehicle in mission.vehicles)
    if cruises and abs(cruise / wanted.speed_mps - 1) > SPEED_OFF:
        yield Check(
            Grade.WARN,
            "sim",
            f"the bundled plane cruises at {cruise:g} m/s (sim.vehicle.cruise_speed_mps), "
            f"vehicle.speed_mps counts on {wanted.speed_mps:g}",
        )
    in_air = any(vehicle.ground_speed_sigma is None for vehicle in mission.vehicles)
    drift, tolerated = _drift(config, in_air=in_air), drift_allowed(mission)
    if drift > tolerated > 0:
        yield Check(
            Grade.WARN,
            "sim",
            f"sim.wind less the target's motion is {drift:.1f} m/s, more than the {tolerated:.1f} m/s that the circle "
            "allows",
        )


def _drift(config: VehicleConfig, *, in_air: bool) -> float:
    """Wind less target motion, m/s, at the start; a vehicle that holds its speed over the ground feels no wind."""
    wind = config.wind.speed_mps if in_air or config.vehicle.dynamics == "airborne" else 0.0
    towards = radians(config.wind.from_deg + 180.0)
    north = wind * cos(towards) - config.target.velocity_north_mps
    return hypot(north, wind * sin(towards) - config.target.velocity_east_mps)
