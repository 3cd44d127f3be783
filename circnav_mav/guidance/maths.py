"""Elementary functions of a float or of an array: an equation is written once, and serves the one flight in the air as
well as the flights of an experiment, which are the last axis of its arrays.

Then arcs that a vehicle flies at a steady turn rate, and slant ranges made horizontal.

A float is answered by `math`, several times as fast as numpy and the same but for the last bit. Of floats, arguments
without a result raise ValueError, and NaN must stand first in `minimum`, `maximum` and `clip` to come through.
"""

import math
from cmath import rect
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import NDArray

Array = Any
"""A number of one flight, or an array of many, as a result: its reader says which."""
Batch = NDArray[Any]
"""An array of many flights, the last axis."""
Pair = tuple[Array, Array] | Array
"""Two components: a tuple, or an array of shape (2, ...)."""
Number = float | NDArray[np.float64]
"""The same as an argument."""
Flag = bool | NDArray[np.bool_]


def _either(one: Callable[..., Any], many: Callable[..., Any]) -> Callable[[Any], Any]:
    return lambda x: many(x) if isinstance(x, ndarray) else one(x)


def _either_of_two(one: Callable[..., Any], many: Callable[..., Any]) -> Callable[[Any, Any], Any]:
    return lambda x, y: many(x, y) if isinstance(x, ndarray) or isinstance(y, ndarray) else one(x, y)


cos, sin, sqrt = _either(math.cos, np.cos), _either(math.sin, np.sin), _either(math.sqrt, np.sqrt)
arccos, arcsin = _either(math.acos, np.arccos), _either(math.asin, np.arcsin)
exp, tanh = _either(math.exp, np.exp), _either(math.tanh, np.tanh)
logical_not, some = _either(lambda x: not x, np.logical_not), _either(bool, np.any)
rint, sign = _either(round, np.rint), _either(lambda x: bool(x > 0) - bool(x < 0), np.sign)
arctan2, hypot = _either_of_two(math.atan2, np.arctan2), _either_of_two(math.hypot, np.hypot)
minimum, maximum = _either_of_two(min, np.minimum), _either_of_two(max, np.maximum)


def unit(angle: Number) -> Any:
    """The unit vector in a direction, as a complex number."""
    return np.exp(1j * angle) if isinstance(angle, ndarray) else rect(1.0, angle)


def magnitude(x: Number) -> Number:
    """|x|: mypy knows no `abs` of either."""
    return abs(x)  # type: ignore[return-value]


def clip(value: Number, low: Number, high: Number) -> Any:
    """The value, or the nearer bound."""
    if isinstance(value, ndarray) or isinstance(low, ndarray):
        return np.clip(value, low, high)
    return min(max(value, low), high)


def sinc(x: Number) -> Any:
    """sin(pi x)/(pi x)."""
    if isinstance(x, ndarray):
        return np.sinc(x)
    y = math.pi * x
    return math.sin(y) / y if y else 1.0


def where(condition: Flag, then: Any, otherwise: Any) -> Any:
    """One of two values, both worked out."""
    if isinstance(condition, ndarray):
        return np.where(condition, then, otherwise)
    return then if condition else otherwise


MAX_SIGMA_GROWTH = 5.0
"""Nearer overhead than this, noise grows so much that the sample says nothing: an elevation of 78 degrees."""


def wrap(angle: Number) -> Array:
    """An angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def chord_parts(V: Number, psi: Number, turn: Number, dt: Number) -> tuple[Array, Array]:
    """Displacement in dt at speed V along an arc from heading psi through the angle `turn`, exactly.

    Its length is V dt sinc(turn/2) and its direction psi + turn/2. An Euler step instead leaves -0.3 m of radius.
    """
    length, middle = V * dt * sinc(turn / (2 * math.pi)), psi + turn / 2
    return length * cos(middle), length * sin(middle)


def chord(V: Number, psi: Number, turn: Number, dt: Number) -> Array:
    """`chord_parts` as one array (2, ...)."""
    return np.stack(chord_parts(V, psi, turn, dt))


def horizontal(slant: float, sigma: float, height: float) -> tuple[float, float] | None:
    """Horizontal range and its standard deviation from a slant range, all in m.

    rho = sqrt(slant^2 - height^2), sigma_rho = sigma slant/rho. None where the target is (nearly) below.
    """
    inside = slant**2 - height**2
    if inside <= 0:
        return None
    rho = sqrt(inside)
    growth = slant / rho
    return None if growth > MAX_SIGMA_GROWTH else (rho, sigma * growth)


def horizontal_rate(slant: float, rate: float, sigma: float, height: float) -> tuple[float, float] | None:
    """Horizontal range rate and its standard deviation, m/s, from those of a slant range (m), in level flight:
    rho' = slant slant'/rho. None as `horizontal`."""
    flat = horizontal(slant, sigma, height)
    return None if flat is None else (rate * slant / flat[0], flat[1])
