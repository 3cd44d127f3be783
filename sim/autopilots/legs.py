"""Flying somewhere: the plain position control of the modes that are not the companion's."""

import math

from sim.body import Body
from sim.demands import EarthVelocity

NEARNESS = 0.5  # 1/s: speed wanted per metre left


def toward(body: Body, north: float, east: float, down: float, speed: float, climb: float) -> EarthVelocity:
    """A velocity over the ground towards a place, at most `speed` and `climb` (m/s), slowing down near it."""
    away_north, away_east = north - body.north, east - body.east
    distance = math.hypot(away_north, away_east)
    wanted = min(speed, NEARNESS * distance)
    share = wanted / distance if distance > 1e-6 else 0.0
    vertical = max(-climb, min(climb, NEARNESS * (down - body.down)))
    return EarthVelocity(away_north * share, away_east * share, vertical)
