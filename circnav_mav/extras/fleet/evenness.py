"""Evenness of a ring over time, from the phases of its members."""

from collections.abc import Collection
from math import nan, radians

import numpy as np
from numpy.typing import ArrayLike, NDArray

from circnav_mav.extras.fleet.law import gaps
from circnav_mav.extras.fleet.phase import LAP

EVEN = radians(5.0)
"""Largest gap error of an even fleet, rad."""
LASTS = 20.0
"""Time, s, for which all gap errors must stay within EVEN."""

Array = NDArray[np.float64]


def gap_error(phases: Collection[float]) -> float:
    """Return the largest gap error of a ring, rad; nan for fewer than two members."""
    if len(phases) < 2:
        return nan
    return max(abs(gap - LAP / len(phases)) for gap in gaps(phases))


def even_from(time: ArrayLike, errors: ArrayLike, since: float) -> float | None:
    """Return the first time, s, not before `since`, from which all gap errors stay within EVEN for
    LASTS; or None.

    errors: gap errors at these times, rad. The fleet is uneven where the error is nan.
    """
    times = np.asarray(time, float)
    good = np.asarray(errors, float) <= EVEN
    if not len(times):
        return None
    # Time of the next uneven sample, or the end of the record.
    uneven = np.where(good, times[-1], times)
    until = np.minimum.accumulate(uneven[::-1])[::-1]
    found = np.flatnonzero((times >= since) & good & (until - times >= LASTS))
    return float(times[found[0]]) if len(found) else None


def rms(values: ArrayLike) -> float | None:
    """Return the root mean square of the finite values, or None if no value is finite."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else None
