"""The values that flow through the guidance, frozen and in SI units."""

from dataclasses import dataclass
from enum import Enum
from typing import NewType

TurnRate = NewType("TurnRate", float)
"""Turn rate in rad/s, counter-clockwise positive seen from above (the paper's frame)."""


class Direction(Enum):
    """Sense of rotation round the target, seen from above."""

    CLOCKWISE = "clockwise"
    COUNTERCLOCKWISE = "counterclockwise"

    @property
    def turn_sign(self) -> int:
        """Sign of the steady turn rate in the paper's frame: +1 counter-clockwise, -1 clockwise."""
        return 1 if self is Direction.COUNTERCLOCKWISE else -1


@dataclass(frozen=True, slots=True)
class RangeSample:
    """One measured range.

    stamp: time of the measurement on the sensor's clock, s (any epoch; only differences count).
    time: the same moment on the local clock, s.
    r: horizontal distance to the target, m. sigma: its standard deviation, m.
    source: who measured it, for the log.
    """

    stamp: float
    time: float
    r: float
    sigma: float
    source: str = ""


@dataclass(frozen=True, slots=True)
class RangeEstimate:
    """What an estimator believes at one moment of the local clock.

    r, r_dot: range (m) and range rate (m/s); r_sigma, r_dot_sigma: their standard deviations.
    """

    time: float
    r: float
    r_dot: float
    r_sigma: float
    r_dot_sigma: float


@dataclass(frozen=True, slots=True)
class Orbit:
    """The circle to fly and the vehicle that flies it.

    radius: r_d, m. direction: sense of rotation. speed: V, m/s. max_turn_rate: limit of the vehicle, rad/s.
    """

    radius: float
    direction: Direction
    speed: float
    max_turn_rate: float

    @property
    def steady_turn_rate(self) -> TurnRate:
        """Turn rate that stays on the circle, V/r_d in the mission's sense of rotation, rad/s."""
        return TurnRate(self.direction.turn_sign * self.speed / self.radius)


@dataclass(frozen=True, slots=True)
class TurnCommand:
    """A law's answer after the vehicle's limit.

    turn_rate: what to tell the vehicle, rad/s. demanded: what the law wants it to turn at; the two differ by the
    vehicle's turn-rate gain. saturated: whether the limit cut it.
    """

    turn_rate: TurnRate
    demanded: TurnRate
    saturated: bool


@dataclass(frozen=True, slots=True)
class OwnMotion:
    """Our own motion at one moment of the local clock, without position.

    heading: psi, rad, counter-clockwise from east. turn_rate: rad/s. airspeed: m/s, None when it is not measured.
    """

    time: float
    heading: float
    turn_rate: TurnRate
    airspeed: float | None = None
