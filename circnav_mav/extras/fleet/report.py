"""Report that every fleet member sends."""

from dataclasses import dataclass
from enum import IntEnum
from math import tau


class State(IntEnum):
    """State of a member: phase unknown, phase known, on the circle, about to leave."""

    SEARCH = 0
    PHASE_KNOWN = 1
    ON_CIRCLE = 2
    LEAVING = 3

    @property
    def words(self) -> str:
        """Human-readable name."""
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True, slots=True)
class MemberReport:
    """State of one member at one time.

    member: id within the fleet, 1 to 255.
    stamp: Unix time of the sender, s; in lockstep the simulated time.
    phase: temporal phase in the sense of rotation, rad, 0 to 2 pi.
    phase_sigma: standard deviation of the phase, rad.
    lap_period: duration of a lap, s.
    radius: commanded radius, m.
    height: height above the target, m, nan if unknown.
    sense: +1 counter-clockwise, -1 clockwise.
    drift: estimated drift, east and north, m/s.
    drift_covariance: ee, en, nn, (m/s)^2.
    """

    member: int
    state: State
    stamp: float
    phase: float
    phase_sigma: float
    lap_period: float
    radius: float
    height: float
    sense: int
    drift: tuple[float, float]
    drift_covariance: tuple[float, float, float]

    def phase_at(self, stamp: float) -> float:
        """Return the phase extrapolated to another time, rad, not wrapped. The phase rate is
        constant in any wind."""
        return self.phase + tau * (stamp - self.stamp) / self.lap_period
