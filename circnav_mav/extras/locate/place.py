"""Estimated place of the target, in meters on a plane and in degrees."""

from dataclasses import dataclass, field, replace
from math import atan2, cos, degrees, hypot, radians, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

SEMI_MAJOR = 6378137.0
"""Semi-major axis of the WGS 84 ellipsoid, m."""
ECCENTRICITY_SQUARED = 6.69437999014e-3
"""First eccentricity squared of the WGS 84 ellipsoid."""


@dataclass(frozen=True, slots=True)
class Plane:
    """Plane tangent to the ellipsoid at a latitude and longitude (degrees). Coordinates on the
    plane: east and north, m."""

    latitude: float
    longitude: float

    def _metres_per_radian(self) -> tuple[float, float]:
        """Return meters per radian of longitude (radius of the parallel) and of latitude (radius of
        curvature)."""
        phi = radians(self.latitude)
        w = 1 - ECCENTRICITY_SQUARED * sin(phi) ** 2
        return SEMI_MAJOR / w**0.5 * cos(phi), SEMI_MAJOR * (1 - ECCENTRICITY_SQUARED) / w**1.5

    def to_metres(self, latitude: Any, longitude: Any) -> tuple[Any, Any]:
        """Return east and north (m) of a latitude and longitude (degrees), numbers or arrays."""
        east, north = self._metres_per_radian()
        return wrapped(longitude - self.longitude) * radians(east), (
            latitude - self.latitude
        ) * radians(north)

    def to_degrees(self, east: Any, north: Any) -> tuple[Any, Any]:
        """Return latitude and longitude (degrees) of coordinates on the plane (m), numbers or
        arrays."""
        per_east, per_north = self._metres_per_radian()
        longitude = self.longitude + degrees(1 / per_east) * east
        return self.latitude + degrees(1 / per_north) * north, wrapped(longitude)


def wrapped(longitude: Any) -> Any:
    """Return a longitude, number or array, from -180 to 180 degrees."""
    return (longitude + 180) % 360 - 180


Array = NDArray[np.float64]
CHI95 = 2.4477
"""Ratio of the semi-axes of the 95 % ellipse to the standard deviations: square root of
chi-squared, two degrees of freedom."""
SIGNIFICANT = 3.0
"""Smallest distance of a radio's bias or scale error from zero, in standard deviations, that shows
an error of the radio."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """95 % ellipse. major, minor: semi-axes, m. azimuth: direction of the major axis, degrees
    clockwise from north."""

    major: float
    minor: float
    azimuth: float


@dataclass(frozen=True, slots=True)
class Place:
    """Place of the target at a time (s).

    east, north: coordinates on the plane, m.
    up: height above sea level, as vehicle altitudes, m.
    covariance: (2, 2) of east and north, m^2, including the vehicle's position error.
    up_sigma: standard deviation of the height, m.
    up_known: True if the height is observed or given, False if `up` is only the prior.
    velocity: east and north, m/s, zero for a target that appears stationary.
    velocity_sigma: standard deviation of the velocity per axis, m/s, None for a stationary target.
    bias, scale: a measured range is too long by bias (m) + scale times its length.
    radio_covariance: (2, 2) of bias and scale.
    delay: time, s, by which positions are older than ranges with the same timestamp.
    noise: standard deviation of the range residuals, m.
    used, outliers: numbers of used ranges and of outliers.
    range_scale: median range, m.
    """

    time: float
    plane: Plane
    east: float
    north: float
    up: float
    covariance: Array
    up_sigma: float
    up_known: bool
    bias: float = 0.0
    scale: float = 0.0
    radio_covariance: Array = field(default_factory=lambda: np.zeros((2, 2)))
    delay: float = 0.0
    delay_sigma: float = 0.0
    noise: float = 0.0
    used: int = 0
    outliers: int = 0
    velocity: tuple[float, float] = (0.0, 0.0)
    velocity_sigma: float | None = None
    range_scale: float = 100.0

    @property
    def latitude(self) -> float:
        """Latitude, degrees."""
        return float(self.plane.to_degrees(self.east, self.north)[0])

    @property
    def longitude(self) -> float:
        """Longitude, degrees."""
        return float(self.plane.to_degrees(self.east, self.north)[1])

    @property
    def ellipse(self) -> Ellipse:
        """95 % ellipse of the place."""
        values, vectors = np.linalg.eigh(self.covariance)
        minor, major = np.sqrt(np.maximum(values, 0.0)) * CHI95
        return Ellipse(
            float(major), float(minor), degrees(atan2(vectors[0, 1], vectors[1, 1])) % 180
        )

    @property
    def sigma(self) -> float:
        """Standard deviation along the major axis of the ellipse, m."""
        return self.ellipse.major / CHI95

    @property
    def bias_sigma(self) -> float:
        """Standard deviation of the radio's bias, m."""
        return float(np.sqrt(self.radio_covariance[0, 0]))

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the radio's scale error."""
        return float(np.sqrt(self.radio_covariance[1, 1]))

    @property
    def scale_found(self) -> bool:
        """True if the ranges contradict a radio that measures true meters."""
        return abs(self.scale) > SIGNIFICANT * self.scale_sigma

    def range_error(self, length: float) -> tuple[float, float]:
        """Return the error (measured minus true) of a range of this length (m) and its standard
        deviation, m."""
        slope = np.array([1.0, length])
        return self.bias + self.scale * length, float(
            np.sqrt(slope @ self.radio_covariance @ slope)
        )

    @property
    def distance_scale(self) -> float:
        """True distance of the median range, m."""
        return max(self.range_scale - self.bias, 0.0) / (1 + self.scale)

    def range_error_words(self) -> str:
        """Return the range error at the median distance, as text."""
        far = self.distance_scale
        error, sigma = self.range_error(far)
        share = f" ({100 * abs(error) / far:.0f} %)" if far > 0 else ""
        return (
            f"{abs(error):.2f} ±{sigma:.2f} m{share} too {'long' if error > 0 else 'short'} at"
            f" the median distance of {far:.0f} m"
        )

    @property
    def moves(self) -> bool:
        """True if the target moves."""
        return self.velocity_sigma is not None

    @property
    def speed(self) -> float:
        """Ground speed, m/s."""
        return hypot(*self.velocity)

    @property
    def course(self) -> float:
        """Course over ground of a moving target, degrees clockwise from north."""
        return degrees(atan2(*self.velocity)) % 360

    def distance(self, other: "Place") -> float:
        """Return the distance to another place on the same plane, m."""
        return hypot(self.east - other.east, self.north - other.north)

    def at(self, time: float) -> "Place":
        """Return the place at another time (s). The covariance of a moving target grows."""
        if self.velocity_sigma is None:
            return self
        dt = time - self.time
        covariance = self.covariance + np.eye(2) * (self.velocity_sigma * dt) ** 2
        east, north = self.east + self.velocity[0] * dt, self.north + self.velocity[1] * dt
        return replace(self, time=time, east=east, north=north, covariance=covariance)

    def plain(self) -> dict[str, Any]:
        """Return the fields for summary.json and GeoJSON. The names of the fields contain the
        units."""
        ellipse = self.ellipse
        return {
            "latitude_deg": round(self.latitude, 8),
            "longitude_deg": round(self.longitude, 8),
            "altitude_m": round(self.up, 2) if self.up_known else None,
            "altitude_sigma_m": round(self.up_sigma, 2) if self.up_known else None,
            "height": "known" if self.up_known else NOT_OBSERVABLE,
            "sigma_m": round(self.sigma, 2),
            "ellipse_95": {
                "semi_major_m": round(ellipse.major, 2),
                "semi_minor_m": round(ellipse.minor, 2),
                "azimuth_deg": round(ellipse.azimuth, 1),
            },
            "moves": self.moves,
            "speed_mps": round(self.speed, 2),
            "course_deg": round(self.course, 1) if self.moves else None,
            "speed_sigma_mps": None
            if self.velocity_sigma is None
            else round(self.velocity_sigma, 2),
            "range_bias_m": round(self.bias, 2),
            "range_bias_sigma_m": round(self.bias_sigma, 2),
            "range_scale": round(1 + self.scale, 5) if self.scale_found else None,
            "range_scale_sigma": round(self.scale_sigma, 5) if self.scale_found else None,
            "position_delay_s": round(self.delay, 3),
            "position_delay_sigma_s": round(self.delay_sigma, 3),
            "range_noise_m": round(self.noise, 2),
            "ranges": self.used,
            "outliers": self.outliers,
            "time_s": round(self.time, 2),
        }

    @property
    def scale_words(self) -> str:
        """Scale of the ranges as text."""
        if not self.scale_found:
            return "scale 1 assumed: the ranges do not contradict it"
        return f"scale {1 + self.scale:.4f} ±{self.scale_sigma:.4f}"

    def words(self) -> str:
        """Return a human-readable line."""
        height = (
            f"altitude {self.up:.1f} ±{self.up_sigma:.1f} m"
            if self.up_known
            else "height not observable"
        )
        moves = ""
        if self.velocity_sigma is not None:
            moves = (
                f", moves {self.speed:.1f} ±{self.velocity_sigma:.1f} m/s towards"
                f" {self.course:03.0f} deg"
            )
        return f"{self.latitude:.7f} {self.longitude:.7f} ±{self.sigma:.1f} m{moves}, {height}"


NOT_OBSERVABLE = (
    "not observable: one circle cannot separate it from a range bias; fly a second radius or height"
)
