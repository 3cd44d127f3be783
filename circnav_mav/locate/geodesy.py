"""Degrees to metres and back near one place: a plane with the curvature of WGS84 (centimetres over ten kilometres)."""

from dataclasses import dataclass
from math import cos, degrees, radians, sin
from typing import Any

SEMI_MAJOR, ECCENTRICITY_SQUARED = 6378137.0, 6.69437999014e-3


@dataclass(frozen=True, slots=True)
class Plane:
    """The plane that touches the ellipsoid at latitude, longitude (degrees). Coordinates: m east, m north."""

    latitude: float
    longitude: float

    def _metres_per_radian(self) -> tuple[float, float]:
        """East and north: the radii of curvature, that of the parallel and that of the meridian."""
        phi = radians(self.latitude)
        w = 1 - ECCENTRICITY_SQUARED * sin(phi) ** 2
        return SEMI_MAJOR / w**0.5 * cos(phi), SEMI_MAJOR * (1 - ECCENTRICITY_SQUARED) / w**1.5

    def to_metres(self, latitude: Any, longitude: Any) -> tuple[Any, Any]:
        """East and north of numbers or arrays, degrees."""
        east, north = self._metres_per_radian()
        around = (longitude - self.longitude + 180) % 360 - 180
        return around * radians(east), (latitude - self.latitude) * radians(north)

    def to_degrees(self, east: Any, north: Any) -> tuple[Any, Any]:
        """Latitude and longitude of numbers or arrays, m."""
        per_east, per_north = self._metres_per_radian()
        longitude = self.longitude + degrees(1 / per_east) * east
        return self.latitude + degrees(1 / per_north) * north, (longitude + 180) % 360 - 180
