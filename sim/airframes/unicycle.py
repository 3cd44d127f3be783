"""The ideal airframe: north' = V cos(heading), east' = V sin(heading), heading' = turn rate,
integrated exactly.

The turn rate follows the command through a limit and a first-order lag, the speed through a
first-order lag. When both have settled, a step is an exact arc. Until then heading and speed are
exact, and the path is a Gauss-Legendre quadrature over at most 0.1 s and 0.25 rad (error below a
micrometer).
"""

import math
from dataclasses import dataclass

from ..body import GRAVITY, Body, to_earth, within
from ..demands import BodyVelocity, Brake, EarthVelocity, Velocity

SETTLED = 1e-12
NODES = ((0.1127016653792583, 5 / 18), (0.5, 8 / 18), (0.8872983346207417, 5 / 18))


@dataclass(frozen=True)
class Unicycle:
    """Limits and lags of the ideal vehicle (rad/s, s)."""

    max_turn_rate: float
    turn_lag: float
    speed_lag: float

    def step(self, body: Body, demand: Velocity, dt: float) -> Body:
        """Return the body `dt` seconds later under a constant demand."""
        if dt <= 0:
            return body
        if isinstance(demand, BodyVelocity):
            moved = self._with_the_nose(body, demand, dt)
        elif isinstance(demand, EarthVelocity):
            moved = self._over_the_ground(body, demand, dt)
        else:
            moved = self._braking(body, demand, dt)
        down = min(body.down + demand.down * dt, 0.0)
        return moved._replace(
            down=down,
            velocity_down=(down - body.down) / dt,
            roll=math.atan(moved.forward_speed * moved.turn_rate / GRAVITY),  # coordinated turn
        )

    def _with_the_nose(self, body: Body, demand: BodyVelocity, dt: float) -> Body:
        forward = _Lagged(body.forward_speed, demand.forward, self.speed_lag)
        right = _Lagged(body.right_speed, demand.right, self.speed_lag)
        rate = _Lagged(body.turn_rate, within(demand.yaw_rate, self.max_turn_rate), self.turn_lag)
        heading = math.remainder(body.heading + rate.integral(dt), math.tau)
        north, east = (_arc if rate.settled and forward.settled and right.settled else _quadrature)(
            body.heading, rate, forward, right, dt
        )
        velocity_north, velocity_east = to_earth(forward.at(dt), right.at(dt), heading)
        return body._replace(
            heading=heading,
            turn_rate=rate.at(dt),
            north=body.north + north,
            east=body.east + east,
            velocity_north=velocity_north,
            velocity_east=velocity_east,
        )

    def _over_the_ground(self, body: Body, demand: EarthVelocity, dt: float) -> Body:
        north = _Lagged(body.velocity_north, demand.north, self.speed_lag)
        east = _Lagged(body.velocity_east, demand.east, self.speed_lag)
        turned = self._turned(body, demand.yaw_rate, dt)
        return turned._replace(
            north=body.north + north.integral(dt),
            east=body.east + east.integral(dt),
            velocity_north=north.at(dt),
            velocity_east=east.at(dt),
        )

    def _braking(self, body: Body, demand: Brake, dt: float) -> Body:
        speed = body.ground_speed
        stopping = min(dt, speed / demand.deceleration)
        after = speed - demand.deceleration * stopping
        path = (speed + after) / 2 * stopping
        share, kept = (path / speed, after / speed) if speed > 0 else (0.0, 0.0)
        turned = self._turned(body, 0.0, dt)
        return turned._replace(
            north=body.north + body.velocity_north * share,
            east=body.east + body.velocity_east * share,
            velocity_north=body.velocity_north * kept,
            velocity_east=body.velocity_east * kept,
        )

    def _turned(self, body: Body, yaw_rate: float, dt: float) -> Body:
        rate = _Lagged(body.turn_rate, within(yaw_rate, self.max_turn_rate), self.turn_lag)
        heading = math.remainder(body.heading + rate.integral(dt), math.tau)
        return body._replace(heading=heading, turn_rate=rate.at(dt))


class _Lagged:
    """A value that approaches `goal` from `start` with a first-order lag. With lag 0, it changes at
    once."""

    def __init__(self, start: float, goal: float, lag: float) -> None:
        self.goal = goal
        self.lag = lag
        self.error = start - goal if lag > 0 and abs(start - goal) > SETTLED else 0.0

    @property
    def settled(self) -> bool:
        return self.error == 0.0

    def at(self, t: float) -> float:
        return self.goal + self.error * math.exp(-t / self.lag) if self.error else self.goal

    def integral(self, t: float) -> float:
        slow = self.error * self.lag * -math.expm1(-t / self.lag) if self.error else 0.0
        return self.goal * t + slow


def _arc(
    heading: float, rate: _Lagged, forward: _Lagged, right: _Lagged, dt: float
) -> tuple[float, float]:
    """Return the exact displacement of a steady turn: a chord along the mean heading."""
    half = rate.goal * dt / 2
    chord = dt * (math.sin(half) / half if abs(half) > 1e-4 else 1 - half * half / 6)
    cos, sin = math.cos(heading + half), math.sin(heading + half)
    return chord * (forward.goal * cos - right.goal * sin), chord * (
        forward.goal * sin + right.goal * cos
    )


def _quadrature(
    heading: float, rate: _Lagged, forward: _Lagged, right: _Lagged, dt: float
) -> tuple[float, float]:
    fastest = max(abs(rate.goal), abs(rate.goal + rate.error))
    pieces = max(1, math.ceil(dt / 0.1), math.ceil(fastest * dt / 0.25))
    north = 0.0
    east = 0.0
    width = dt / pieces
    for piece in range(pieces):
        for node, weight in NODES:
            t = (piece + node) * width
            u, v = to_earth(forward.at(t), right.at(t), heading + rate.integral(t))
            north += weight * width * u
            east += weight * width * v
    return north, east
