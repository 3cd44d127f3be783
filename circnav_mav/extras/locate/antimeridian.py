"""Cuts lines and areas at 180 degrees of longitude, as RFC 7946 (GeoJSON), section 3.1.9, requires."""

from collections.abc import Sequence
from itertools import pairwise

Point = list[float]
"""Longitude and latitude, degrees."""
TURN, EDGE = 360.0, 180.0
"""Full circle and longitude of the antimeridian, degrees."""


def cut_line(points: Sequence[Point]) -> list[list[Point]]:
    """Return the parts of a line on either side of the antimeridian."""
    parts: list[list[Point]] = [[points[0]]]
    for before, after in pairwise(points):
        step = after[0] - before[0]
        if abs(step) > EDGE:
            edge = EDGE if step < 0 else -EDGE
            latitude = _at(before, [after[0] + 2 * edge, after[1]], edge)
            parts[-1].append([edge, latitude])
            parts.append([[-edge, latitude]])
        parts[-1].append(after)
    return [part for part in parts if len(part) > 1 and any(point != part[0] for point in part)]


def cut_ring(ring: Sequence[Point]) -> list[list[Point]]:
    """Return the parts of a small convex area as closed rings."""
    unrolled = [[_near(longitude, ring[0][0]), latitude] for longitude, latitude in ring]
    for edge in (EDGE, -EDGE):
        if min(point[0] for point in unrolled) < edge < max(point[0] for point in unrolled):
            west, east = (_clip(unrolled[:-1], edge, side) for side in (-1, 1))
            sides = (west, edge - 1), (east, edge + 1)
            return [[[_wrapped(x, middle), y] for x, y in part] for part, middle in sides]
    return [list(ring)]


def _clip(corners: Sequence[Point], edge: float, side: int) -> list[Point]:
    """Return the closed part of an area on one side of a meridian."""
    kept = list[Point]()
    for before, after in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (before[0] - edge) * side >= 0:
            kept.append(before)
        if (before[0] - edge) * (after[0] - edge) < 0:
            kept.append([edge, _at(before, after, edge)])
    return [*kept, kept[0]]


def _at(before: Point, after: Point, longitude: float) -> float:
    """Return the latitude of a line at a longitude."""
    share = (longitude - before[0]) / (after[0] - before[0]) if after[0] != before[0] else 0.0
    return round(before[1] + share * (after[1] - before[1]), 8)


def _near(longitude: float, other: float) -> float:
    """Return a longitude plus the multiple of 360 degrees that brings it nearest to another one."""
    return longitude + TURN * round((other - longitude) / TURN)


def _wrapped(longitude: float, middle: float) -> float:
    """Return a longitude within -180 to 180 degrees, on the same side of the antimeridian as `middle`."""
    return round(longitude - TURN * ((middle > EDGE) - (middle < -EDGE)), 8)
