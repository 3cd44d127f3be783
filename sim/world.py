"""Home, air and target, with a flat-earth conversion near home."""

import math
from random import Random

from .config import Target, Wind

HOME_LATITUDE_DEG = -35.3632621
HOME_LONGITUDE_DEG = 149.1652374
HOME_AMSL_M = 584.0
# WGS84 at home: meters per degree of latitude and of longitude (the usual series; a sphere is 0.3 %
# off)
_LAT = math.radians(HOME_LATITUDE_DEG)
M_PER_LATITUDE = 111132.954 - 559.822 * math.cos(2 * _LAT) + 1.175 * math.cos(4 * _LAT)
M_PER_LONGITUDE = (
    111412.877 * math.cos(_LAT) - 93.504 * math.cos(3 * _LAT) + 0.118 * math.cos(5 * _LAT)
)


def to_degrees(north: float, east: float) -> tuple[float, float]:
    """Return latitude and longitude, degrees. The error is centimeters at a few kilometers from
    home."""
    return HOME_LATITUDE_DEG + north / M_PER_LATITUDE, HOME_LONGITUDE_DEG + east / M_PER_LONGITUDE


def target_at(target: Target, time: float) -> tuple[float, float, float]:
    """Return the target's place at a time, NED meters. Turn rate and acceleration along the course
    are constant."""
    speed = math.hypot(target.velocity_north_mps, target.velocity_east_mps)
    course = math.atan2(target.velocity_east_mps, target.velocity_north_mps)
    north, east = _path(
        speed, target.acceleration_mps2, course, math.radians(target.turn_rate_deg_s), time
    )
    return target.north_m + north, target.east_m + east, -target.altitude_m


def _path(
    speed: float, acceleration: float, course: float, turn: float, t: float
) -> tuple[float, float]:
    """Integrate (speed + acceleration t) along a course that turns at a constant rate."""
    if abs(turn) * max(t, 1.0) < 1e-9:
        run = speed * t + acceleration * t * t / 2
        return run * math.cos(course), run * math.sin(course)
    end = course + turn * t
    last = speed + acceleration * t
    north = (last * math.sin(end) - speed * math.sin(course)) / turn
    east = (speed * math.cos(course) - last * math.cos(end)) / turn
    north += acceleration * (math.cos(end) - math.cos(course)) / turn**2
    east += acceleration * (math.sin(end) - math.sin(course)) / turn**2
    return north, east


def from_degrees(latitude: float, longitude: float) -> tuple[float, float]:
    """Return meters north and east of home."""
    north = (latitude - HOME_LATITUDE_DEG) * M_PER_LATITUDE
    east = (longitude - HOME_LONGITUDE_DEG) * M_PER_LONGITUDE
    return north, east


class Air:
    """Wind velocity north and east, m/s: a steady part and first-order gusts."""

    GUST_STEP_US = 100_000

    def __init__(self, config: Wind, seed: int) -> None:
        self._config = config
        self._rng = Random(f"{seed}:gusts")
        self._gust = (0.0, 0.0)
        self._from = config.from_deg
        self.blow(config.speed_mps)

    @property
    def gusty(self) -> bool:
        return self._config.gust_rms_mps > 0

    def blow(self, speed: float) -> None:
        """Set the speed of the steady wind, m/s. The direction stays."""
        self._speed = speed
        towards = math.radians(self._from) + math.pi
        self._steady = (speed * math.cos(towards), speed * math.sin(towards))
        self._add()

    def turn(self, from_deg: float) -> None:
        """Set the direction from which the steady wind blows. The speed stays."""
        self._from = from_deg
        self.blow(self._speed)

    def gust(self) -> None:
        """Advance the gusts by 0.1 s. They have the correlation time gust_time_s and the RMS
        gust_rms_mps per axis."""
        kept = math.exp(-self.GUST_STEP_US * 1e-6 / self._config.gust_time_s)
        fresh = self._config.gust_rms_mps * math.sqrt(1 - kept * kept)
        north, east = self._gust
        self._gust = (
            kept * north + self._rng.gauss(0.0, fresh),
            kept * east + self._rng.gauss(0.0, fresh),
        )
        self._add()

    def _add(self) -> None:
        self.velocity = (self._steady[0] + self._gust[0], self._steady[1] + self._gust[1])
