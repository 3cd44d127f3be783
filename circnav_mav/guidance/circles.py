"""The circles of a mission, one after the other: a second radius tells the survey a height from a range bias.

When the next one begins is decided by range and turn alone, as everything that steers.
"""

from math import pi

from circnav_mav.guidance.step import LawChoice, steering
from circnav_mav.guidance.types import Orbit, RangeEstimate, TurnRate

LAPS = 1.25
"""Turned on a circle before the next one begins: one lap to survey by, and the way into the band of NEAR."""
NEAR = 0.1
"""Radius error, in units of the radius, within which a turn counts for the circle."""
LONGEST_STEP = 0.2
"""Most time, s, that counts between two steps: what was turned in a gap is not known."""


class Circles:
    """orbit: of the circle that is flown now. steer: the law on it."""

    def __init__(self, first: tuple[Orbit, LawChoice], *later: tuple[Orbit, LawChoice]) -> None:
        """Raises ValueError where the radius correction does not exist for a gain."""
        self._later = [(orbit, steering(orbit, law)) for orbit, law in later]
        self.orbit, self.steer = first[0], steering(*first)
        self._turned, self._time = 0.0, float("inf")

    def turned(self, estimate: RangeEstimate, turn_rate: TurnRate) -> bool:
        """Count a steered step. turn_rate: of the vehicle. Tells whether the next circle begins."""
        orbit, dt = self.orbit, min(max(estimate.time - self._time, 0.0), LONGEST_STEP)
        self._time = estimate.time
        if abs(estimate.r - orbit.radius) <= NEAR * orbit.radius:
            self._turned += orbit.direction.turn_sign * turn_rate * dt
        complete = bool(self._later) and self._turned >= LAPS * 2 * pi
        if complete:
            self._turned, (self.orbit, self.steer) = 0.0, self._later.pop(0)
        return complete
