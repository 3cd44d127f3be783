"""The circles of a mission, one after the other, and a slow integral that holds their mean radius."""

from math import inf, pi

from circnav_mav.guidance.step import LawChoice, steering
from circnav_mav.guidance.types import Orbit, RangeEstimate, TurnRate

LAPS = 1.25
"""Turned on a circle before the next one begins: one lap to survey by, and the way into the band of NEAR."""
NEAR = 0.1
"""Radius error, in units of the radius, within which a turn counts for the circle."""
LONGEST_STEP = 0.2
"""Most time, s, that counts between two steps: what was turned in a gap is not known."""
TRIM_NEAR = 0.2
"""The radius trim grows only within this fraction of the radius, where the law is linear, and while nothing saturates;
farther off it only unwinds, for what it holds may be what keeps the vehicle there."""
MOST_TRIM = 0.15
"""Bound of the trim, as a fraction of the radius."""


class Circles:
    """orbit: of the circle that is flown now. steer: the law on it. A second radius tells the survey a height from a
    range bias. When it begins is decided by range and turn alone, as everything that steers."""

    def __init__(self, first: tuple[Orbit, LawChoice], *later: tuple[Orbit, LawChoice]) -> None:
        """Raises ValueError where the radius correction does not exist for a gain."""
        self._later = [(orbit, steering(orbit, law)) for orbit, law in later]
        self.orbit, self.steer = first[0], steering(*first)
        self._turned, self._time = 0.0, inf

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


def next_trim(trim: float, *, rate: float, r: float, r_d: float, step: float, saturated: bool) -> float:
    """The trim (m), added to the radius that the law is fed, after `step` seconds at range r, growing against the error
    with `rate` (1/s).

    A law's radius rests on V and on the turn rate being what they are told to be; a vehicle whose true airspeed is 6 %
    above the indicated one flies 2 m outside a circle of 150 m.
    """
    after = trim - rate * (r - r_d) * step
    if saturated:
        return trim
    if abs(r - r_d) > TRIM_NEAR * r_d:
        unwound = after if trim * after > 0 else 0.0
        return unwound if abs(unwound) < abs(trim) else trim
    return min(max(after, -MOST_TRIM * r_d), MOST_TRIM * r_d)
