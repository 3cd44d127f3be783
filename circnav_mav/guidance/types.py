"""Value types of the guidance: immutable, in SI units, in the paper's frame.

Frame: x right, y up, angles and turn rates counter-clockwise positive seen from above.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import atan2, hypot, pi
from typing import NamedTuple, NewType

SAME_TIME = 1e-6
"""Times are stored in microseconds. Smaller differences (s) are rounding error."""
GRAVITY = 9.80665
"""Standard gravity, m/s^2."""
LONGEST_REPORT_GAP = 0.5
"""Gap between two reports of own motion, s, after which filters on them restart."""
TurnRate = NewType("TurnRate", float)
"""Turn rate in rad/s."""


class Direction(Enum):
    """Sense of rotation round the target, seen from above."""

    CLOCKWISE = "clockwise"
    COUNTERCLOCKWISE = "counterclockwise"

    @property
    def turn_sign(self) -> int:
        """Sign of the steady turn rate: +1 counter-clockwise, -1 clockwise."""
        return 1 if self is Direction.COUNTERCLOCKWISE else -1


class RangeSample(NamedTuple):
    """One measured range.

    stamp: time of the measurement on the sensor's clock, s (any epoch; only differences matter).
    time: the same moment on the local clock, s.
    r: horizontal distance to the target, m.
    sigma: its standard deviation, m.
    source: name of the sensor, for the log.
    r_dot: Doppler range rate, m/s, or None.
    r_dot_sigma: its standard deviation, m/s.
    """

    stamp: float
    time: float
    r: float
    sigma: float
    source: str = ""
    r_dot: float | None = None
    r_dot_sigma: float = 0.5

    @property
    def rate(self) -> "RateSample | None":
        """Range rate of the same moment, or None."""
        return (
            None
            if self.r_dot is None
            else RateSample(self.stamp, self.time, self.r_dot, self.r_dot_sigma)
        )


class RateSample(NamedTuple):
    """One measured horizontal range rate, m/s, positive away from the target. The other fields are
    those of RangeSample."""

    stamp: float
    time: float
    r_dot: float
    sigma: float


class IntegratedAcceleration(NamedTuple):
    """Integral (x, y) of the measured horizontal acceleration, m/s, since the time `since`, s."""

    x: float
    y: float
    since: float


class OwnMotion(NamedTuple):
    """Motion that the autopilot measures without GPS.

    time: local clock, s.
    heading: direction of motion through the air, rad. It differs from the nose by a copter's crab
        angle.
    turn_rate: of the nose, rad/s (not the body's z rate).
    airspeed: as measured, m/s. In a flight of a plane: the indicated airspeed, converted to true
        airspeed if the altitude is known.
    bank_turn: turn rate of the coordinated turn at this bank, rad/s; None for vehicles that do not
        bank to turn.
    acceleration: integrated accelerometer measurement, or None.
    """

    time: float
    heading: float
    turn_rate: float
    airspeed: float
    bank_turn: float | None = None
    acceleration: IntegratedAcceleration | None = None


class RelativeMotion(NamedTuple):
    """Position relative to the target, and drift, in compass axes.

    x, y: vehicle minus target, m.
    sigma: standard deviation of the position, m.
    drift_x, drift_y: wind minus target velocity, m/s.
    heading, turn_rate: own motion at this moment, rad and rad/s.
    airspeed: true, m/s.
    scale: true over measured airspeed.
    trusted: True if the estimate may steer.
    trial: number of the hypothesis during acquisition, else None.
    drift_remembered: True if acquisition started with an earlier drift estimate.
    acceleration_weight: weight of the measured accelerations, 0 to 1.
    drift_covariance: xx, xy, yy of the steady part of the drift, (m/s)^2, or None.
    position_covariance: xx, xy, yy of the position, m^2, or None. The benchmark computes the NEES
        of a user-defined estimator from it.
    """

    x: float
    y: float
    sigma: float
    drift_x: float
    drift_y: float
    heading: float
    turn_rate: float
    airspeed: float
    scale: float
    trusted: bool
    trial: int | None = None
    drift_remembered: bool = False
    acceleration_weight: float = 0.0
    drift_covariance: tuple[float, float, float] | None = None
    position_covariance: tuple[float, float, float] | None = None

    @property
    def eta(self) -> float:
        """Angle from the heading to the line of sight, rad in [-pi, pi), the target to the left
        positive."""
        return (self.bearing - self.heading + pi) % (2 * pi) - pi

    @property
    def bearing(self) -> float:
        """Direction from the vehicle to the target, rad."""
        return atan2(-self.y, -self.x)

    @property
    def drift(self) -> float:
        """Speed of the drift, m/s."""
        return hypot(self.drift_x, self.drift_y)


class RangeEstimate(NamedTuple):
    """Output of an estimator at one moment of the local clock.

    r, r_dot: range (m) and range rate (m/s).
    r_sigma, r_dot_sigma: their standard deviations.
    eta: angle from the heading to the line of sight (target to the left positive), rad.
    relative: the whole relative motion.
    """

    time: float
    r: float
    r_dot: float
    r_sigma: float
    r_dot_sigma: float
    eta: float | None = None
    relative: RelativeMotion | None = None


OwnLaw = Callable[[RangeEstimate], float]
"""User-defined law: from the estimate to a turn rate, rad/s, counter-clockwise positive."""


@dataclass(frozen=True, slots=True)
class Orbit:
    """The circle to fly and the vehicle that flies it.

    radius: r_d, m.
    direction: sense of rotation.
    speed: V, m/s.
    max_turn_rate: limit of the vehicle, rad/s.
    """

    radius: float
    direction: Direction
    speed: float
    max_turn_rate: float

    @property
    def label(self) -> str:
        """Radius and direction, short enough for a STATUSTEXT."""
        return f"{self.radius:g} m {self.direction.value}"

    def words(self) -> str:
        """Return a human-readable description."""
        return f"{self.radius:g} m {self.direction.value} at {self.speed:g} m/s"

    @property
    def steady_turn_rate(self) -> TurnRate:
        """Turn rate that stays on the circle, V/r_d in the mission's sense of rotation, rad/s."""
        return TurnRate(self.direction.turn_sign * self.speed / self.radius)


class TurnCommand(NamedTuple):
    """Output of a law, limited to the vehicle's turn rate.

    turn_rate: to command, rad/s.
    demanded: turn rate that the law demands, rad/s, before handover, limit and turn-gain
        correction.
    saturated: True if turn_rate was limited.
    flies, why: active law and human-readable reason; empty if there is only one law.
    """

    turn_rate: TurnRate
    demanded: TurnRate
    saturated: bool
    flies: str = ""
    why: str = ""
