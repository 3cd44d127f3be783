"""Calibration of a ranging radio: from the range that it reports to the true one.

`circnav ranging calibrate` measures the error of a radio, the mission carries it, and this module applies its inverse
to each reading, once, before any other use. A position never changes it in flight.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

Point = tuple[float, float]
"""True and reported length of one range, m."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Error of a radio, as it was measured. A range is reported as `scale` times its length plus `bias` (m), or, if
    there are `points`, on the straight lines through them. delay: age of a range at the time of its stamp, s."""

    scale: float = 1.0
    bias: float = 0.0
    delay: float = 0.0
    points: tuple[Point, ...] = ()

    @property
    def is_set(self) -> bool:
        """True if it changes a reading."""
        return self != Calibration()

    def reported(self, true: float) -> float:
        """Return what the radio reports at a true range, m."""
        (x0, y0), slope = self._segment([x for x, _ in self.points], true)
        return y0 + slope * (true - x0)

    def true(self, reported: float) -> tuple[float, float]:
        """Return the true range (m) of a reported one, and its change per meter reported, by which noise grows."""
        (x0, y0), slope = self._segment([y for _, y in self.points], reported)
        return x0 + (reported - y0) / slope, 1 / slope

    def _segment(self, ends: Sequence[float], value: float) -> tuple[Point, float]:
        """Return the start and the slope of the line that holds for a value. The outer lines go on beyond the ends."""
        if not self.points:
            return (0.0, self.bias), self.scale
        at = min(max(bisect_right(ends, value) - 1, 0), len(self.points) - 2)
        (x0, y0), (x1, y1) = self.points[at : at + 2]
        return (x0, y0), (y1 - y0) / (x1 - x0)

    def describe(self) -> str:
        """Return the calibration in words."""
        parts = [f"{len(self.points)} points" if self.points else f"scale {self.scale:.4f}, bias {self.bias:+.2f} m"]
        parts += [f"delay {self.delay:.3f} s"] if self.delay else []
        return ", ".join(parts)


def rising(points: Sequence[Sequence[float]]) -> bool:
    """True if points are two or more, and both lengths rise from each to the next: then each reading has one range."""
    return len(points) >= 2 and all(a[0] < b[0] and a[1] < b[1] for a, b in pairwise(points))
