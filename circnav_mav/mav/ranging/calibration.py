"""Calibration of a ranging radio: conversion of the reported range to the true range.

`circnav ranging calibrate` measures the error of a radio, and the mission file contains this error.
This module removes the error once from each reading, before any other use. The calibration never
changes in flight.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

Point = tuple[float, float]
"""True and reported range, m."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Measured error of a radio.

    reported = `scale` * true + `bias` (m). If `points` are given, straight lines through them
    replace `scale` and `bias`. delay: age of a range at the time of its stamp, s.
    """

    scale: float = 1.0
    bias: float = 0.0
    delay: float = 0.0
    points: tuple[Point, ...] = ()

    @property
    def is_set(self) -> bool:
        """True if the calibration changes a reading."""
        return self != Calibration()

    def reported(self, true: float) -> float:
        """Return the reported range at a true range, m."""
        (x0, y0), slope = self._segment([x for x, _ in self.points], true)
        return y0 + slope * (true - x0)

    def true(self, reported: float) -> tuple[float, float]:
        """Return the true range for a reported range, m, and the slope d(true)/d(reported), which
        scales the noise."""
        (x0, y0), slope = self._segment([y for _, y in self.points], reported)
        return x0 + (reported - y0) / slope, 1 / slope

    def _segment(self, ends: Sequence[float], value: float) -> tuple[Point, float]:
        """Return the start and the slope of the line for a value. The first and the last line
        extend beyond the points."""
        if not self.points:
            return (0.0, self.bias), self.scale
        at = min(max(bisect_right(ends, value) - 1, 0), len(self.points) - 2)
        (x0, y0), (x1, y1) = self.points[at : at + 2]
        return (x0, y0), (y1 - y0) / (x1 - x0)

    def describe(self) -> str:
        """Return the calibration, human-readable."""
        parts = [
            f"{len(self.points)} points"
            if self.points
            else f"scale {self.scale:.4f}, bias {self.bias:+.2f} m"
        ]
        parts += [f"delay {self.delay:.3f} s"] if self.delay else []
        return ", ".join(parts)


def rising(points: Sequence[Sequence[float]]) -> bool:
    """True if there are at least two points, and true and reported range increase from each point
    to the next.

    Then each reported range belongs to a single true range.
    """
    return len(points) >= 2 and all(a[0] < b[0] and a[1] < b[1] for a, b in pairwise(points))
