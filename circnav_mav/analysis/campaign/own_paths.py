"""The paths through the air of many flights at once, from the attitudes that reach the pilot: see `core.OwnPath`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from circnav_mav.core.air_path import chord_parts, wrap

Array = Any
LONGEST = 0.4
"""An attitude carried on for longer, s, is no case for a batch: the pilot's path would soon end, or break."""


@dataclass(frozen=True, slots=True)
class Knots:
    """Own motion of B flights at one moment, (B,): heading (rad), turn rate (rad/s), and how far the path had come (m);
    age: of the attitude that it is made of, s. NaN where the pilot does not know."""

    time: float
    heading: Array
    turn_rate: Array
    x: Array
    y: Array
    age: Array


class OwnPaths:
    """Arcs at the speed (B,), m/s, that each vehicle is told to fly."""

    def __init__(self, speed: Array) -> None:
        self._V = speed
        self._time, self._heading, self._rate = (np.full(len(speed), np.nan) for _ in range(3))
        self._x, self._y = np.zeros(len(speed)), np.zeros(len(speed))

    @property
    def known(self) -> Array:
        """Whose path has begun, (B,)."""
        return ~np.isnan(self._time)

    def move(self, now: float, heading: Array, turn_rate: Array, who: Array) -> None:
        """Take in the attitudes of some flights (mask, (B,))."""
        if not who.any():
            return
        more = who & self.known
        x, y = chord_parts(self._V, self._heading, wrap(heading - self._heading), now - self._time)
        self._x, self._y = np.where(more, self._x + x, self._x), np.where(more, self._y + y, self._y)
        self._time = np.where(who, now, self._time)
        self._heading, self._rate = np.where(who, heading, self._heading), np.where(who, turn_rate, self._rate)

    def at(self, now: float) -> Knots:
        """Where the paths are."""
        age = now - self._time
        turned = self._rate * age
        x, y = chord_parts(self._V, self._heading, turned, age)
        return Knots(now, self._heading + turned, self._rate, self._x + x, self._y + y, age)
