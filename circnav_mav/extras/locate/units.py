"""Detects ranges in a unit other than meters by the quality of their fit."""

from dataclasses import dataclass, replace

import numpy as np

from circnav_mav.extras.locate.estimator import Knowledge, Ranges, Track, _locate
from circnav_mav.extras.locate.logs.interface import METERS, UNITS
from circnav_mav.extras.locate.place import Place, Plane

FACTORS = {**{unit: METERS[unit] for unit in UNITS}, **{f"{factor:g}": factor for factor in (0.5, 2.0, 10.0, 100.0)}}
"""Factors to try, by name: meters per unit, and factors of a radio in another mode than its driver assumes, such as
round-trip distances or cm instead of mm."""
TRIED = 120
"""Number of ranges used for each unit."""
FITS = 0.005
"""Largest noise, as a share of the range, with which meters are accepted. A wrong unit leaves more noise, except on a
perfect circle."""
BETTER = 0.5
"""Largest noise in another unit, as a share of the noise in meters, with which the other unit is reported."""
ALIKE = 1.25
"""Largest ratio of a unit's noise to the smallest noise of all units, for units that fit equally well."""
SLACK = 10.0
"""Allowed contradiction between ranges and positions, m."""


@dataclass(frozen=True, slots=True)
class BetterUnit:
    """Unit in which the ranges fit better. gain: ratio of the noise in meters to the noise in this unit, None if the
    ranges fit no place in meters."""

    unit: str
    place: Place
    gain: float | None

    def __str__(self) -> str:
        better = f" {self.gain:.1f} times better" if self.gain else ""
        way = f"in {self.unit}, not in m" if self.unit in METERS else f"multiplied by {self.unit}"
        return f"the ranges fit{better} {way}: {self.place.words()}. If this is correct, give --units {self.unit}"


def is_plausible(place: Place, known: Knowledge) -> bool:
    """True if the height of a place agrees with the prior."""
    return abs(place.up - known.up) <= 3 * known.up_sigma


def better_unit(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge, place: Place | None
) -> BetterUnit | None:  # fmt: skip
    """Return the unit in which the ranges fit much better than in meters, or None."""
    if len(ranges.r) == 0 or len(track.time) < 2:
        return None
    doubtful = place is None or place.noise > FITS * place.range_scale or place.outliers > 0.25 * place.used
    if not doubtful and place is not None and is_plausible(place, known):
        return None
    thin = ranges.take(np.arange(0, len(ranges.r), max(1, len(ranges.r) // TRIED)))
    tried = ((unit, _tried(plane, track, thin, known, factor)) for unit, factor in FACTORS.items())
    rough = {unit: found for unit, found in tried if found is not None}
    meters = rough.pop("m", None)
    if meters is not None and not is_plausible(meters, known):
        meters = None
    candidates = {unit: one.noise / FACTORS[unit] for unit, one in rough.items() if is_plausible(one, known)}
    if not candidates:
        return None
    # On a circle around the target the range is constant. Several units then fit, each with a different target height.
    # Report the unit with the most likely height.
    least = min(candidates.values())
    alike = [unit for unit, noise in candidates.items() if noise <= ALIKE * least]
    unit = min(alike, key=lambda unit: abs(rough[unit].up - known.up))
    if meters is None:
        return BetterUnit(unit, rough[unit], None)
    gain = meters.noise / max(candidates[unit], 1e-6)
    return BetterUnit(unit, rough[unit], gain) if gain > 1 / BETTER else None


def _tried(plane: Plane, track: Track, ranges: Ranges, known: Knowledge, factor: float) -> Place | None:
    """Return the place for ranges in one unit, or None if no place fits. factor: meters per unit."""
    r = ranges.r * factor
    # No place fits if the track is larger than twice the largest range, or if the range changes by more than the extent
    # of the track.
    extent = float(np.hypot(np.ptp(track.east), np.ptp(track.north)))
    if 2 * r.max() < extent / 2**0.5 - SLACK or np.ptp(np.percentile(r, [5, 95])) > extent + SLACK:
        return None
    sigma = np.full(len(r), max(0.01 * float(np.median(r)), 0.01))
    # Call `_locate` instead of `locate`, which may also estimate the scale of the radio. With an estimated scale, the
    # ranges would fit equally well in every unit.
    found = _locate(plane, track, Ranges(ranges.time, r, sigma), replace(known, sigma_known=False), None)
    return found if isinstance(found, Place) and not found.moves else None
