"""Where home is, and flat-earth conversion near it."""

import math

HOME_LATITUDE_DEG = -35.3632621
HOME_LONGITUDE_DEG = 149.1652374
HOME_AMSL_M = 584.0
EARTH_RADIUS_M = 6_378_137.0


def to_degrees(north: float, east: float) -> tuple[float, float]:
    """Metres from home to latitude and longitude in degrees (equirectangular: centimetres over a few kilometres)."""
    latitude = HOME_LATITUDE_DEG + math.degrees(north / EARTH_RADIUS_M)
    longitude = HOME_LONGITUDE_DEG + math.degrees(east / (EARTH_RADIUS_M * math.cos(math.radians(HOME_LATITUDE_DEG))))
    return latitude, longitude


def from_degrees(latitude: float, longitude: float) -> tuple[float, float]:
    """Degrees to metres north and east of home."""
    north = math.radians(latitude - HOME_LATITUDE_DEG) * EARTH_RADIUS_M
    east = math.radians(longitude - HOME_LONGITUDE_DEG) * EARTH_RADIUS_M * math.cos(math.radians(HOME_LATITUDE_DEG))
    return north, east


def wrap(angle: float) -> float:
    """An angle in radians brought into -pi .. pi."""
    return math.remainder(angle, math.tau)
