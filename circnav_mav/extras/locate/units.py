"""Search for the likely unit of ranges with a scale far from 1. Ranges in feet, for example, are
3.28 times too long for the track."""

from dataclasses import replace

import numpy as np

from circnav_mav.extras.locate.estimator import AT_REST, Knowledge, Ranges, Track, locate
from circnav_mav.extras.locate.logs.interface import METERS
from circnav_mav.extras.locate.place import Place, Plane


def is_plausible(place: Place, known: Knowledge) -> bool:
    """True if the height of a place agrees with the prior."""
    return abs(place.up - known.up) <= 3 * known.up_sigma


def likely_unit(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge, place: Place | None
) -> str | None:
    """Return the unit in which the ranges fit the track much better than in meters, or None.

    place: place found with ranges in meters, None if they fit no place.
    """
    if place is not None:
        if _fits_well(place, known):
            return None
        # If the scale error is small, return a unit only if it explains the scale error. Ranges
        # that a radio measures 7 % too long also fit better in yards (9 % longer) than in meters.
        if place.scale_found and abs(place.scale) < 0.15:
            return _unit_of_scale(place)
    found = _fits(plane, track, ranges, known)
    if not found:
        return None
    # On a circle around the target the range is constant. Several units then fit, each with a
    # different target height. Report the unit with the most likely height.
    least = min(map(_noise, found.values()))
    # 1.25: largest ratio of a unit's noise to the smallest noise of all units, for units that fit
    # equally well.
    alike = [unit for unit, fit in found.items() if _noise(fit) <= 1.25 * least]
    unit = min(alike, key=lambda one: abs(found[one].up - known.up))
    # 2.0: largest ratio of the noise in meters to the noise in another unit with which the ranges
    # are taken as meters.
    if "m" in found and _noise(found["m"]) <= 2.0 * _noise(found[unit]):
        return None
    return unit


def _fits_well(place: Place, known: Knowledge) -> bool:
    """True if the ranges are probably in meters."""
    # 0.005: largest noise with which meters are accepted, as a share of the range. A wrong unit
    # leaves more noise, except on a perfect circle.
    few_outliers = place.outliers < place.used / 4
    return is_plausible(place, known) and _noise(place) <= 0.005 and few_outliers


def _unit_of_scale(place: Place) -> str | None:
    """Return the unit that explains the scale of a place, or None."""
    scales = {unit: (1 + place.scale) * meters for unit, meters in METERS.items()}
    return next(
        (unit for unit, scale in scales.items() if abs(scale - 1) < 3 * place.scale_sigma), None
    )


def _fits(plane: Plane, track: Track, ranges: Ranges, known: Knowledge) -> dict[str, Place]:
    """Return the plausible places of the ranges in each unit."""
    thin = ranges.take(np.arange(0, len(ranges.r), max(1, len(ranges.r) // 120)))
    # With a free scale, the ranges would fit in every unit.
    scaled = replace(known, sigma_known=False)
    found: dict[str, Place] = {}
    for unit, meters in METERS.items():
        r = thin.r * meters
        sigma = np.full(len(r), max(0.01 * float(np.median(r)), 0.01)) if len(r) else r
        fit = locate(plane, track, Ranges(thin.time, r, sigma), scaled, AT_REST[:1])
        if isinstance(fit, Place) and is_plausible(fit, known):
            found[unit] = fit
    return found


def _noise(place: Place) -> float:
    """Return the noise of the ranges as a share of the median range."""
    return place.noise / place.range_scale
