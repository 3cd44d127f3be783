"""Temporal phase: progress of a vehicle on its lap, measured in time. Its rate is constant in any
wind.

A vehicle with constant airspeed is slow over the ground against the drift and fast along it.
Members that are evenly spaced in time are therefore unevenly spaced in angle. Angles are counted
from east in the sense of rotation, so that every circle is counter-clockwise here.
"""

from dataclasses import dataclass
from math import atan2, hypot, pi
from typing import NamedTuple

import numpy as np

LAP = 2 * pi
"""Phase of a full lap, rad."""
POINTS = 120
"""Number of table points per lap. Linear interpolation between them is accurate to 0.01 deg."""

Pair = tuple[float, float]


class Drift(NamedTuple):
    """Estimate of wind minus target velocity.

    mean: east and north, m/s.
    covariance: ee, en and nn, (m/s)^2.
    """

    mean: Pair
    covariance: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class PhaseMap:
    """Map from the angle on the circle to the temporal phase, for one drift.

    phase: phase at the table points, rad.
    rate: derivative of the phase with respect to the angle at the table points.
    lap_time: duration of a lap of radius 1 m, s.
    """

    rate: np.ndarray
    phase: np.ndarray
    lap_time: float

    @classmethod
    def of(cls, airspeed: float, drift: Pair, sense: int) -> "PhaseMap":
        """Return the map at an airspeed (m/s) and drift. sense: +1 counter-clockwise, -1
        clockwise."""
        east, north = drift[0], sense * drift[1]
        # 0.9: largest drift of the map, as a share of the airspeed. In a faster drift no circle can
        # be flown.
        excess = hypot(east, north) / (0.9 * airspeed)
        if excess > 1:
            east, north = east / excess, north / excess
        angle = np.linspace(0.0, LAP, POINTS + 1)
        along = -east * np.sin(angle) + north * np.cos(angle)
        across = east * np.cos(angle) + north * np.sin(angle)
        slowness = 1 / (along + np.sqrt(airspeed**2 - across**2))
        passed = np.concatenate([[0.0], np.cumsum((slowness[1:] + slowness[:-1]) / 2)]) * (
            LAP / POINTS
        )
        return cls(slowness * LAP / passed[-1], passed * LAP / passed[-1], float(passed[-1]))

    def at(self, angle: float) -> tuple[float, float]:
        """Return the temporal phase at an angle, rad, and its derivative with respect to the
        angle."""
        place = angle % LAP * (POINTS / LAP)
        index = min(int(place), POINTS - 1)
        share = place - index
        phase = self.phase[index] + share * (self.phase[index + 1] - self.phase[index])
        rate = self.rate[index] + share * (self.rate[index + 1] - self.rate[index])
        return float(phase) % LAP, float(rate)

    def angle(self, phase: float) -> float:
        """Return the angle on the circle at a temporal phase, rad: the inverse of `at`."""
        return float(np.interp(phase % LAP, self.phase, np.linspace(0.0, LAP, POINTS + 1)))


def circle_angle(x: float, y: float, sense: int) -> float:
    """Return the angle on the circle, rad, in the sense of rotation. x, y: position east and north
    of the target, m."""
    return atan2(sense * y, x) % LAP


def wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi)."""
    return (angle + pi) % LAP - pi
