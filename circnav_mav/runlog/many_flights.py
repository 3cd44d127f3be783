"""Figures of many flights, one number per flight. Tracks have shape (N, B) for N samples of B
flights. SI units.

See `circnav_mav.runlog.metrics` for a single recorded flight and for the commands.
"""

from math import ceil, floor, inf, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

Batch = NDArray[Any]
"""Array with the flights as last axis."""
Z = 1.959964
"""Quantile of the normal distribution for intervals of 95 %."""
Interval = tuple[float | None, float | None]


def rms(values: Batch) -> Batch:
    """Return the root mean square over time, (B,)."""
    return np.asarray(np.sqrt(np.mean(np.asarray(values, float) ** 2, axis=0)))


def last_exit(time: Batch, r: Batch, r_d: float, within: float) -> Batch:
    """Return the time (B,) after which |r - r_d| stays below `within` (m), s. Infinite if the
    flight ends outside."""
    outside = np.abs(r - r_d) > within
    step = time[1] - time[0]
    newest = len(time) - 1 - outside[::-1].argmax(axis=0)
    settled = np.where(outside.any(axis=0), time[newest] + step, 0.0)
    return np.asarray(np.where(outside[-1], np.inf, settled))


def overshoot(r: Batch, r_d: float) -> Batch:
    """Return the overshoot (B,), m: the largest distance beyond the circle after first reaching it.
    0 if the flight did not reach or cross the circle.

    "Beyond" is inside the circle for a start outside, and outside the circle for a start inside.
    """
    outside = r[0] > r_d
    e = np.where(outside, r_d - r, r - r_d)
    reached = np.maximum.accumulate(e >= 0, axis=0)
    return np.asarray(np.where(reached, e, 0.0).max(axis=0))


def swept(angle: Batch) -> Batch:
    """Return the angle swept round the target, rad, counter-clockwise positive, (B,)."""
    unwrapped = np.unwrap(angle, axis=0)
    return np.asarray(unwrapped[-1] - unwrapped[0])


def right_way(angle: Batch, sense: Batch) -> Batch:
    """True if the flight went round in the required sense. Needs the angle round the target: ranges
    do not show the sense."""
    return np.asarray(np.sign(swept(angle)) == sense)


def went_round(angle: Batch) -> Batch:
    """True if the flight swept a quarter turn or more, (B,), as in
    `runlog.metrics.direction_of`."""
    return np.abs(swept(angle)) >= np.pi / 2


def tangent_time(
    p: Batch, psi: Batch, sense: Batch, *, V: float, r_d: float, max_turn_rate: float
) -> Batch:
    """Return the time (B,) of the shortest path from the start to the circle in still air, s. The
    path is a turn at `max_turn_rate`, then a straight tangent to the circle (Dubins). It is the
    reference for the settling time. Only for starts outside the circle.

    p: vehicle minus target position (2, B), m.
    psi: heading (B,), rad.
    sense: +1 counter-clockwise, -1 clockwise.
    """
    rho = V / max_turn_rate
    best = np.full(np.shape(psi), np.inf)
    x = p[0]
    y = p[1] * sense
    heading = psi * sense
    for side in (1.0, -1.0):
        cx = x - side * rho * np.sin(heading)
        cy = y + side * rho * np.cos(heading)
        D = np.hypot(cx, cy)
        offset = r_d - side * rho
        exists = abs(offset) <= D
        line = np.sqrt(np.maximum(D**2 - offset**2, 0.0))
        course = np.arctan2(-cy, -cx) - np.arcsin(np.minimum(offset / np.maximum(D, 1e-9), 1.0))
        turn = np.mod(side * (course - heading) + 1e-9, 2 * np.pi) - 1e-9
        length = turn * rho + line
        best = np.minimum(best, np.where(exists, length, np.inf))
    return best / V


def quantile(values: Any, share: float) -> float:
    """Return a quantile, share 0 to 1, interpolated linearly between the values. The median of an
    even number of values is the mean of the middle two. NaN without values.

    Infinity means "never". A quantile between a number and infinity is infinite.
    """
    if len(values) == 0:
        return nan
    # numpy interpolates with an infinite value to NaN, so a number of this size replaces infinity.
    never = 1e300
    found = float(np.quantile(np.minimum(values, never), share))
    return found if found < 1e200 else inf


def median_interval(ordered: Any, worlds: int) -> Interval:
    """Return the 95 % confidence interval of the median, valid for any distribution: the values at
    ranks n/2 ± z n / (2 sqrt(worlds)), rounded outwards.

    ordered: the n values, sorted.
    worlds: number of independent draws among them. Below six, even the smallest and the largest
        value enclose the median with less than 95 %: (None, None).
    """
    n = len(ordered)
    # 1 - 2/2^6 is 97 %, but 1 - 2/2^5 is only 94 %.
    if worlds < 6:
        return None, None
    half = Z * n / (2 * sqrt(worlds))
    low, high = floor(n / 2 - half), ceil(n / 2 + half)
    return float(ordered[max(low - 1, 0)]), float(ordered[min(high, n - 1)])
