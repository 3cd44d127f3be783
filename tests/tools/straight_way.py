"""Shortest flight time to a place: straight over ground, with the crab angle that the wind
requires. Independent of the product's code."""

from math import hypot, sqrt


def straight_way(
    to: tuple[float, float], wind: tuple[float, float], airspeed: float, short_of: float = 0.0
) -> float:
    """Return the time, s, of a straight flight that ends at a distance from a place.

    to: position of the place relative to the vehicle, north and east, m. wind: velocity of the air,
    north and east, m/s. airspeed: true airspeed, m/s; must exceed the wind speed. short_of:
    distance from the place at the end, m.
    """
    away = hypot(*to)
    north, east = to[0] / away, to[1] / away
    along = wind[0] * north + wind[1] * east
    across = wind[1] * north - wind[0] * east
    return max(away - short_of, 0.0) / (sqrt(airspeed**2 - across**2) + along)
