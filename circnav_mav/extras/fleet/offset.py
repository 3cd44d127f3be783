"""Difference of two members' phases that is caused by their compasses.

A heading error turns both the bearing to the beacon and the estimated drift of a member by the same
angle. All members are in the same true drift, so the directions of two reported drifts differ by
the difference of the heading errors. The measured distance of two members gives their true gap, and
with it the same difference, also in calm air.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import acos, atan2, exp, hypot, inf, radians, sin, sqrt

from circnav_mav.extras.fleet.phase import Drift, PhaseMap, wrapped

PRIOR = radians(3.0)
"""Standard deviation of the phase difference of two members caused by their compasses, rad."""
MOST_BY_DRIFT = radians(10.0)
"""Limit of the offset computed from the directions of two drifts, rad. Gusts and wind shear between
the height layers also change these directions."""
MOST_BY_RANGE = radians(30.0)
"""Largest offset computed from the distance of two members, rad. A larger one is discarded: the
other member was then assumed on the wrong side."""
LEAST_DRIFT = 1.0
"""Smallest reported drift from which an offset is computed, m/s. The direction of a slower drift is
too uncertain."""
MEMORY = 60.0
"""Time constant with which old observations lose weight, s."""
CORRELATION = 15.0
"""Correlation time of the error of an estimated drift, s."""


@dataclass(slots=True)
class PhaseOffset:
    """Filter of the offset: a weighted mean of observations and of the prior 0."""

    _sum: float = 0.0
    _weight: float = 0.0

    @property
    def value(self) -> float:
        """Offset, rad, to be added to the phase of the other member."""
        return self._sum / (self._weight + 1 / PRIOR**2)

    def observe(self, seen: Iterable[tuple[float, float]], dt: float) -> None:
        """Add observations of the offset, each with its standard deviation, rad. dt: time since the
        previous observations, s."""
        keep = exp(-dt / MEMORY)
        self._sum *= keep
        self._weight *= keep
        for offset, sigma in seen:
            # 0.01: smallest standard deviation of a direction, rad. A reported covariance may be
            # too small.
            weight = dt / CORRELATION / max(sigma, 0.01) ** 2
            self._sum += weight * offset
            self._weight += weight


def offset_by_drift(own: Drift, other: Drift, sense: int, rate: float) -> tuple[float, float]:
    """Return the offset computed from the directions of two drifts, and its standard deviation,
    rad.

    rate: derivative of the phase with respect to the angle at angle 0, from which both members
        count their phases.
    """
    if min(hypot(*own.mean), hypot(*other.mean)) < LEAST_DRIFT:
        return 0.0, inf
    turn = atan2(*other.mean[::-1]) - atan2(*own.mean[::-1])
    sigma = hypot(_direction_sigma(own), _direction_sigma(other))
    offset = -sense * wrapped(turn) * rate
    return min(max(offset, -MOST_BY_DRIFT), MOST_BY_DRIFT), sigma * rate


def offset_by_range(
    distance: float,
    height: float,
    radii: tuple[float, float],
    angle: float,
    ahead: float,
    phase: float,
    phases: PhaseMap,
) -> tuple[float, float]:
    """Return the offset computed from the range to another member, and its standard deviation, rad.

    distance: measured distance of the members, m.
    height: difference of the members' heights, m.
    radii: distances of both members from the beacon, m.
    angle: position of this member on its circle, rad.
    ahead: reported phase of the other member relative to this one, rad; only its sign is used.
    phase: reported phase of the other member, rad.
    phases: phase of this member as a function of its angle.
    """
    one, other = radii
    flat = sqrt(max(distance**2 - height**2, 0.0))
    cosine = (one**2 + other**2 - flat**2) / (2 * one * other)
    # If the members are on opposite sides of the circle, or one is above the other, the distance
    # hardly depends on the gap.
    if not -0.9 < cosine < 0.9:
        return 0.0, inf
    gap = acos(cosine)
    found, rate = phases.at(angle + (gap if ahead >= 0 else -gap))
    offset = wrapped(found - phase)
    # 1.0: standard deviation of the distance and of the radii together, m.
    sigma = 1.0 * distance / (one * other * sin(gap)) * rate
    return (offset, sigma) if abs(offset) <= MOST_BY_RANGE else (0.0, inf)


def _direction_sigma(drift: Drift) -> float:
    """Return the standard deviation of the direction of a drift, rad."""
    east, north = drift.mean
    ee, en, nn = drift.covariance
    across = (north**2 * ee - 2 * north * east * en + east**2 * nn) / (east**2 + north**2)
    return sqrt(max(across, 0.0) / (east**2 + north**2))
