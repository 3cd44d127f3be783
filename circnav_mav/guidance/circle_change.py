"""Changes of the circle in flight: radius, direction or speed, from the operator or a fleet.

Every change is a request, which is checked here. Requests are recorded and replayed.
"""

from dataclasses import dataclass, replace
from math import ceil, inf, pi
from typing import NamedTuple

from circnav_mav.guidance.types import Direction, Orbit

MIN_INTERVAL = 0.1
"""Shortest time between two requests, s. An earlier request is rejected. A fleet requests spacing
at most half as often."""
SPEED_SHARE = 0.2
"""Largest difference between a requested speed and the mission's speed, as a share of the mission's
speed. Up to this difference the mission's checks remain approximately valid."""


class CircleRequest(NamedTuple):
    """A request for another circle. None leaves a value unchanged.

    radius: requested radius, m.
    direction: requested sense of rotation.
    speed: requested speed, m/s.
    by: requester, for messages and the log.
    offset: offset of the radius that spaces a fleet, m, outward positive.
    pace: factor on the speed that spaces a fleet.

    The corrections by offset and pace are small and frequent. They do not change the circle of the
    mission.
    """

    radius: float | None = None
    direction: Direction | None = None
    speed: float | None = None
    by: str = ""
    offset: float | None = None
    pace: float | None = None

    @property
    def spaces(self) -> bool:
        """True if the request has no radius, direction and speed, but only the spacing of a fleet:
        offset or pace."""
        return self.radius is None and self.direction is None and self.speed is None

    def circle(self, orbit: Orbit) -> Orbit:
        """Return the requested circle without offset and pace. It is `orbit` itself if the request
        has only offset or pace."""
        if self.spaces:
            return orbit
        return replace(
            orbit,
            radius=orbit.radius if self.radius is None else self.radius,
            direction=self.direction or orbit.direction,
            speed=orbit.speed if self.speed is None else self.speed,
        )

    def applied(self, orbit: Orbit) -> Orbit:
        """Return the orbit to fly: the requested circle with offset and pace."""
        circle = self.circle(orbit)
        offset = self.offset or 0.0
        pace = 1.0 if self.pace is None else self.pace
        return replace(circle, radius=circle.radius + offset, speed=circle.speed * pace)


@dataclass(frozen=True, slots=True)
class CircleLimits:
    """Limits of requested circles.

    nearest, farthest: bounds of the range, m.
    speed: of the mission, m/s.
    keeps_speed: True if the autopilot uses its own airspeed setpoint: then no other speed can be
        requested.
    turn_gain: least expected ratio of flown to commanded turn rate.
    """

    speed: float
    nearest: float = 0.0
    farthest: float = inf
    keeps_speed: bool = False
    turn_gain: float = 1.0


def obstacle(
    request: CircleRequest,
    orbit: Orbit,
    limits: CircleLimits,
    wind: float = 0.0,
    most_turn: float = inf,
) -> str:
    """Return the reason why a requested circle cannot replace `orbit`, or an empty string. The text
    contains value and limit, and is short enough for a STATUSTEXT.

    wind: estimated drift, m/s, 0 while unknown.
    most_turn: learned turn rate that the vehicle reaches, rad/s.
    """
    wanted = request.applied(orbit)
    # Largest spacing offset, in units of the radius. A larger offset would be another circle.
    most = 0.3 * request.circle(orbit).radius
    if request.offset is not None and not abs(request.offset) <= most:
        return f"spacing offset {request.offset:+.1f} m, limit {most:.1f} m"
    if not limits.nearest < wanted.radius < limits.farthest:  # also rejects NaN
        return f"radius {wanted.radius:g} m outside {limits.nearest:g} to {limits.farthest:g} m"
    if wanted.speed != orbit.speed and limits.keeps_speed:
        return "this autopilot holds its own airspeed"
    low, high = limits.speed * (1 - SPEED_SHARE), limits.speed * (1 + SPEED_SHARE)
    if not low <= wanted.speed <= high:
        return f"speed {wanted.speed:g} m/s outside {low:g} to {high:g} m/s"
    able = limits.turn_gain * wanted.max_turn_rate
    if abs(wanted.steady_turn_rate) >= able:
        least = wanted.speed / able
        return f"radius {wanted.radius:g} m: min {least:.0f} m by turn rate"
    most_turn = min(most_turn, wanted.max_turn_rate)
    # Least radius in this wind, by the condition of the drift alarm. If the present circle is
    # already too small, accept a circle that is nearer to its least radius.
    least = _least_radius(wanted, wind, most_turn)
    present = orbit.radius / _least_radius(orbit, wind, most_turn)
    if not request.spaces and wanted.radius / least < min(present, 1.0):
        return f"radius {wanted.radius:g} m: min {ceil(least)} m in wind {wind:.0f} m/s"
    if wanted.direction is not orbit.direction:
        # To reverse its direction, the vehicle turns outward by half a circle at its turn-rate
        # limit. The wind moves the vehicle during this turn, and the turn begins up to 1 s late.
        V = wanted.speed
        reach = wanted.radius + (2 + pi * wind / V) * V / most_turn + V + wind
        if reach > limits.farthest:
            return f"reversal reaches {reach:.0f} m, max {limits.farthest:g} m"
    return ""


def _least_radius(orbit: Orbit, wind: float, most_turn: float) -> float:
    """Return the least radius that can be held in wind, m, by the condition of
    `laws.tolerated_drift`."""
    return (orbit.speed + wind) ** 2 / (orbit.speed * most_turn)
