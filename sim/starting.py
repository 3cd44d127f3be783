"""Initial state of the vehicle. Its random parts are drawn with the seed."""

import math
from random import Random

from .body import Body
from .config import VehicleConfig
from .schema import Interval

ALTITUDE_M = {"arduplane": 100.0, "px4_plane": 100.0, "ardurover": 0.0}
CRUISE_MPS = {"arduplane": 22.0, "px4_plane": 10.0}
AIRSPEED_SCALE = {"arduplane": 1.065, "px4_plane": 1.033}
"""Ratio of true to indicated airspeed at 684 m above sea level. ArduPilot's simulator applies the
air density twice."""


def starting_body(config: VehicleConfig, wind: tuple[float, float]) -> Body:
    """Return the initial state. start.speed_mps is the speed over the ground for copters, and
    through the air for fixed wings."""
    north, east, heading = _drawn(config)
    profile = config.vehicle.profile
    start = config.start
    altitude = start.altitude_m
    if altitude is None:
        altitude = ALTITUDE_M.get(profile, 50.0) if start.armed else 0.0
    speed = start.speed_mps or 0.0
    air_speed = 0.0
    drift = (0.0, 0.0)
    if profile in CRUISE_MPS and altitude > 0:
        scale = config.vehicle.airspeed_scale or AIRSPEED_SCALE.get(profile, 1.0)
        air_speed = (
            start.speed_mps or (config.vehicle.cruise_speed_mps or CRUISE_MPS[profile]) * scale
        )
        speed = air_speed
        drift = wind
    return Body(
        north=north,
        east=east,
        down=-altitude,
        heading=heading,
        velocity_north=speed * math.cos(heading) + drift[0],
        velocity_east=speed * math.sin(heading) + drift[1],
        air_speed=air_speed,
        trimmed_wind=wind,
    )


def _drawn(config: VehicleConfig) -> tuple[float, float, float]:
    """Return north, east (m) and heading (rad), drawn with the seed. Range and bearing are
    horizontal and seen from the target."""
    start = config.start
    target = config.target
    bounds = config.start.random
    rng = Random(f"{config.seed}:start")
    draws = [rng.random() for _ in range(5)]
    north = _pick(bounds.north_m, start.north_m, draws[0])
    east = _pick(bounds.east_m, start.east_m, draws[1])
    if bounds.range_m is not None or bounds.bearing_deg is not None:
        away_north = north - target.north_m
        away_east = east - target.east_m
        distance = _pick(bounds.range_m, math.hypot(away_north, away_east), draws[3])
        bearing = math.radians(
            _pick(bounds.bearing_deg, math.degrees(math.atan2(away_east, away_north)), draws[4])
        )
        north = target.north_m + distance * math.cos(bearing)
        east = target.east_m + distance * math.sin(bearing)
    heading = math.radians(_pick(bounds.heading_deg, start.heading_deg, draws[2]))
    return north, east, math.remainder(heading, math.tau)


def _pick(interval: Interval | None, otherwise: float, draw: float) -> float:
    return otherwise if interval is None else interval[0] + (interval[1] - interval[0]) * draw
