"""Elementary functions of a float or an array, arcs at a steady turn rate, and horizontal ranges
from slant ranges.

Each equation is written once. It serves one real flight (floats) and the flights of an experiment
(last axis of its arrays). Floats use `math`, which is several times as fast as numpy and differs
only in the last bit. Floats outside the domain raise ValueError. `minimum`, `maximum` and `clip` of
floats return NaN only if it is the first argument.
"""

import math
from cmath import rect
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import NDArray

Vector = tuple[float, float]
"""Components x and y."""
Array = Any
"""Result type: a number for one flight, or an array for many. `Any`, because the caller determines
which."""
Batch = NDArray[Any]
"""Array with the flights as last axis."""
Pair = tuple[Array, Array] | Array
"""Two components: a tuple, or an array of shape (2, ...)."""
Number = float | NDArray[np.float64]
"""Argument type: a number for one flight, or an array for many."""
Flag = bool | NDArray[np.bool_]


def _either(one: Callable[..., Any], many: Callable[..., Any]) -> Callable[[Any], Any]:
    return lambda x: many(x) if isinstance(x, ndarray) else one(x)


def _either_of_two(one: Callable[..., Any], many: Callable[..., Any]) -> Callable[[Any, Any], Any]:
    return lambda x, y: (
        many(x, y) if isinstance(x, ndarray) or isinstance(y, ndarray) else one(x, y)
    )


cos = _either(math.cos, np.cos)
sin = _either(math.sin, np.sin)
sqrt = _either(math.sqrt, np.sqrt)
arccos = _either(math.acos, np.arccos)
arcsin = _either(math.asin, np.arcsin)
exp = _either(math.exp, np.exp)
tanh = _either(math.tanh, np.tanh)
logical_not = _either(lambda x: not x, np.logical_not)
some = _either(bool, np.any)
rint = _either(round, np.rint)
sign = _either(lambda x: bool(x > 0) - bool(x < 0), np.sign)
arctan2 = _either_of_two(math.atan2, np.arctan2)
hypot = _either_of_two(math.hypot, np.hypot)
minimum = _either_of_two(min, np.minimum)
maximum = _either_of_two(max, np.maximum)


def unit(angle: Number) -> Any:
    """Return the unit vector in a direction (rad), as a complex number."""
    return np.exp(1j * angle) if isinstance(angle, ndarray) else rect(1.0, angle)


def magnitude(x: Number) -> Number:
    """Return |x|. mypy has no type for `abs` of a float or an array."""
    return abs(x)  # type: ignore[return-value]


def clip(value: Number, low: Number, high: Number) -> Any:
    """Return the value limited to [low, high]."""
    if isinstance(value, ndarray) or isinstance(low, ndarray):
        return np.clip(value, low, high)
    return min(max(value, low), high)


def sinc(x: Number) -> Any:
    """Return sin(pi x)/(pi x)."""
    if isinstance(x, ndarray):
        return np.sinc(x)
    y = math.pi * x
    return math.sin(y) / y if y else 1.0


def where(condition: Flag, then: Any, otherwise: Any) -> Any:
    """Return one of two values. Both are evaluated."""
    if isinstance(condition, ndarray):
        return np.where(condition, then, otherwise)
    return then if condition else otherwise


MAX_SIGMA_GROWTH = 5.0
"""Largest growth of the noise from slant to horizontal range, at 78 deg of elevation. Above it a
sample is useless."""


def wrap(angle: Number) -> Array:
    """Return the angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def chord(V: float, psi: float, turn: float, dt: float) -> Vector:
    """Return the exact displacement (m) in dt (s) at V (m/s), turning steadily by `turn` (rad) from
    heading psi (rad).

    Its length is V dt sin(turn/2)/(turn/2) and its direction psi + turn/2. An Euler step instead
    causes -0.3 m of radius error.
    """
    length = V * dt * sinc(turn / (2 * math.pi))
    middle = psi + turn / 2
    return length * cos(middle), length * sin(middle)


def horizontal(slant: float, sigma: float, height: float) -> tuple[float, float] | None:
    """Return horizontal range and its standard deviation from a slant range, all in m.

    rho = sqrt(slant^2 - height^2), sigma_rho = sigma slant/rho. None if the target is (nearly)
    below the vehicle.
    """
    inside = slant**2 - height**2
    if inside <= 0:
        return None
    rho = sqrt(inside)
    growth = slant / rho
    return None if growth > MAX_SIGMA_GROWTH else (rho, sigma * growth)


def horizontal_rate(
    slant: float, rate: float, sigma: float, height: float
) -> tuple[float, float] | None:
    """Return horizontal range rate and its standard deviation, m/s, from a slant range (m), its
    rate and the sigma of this rate (m/s), in level flight: rho' = slant slant'/rho. None as for
    `horizontal`."""
    flat = horizontal(slant, sigma, height)
    return None if flat is None else (rate * slant / flat[0], flat[1])
