"""numpy's names for plain floats: an equation that is given its functions as `xp` is written once, serves arrays of
flights with numpy, and the one flight in the air with this module, several times as fast.

Differences to numpy: none but the last bit, except that arguments without a result raise ValueError instead of giving
NaN, and that NaN must stand first in `minimum`, `maximum` and `clip` to come through.
"""

import operator
from math import acos as arccos
from math import asin as arcsin
from math import atan2 as arctan2
from math import cos, exp, hypot, pi, sin, sqrt, tanh
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "arccos", "arcsin", "arctan2", "clip", "cos", "exp", "hypot", "logical_not", "maximum", "minimum", "rint", "sign",
    "sin", "sinc", "sqrt", "tanh", "where",
]  # fmt: skip

Number = float | NDArray[np.float64]
"""A float for one flight, or an array whose last axis is flights: the same equation serves both."""
Flag = bool | NDArray[np.bool_]
"""The same of yes and no."""
T = TypeVar("T")
logical_not, rint = operator.not_, round
minimum, maximum = min, max


def clip(value: float, low: float, high: float) -> float:
    """The value, or the nearer bound."""
    return min(max(value, low), high)


def magnitude(x: Number) -> Number:
    """|x| of a float or an array: mypy knows no `abs` of either."""
    return abs(x)  # type: ignore[return-value]


def sign(x: float) -> float:
    """-1, 0 or 1."""
    return (x > 0) - (x < 0)


def sinc(x: float) -> float:
    """sin(pi x)/(pi x)."""
    y = pi * x
    return sin(y) / y if y else 1.0


def where(condition: bool, then: T, otherwise: T) -> T:
    """One of two values, both worked out."""
    return then if condition else otherwise
