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

PRIOR = radians(7.0)
"""Standard deviation of the phase difference of two members caused by their compasses, rad: two
compass errors of 5 deg."""
MOST = 3 * PRIOR
"""Largest offset that is used, rad. A larger one has another cause: wind shear between the height
layers, or a member that was assumed on the wrong side of the circle."""
LEAST_DRIFT = 1.0
"""Smallest reported drift from which an offset is computed, m/s. The direction of a slower drift is
too uncertain."""
MEMORY = 60.0
"""Time constant with which old observations lose weight, s."""
CORRELATION = 15.0
"""Correlation time of the error of an estimated drift, s."""


@dataclass(slots=True)
class PhaseOffset:
    """Filter of the offset: a weighted mean of observations and of the prior 0.

    stamp: time of the newest observations, s.
    """

    stamp: float
    _sum: float = 0.0
    _weight: float = 0.0

    @property
    def value(self) -> float:
        """Offset, rad, to be added to the phase of the other member."""
        return self._sum * self.sigma**2

    @property
    def sigma(self) -> float:
        """Standard deviation of the offset, rad."""
        return 1 / sqrt(self._weight + 1 / PRIOR**2)

    def observe(self, seen: Iterable[tuple[float, float]], stamp: float) -> None:
        """Add observations of the offset, each with its standard deviation, rad."""
        dt = min(max(stamp - self.stamp, 0.0), 1.0)
        self.stamp = stamp
        keep = exp(-dt / MEMORY)
        self._sum *= keep
        self._weight *= keep
        for offset, sigma in seen:
            if abs(offset) > MOST:
                continue
            # 0.01: smallest standard deviation of a direction, rad. A reported covariance may be
            # too small.
            weight = dt / CORRELATION / max(sigma, 0.01) ** 2
            self._sum += weight * offset
            self._weight += weight


def offset_by_drift(own: Drift, other: Drift, sense: int, phases: PhaseMap) -> tuple[float, float]:
    """Return the offset computed from the directions of two drifts, and its standard deviation,
    rad.

    phases: phase of this member as a function of its angle. Each member counts its angle from the
        east of its own compass, so the offset is the phase at the angle between the two easts.
    """
    if min(hypot(*own.mean), hypot(*other.mean)) < LEAST_DRIFT:
        return 0.0, inf
    turn = atan2(*other.mean[::-1]) - atan2(*own.mean[::-1])
    sigma = hypot(_direction_sigma(own), _direction_sigma(other))
    offset, rate = phases.at(-sense * turn)
    return wrapped(offset), sigma * rate


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
    # 1.0: standard deviation of the distance and of the radii together, m.
    sigma = 1.0 * distance / (one * other * sin(gap)) * rate
    return wrapped(found - phase), sigma


def _direction_sigma(drift: Drift) -> float:
    """Return the standard deviation of the direction of a drift, rad."""
    east, north = drift.mean
    ee, en, nn = drift.covariance
    across = (north**2 * ee - 2 * north * east * en + east**2 * nn) / (east**2 + north**2)
    return sqrt(max(across, 0.0) / (east**2 + north**2))
