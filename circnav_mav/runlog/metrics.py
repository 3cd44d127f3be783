"""How good a circle was: settling, radius error, sense of rotation. SI units; arrays over samples."""

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.types import Direction

Column = NDArray[np.float64]

TOLERANCE = 0.05
"""Settled means within this fraction of the radius."""
LAST = 1 / 3
"""Fraction of the flight, at its end, over which the circle is judged."""


def settling_time(time: Column, radius: Column, desired: float, tolerance: float = TOLERANCE) -> float | None:
    """Seconds from the first sample to the last entry into the band, None if the flight ends outside it."""
    outside = np.flatnonzero(~(np.abs(radius - desired) <= tolerance * desired))
    if not len(radius) or (len(outside) and outside[-1] == len(radius) - 1):
        return None
    first_inside = outside[-1] + 1 if len(outside) else 0
    return float(time[first_inside] - time[0])


def settled(time: Column, radius: Column, desired: float) -> float | None:
    """The settling time, s, of a flight that was within the band all through the part by which its circle is judged;
    else None: one that swings out of the band on every lap has an entry that happens to be the last, and is not
    settled by it."""
    first = settling_time(time, radius, desired)
    return None if first is None or first > (1 - LAST) * (time[-1] - time[0]) else first


def last_part(time: Column, values: Column, fraction: float = LAST) -> Column:
    """The values of the last fraction of the time."""
    return values[time >= time[-1] - fraction * (time[-1] - time[0])] if len(time) else values


def mean(values: Column) -> float | None:
    """Mean, None of nothing."""
    return float(np.mean(values)) if len(values) else None


def rms_error(values: Column, desired: float) -> float | None:
    """Root mean square of (values - desired), None of nothing."""
    return float(np.sqrt(np.mean((values - desired) ** 2))) if len(values) else None


def swept_angle(north: Column, east: Column) -> float:
    """Angle swept round the origin by a track, rad, counter-clockwise positive seen from above."""
    angles = np.unwrap(np.arctan2(north, east))
    return float(angles[-1] - angles[0]) if len(angles) else 0.0


def direction_of(swept: float) -> Direction | None:
    """Sense of rotation of a swept angle, None below a quarter turn."""
    if abs(swept) < np.pi / 2:
        return None
    return Direction.COUNTERCLOCKWISE if swept > 0 else Direction.CLOCKWISE
