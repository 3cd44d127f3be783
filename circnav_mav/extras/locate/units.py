"""Finds ranges in another unit than meters by how well they fit the track."""

from dataclasses import dataclass, replace

import numpy as np

from circnav_mav.extras.locate.estimator import Knowledge, Ranges, Track, locate
from circnav_mav.extras.locate.logs.interface import METERS, UNITS
from circnav_mav.extras.locate.place import Place, Plane

TRIED = 120
"""Ranges that are tried in each unit."""
FITS = 0.005
"""Noise over range up to which the unit is not questioned: the wrong one leaves more, but on a perfect circle."""
BETTER = 0.5
"""Noise in the better unit, as a share of the noise in meters, from which it is reported."""
SLACK = 10.0
"""What ranges and positions may contradict each other by, m."""


@dataclass(frozen=True, slots=True)
class BetterUnit:
    """A unit in which the ranges fit better. gain: how many times less noise, None if they fit no place in meters."""

    unit: str
    place: Place
    gain: float | None


def is_plausible(place: Place, known: Knowledge) -> bool:
    """True if the height of a place is one that was expected."""
    return abs(place.up - known.up) <= 3 * known.up_sigma


def better_unit(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge, place: Place | None
) -> BetterUnit | None:  # fmt: skip
    """Return the unit in which the ranges fit by far better than in meters, None if there is none."""
    if len(ranges.r) == 0 or len(track.time) < 2:
        return None
    doubtful = place is None or place.noise > FITS * place.range_scale or place.outliers > 0.25 * place.used
    if not doubtful and place is not None and is_plausible(place, known):
        return None
    thin = ranges.take(np.arange(0, len(ranges.r), max(1, len(ranges.r) // TRIED)))
    rough = {unit: found for unit in UNITS if (found := _tried(plane, track, thin, known, METERS[unit])) is not None}
    meters = rough.pop("m", None)
    if meters is not None and not is_plausible(meters, known):
        meters = None
    candidates = {unit: one.noise / METERS[unit] for unit, one in rough.items() if is_plausible(one, known)}
    if not candidates:
        return None
    unit = min(candidates, key=candidates.__getitem__)
    if meters is None:
        return BetterUnit(unit, rough[unit], None)
    gain = meters.noise / max(candidates[unit], 1e-6)
    return BetterUnit(unit, rough[unit], gain) if gain > 1 / BETTER else None


def _tried(plane: Plane, track: Track, ranges: Ranges, known: Knowledge, factor: float) -> Place | None:
    """Return the place in one unit, None if there is none."""
    r = ranges.r * factor
    # No place is at these distances if the whole track is larger than twice the largest range, or if the range changes
    # by more than the track is long.
    extent = float(np.hypot(np.ptp(track.east), np.ptp(track.north)))
    if 2 * r.max() < extent / 2**0.5 - SLACK or np.ptp(np.percentile(r, [5, 95])) > extent + SLACK:
        return None
    sigma = np.full(len(r), max(0.01 * float(np.median(r)), 0.01))
    found = locate(plane, track, Ranges(ranges.time, r, sigma), replace(known, sigma_known=False))
    return found if isinstance(found, Place) and not found.moves else None
