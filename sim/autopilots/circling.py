"""The bank that keeps a plane round a point."""

import math
from typing import NamedTuple

from ..body import GRAVITY, Body

COURSE_GAIN = 1.0  # rad/s per rad


class Loiter(NamedTuple):
    """A circle flown clockwise, metres."""

    north: float
    east: float
    radius: float


def bank_on_loiter(body: Body, circle: Loiter, limit: float, effectiveness: float) -> float:
    """Towards the circle, then along it."""
    north, east = body.north - circle.north, body.east - circle.east
    distance = max(1.0, math.hypot(north, east))
    radius = max(5.0, abs(circle.radius))
    outwards = math.atan2(east, north)
    outside = (distance - radius) / radius
    wanted = outwards + math.pi / 2 + math.atan(2.0 * outside)  # clockwise, bent inwards when outside
    error = math.remainder(wanted - body.course, math.tau)
    speed = max(3.0, body.ground_speed)
    along = speed / max(distance, radius) if abs(outside) < 0.5 else 0.0
    rate = along + COURSE_GAIN * error
    return max(-limit, min(limit, math.atan(speed * rate / (GRAVITY * effectiveness))))
