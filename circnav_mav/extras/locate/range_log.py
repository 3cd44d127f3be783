"""Input of the estimator from a log: the positions of one vehicle and the ranges measured on
board."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan

import numpy as np

from circnav_mav.extras.locate.estimator import Ranges, Track
from circnav_mav.extras.locate.place import Plane
from circnav_mav.mav.ranging.calibration import Calibration
from circnav_mav.runlog.run_folder import RunError

Position = tuple[float, float, float, float]
"""Time (s), latitude, longitude (degrees), altitude (m, NaN if unknown)."""
Range = tuple[float, float, float]
"""Time (s), slant range (m), standard deviation (m, NaN if unknown)."""


class EmptyLogError(RunError):
    """The log has no positions or no ranges."""


@dataclass(slots=True)
class RangeLog:
    """One vehicle of a log.

    ranges: ranges by tag.
    vehicle: name of the vehicle in the log, empty if the log has only one vehicle.
    notes: assumptions and removed values, one line each.
    names: other values in the log that may be ranges, by the name that --range-name takes.
    """

    positions: list[Position] = field(default_factory=list)
    ranges: dict[str, list[Range]] = field(default_factory=dict)
    vehicle: str = ""
    notes: list[str] = field(default_factory=list)
    names: set[str] = field(default_factory=set)

    def add(self, tag: str, time: float, slant: float, sigma: float = nan) -> None:
        """Add a range."""
        self.ranges.setdefault(tag, []).append((time, slant, sigma))

    def note(self, line: str) -> None:
        """Add a note once."""
        if line not in self.notes:
            self.notes.append(line)

    def plane(self) -> Plane:
        """Return the tangent plane at the first position."""
        return Plane(*self.positions[0][1:3])

    def track(self, plane: Plane) -> Track:
        """Return the positions in order of time. Missing altitudes are interpolated, or 0 if all
        are missing."""
        time, latitude, longitude, up = np.array(sorted(self.positions)).T
        known = np.isfinite(up)
        up = np.interp(time, time[known], up[known]) if known.any() else np.zeros_like(up)
        return Track(time, *plane.to_metres(latitude, longitude), up)

    def of(self, tag: str, sigma: float | None) -> tuple[Ranges, bool]:
        """Return the ranges of a tag, and True if their sigmas are known.

        sigma: standard deviation for ranges without one in the log, m, or None if unknown.
        """
        table = np.array(sorted(self.ranges[tag]))
        known = np.isfinite(table[:, 2])
        filled = np.where(known, table[:, 2], 1.0 if sigma is None else sigma)
        return Ranges(table[:, 0], table[:, 1], filled), bool(known.all() or sigma is not None)


def corrected(ranges: Ranges, calibration: Calibration) -> Ranges:
    """Return the reported ranges corrected as in flight: true lengths, at the times of
    measurement."""
    if not calibration.is_set:
        return ranges
    true, slope = np.array([calibration.true(reported) for reported in ranges.r]).reshape(-1, 2).T
    kept = true > 0
    return Ranges(ranges.time[kept] - calibration.delay, true[kept], (ranges.sigma * slope)[kept])


def tracks(logs: Sequence[RangeLog], most: int = 5000) -> list[list[tuple[float, float]]]:
    """Return the track (latitude, longitude) of each vehicle, thinned to about `most` points."""
    lines = (
        [(latitude, longitude) for _, latitude, longitude, _ in sorted(log.positions)]
        for log in logs
    )
    return [line[:: max(1, len(line) // most)] for line in lines]
