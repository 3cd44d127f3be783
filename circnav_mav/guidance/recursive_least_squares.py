"""Least squares of a line with exponential forgetting: turn gain, response, drag and wind of a
copter."""

from math import exp
from typing import Any


class RecursiveLeastSquares:
    """Weighted sums for the fit y = slope x + offset. Older pairs have a smaller weight.

    x, y: floats or complex numbers (vectors in the plane). x may be an array of candidates.
    n, x, y, xx, xy, yy: weighted sums of 1, x, y, |x|^2, conj(x) y and |y|^2.
    Source: Ljung, System Identification (1999), section 11.2.
    """

    def __init__(self, memory: float) -> None:
        """memory: time constant of the forgetting, s."""
        self._memory = memory
        self.n = 0.0
        self.x: Any = 0.0
        self.y: Any = 0.0
        self.xx: Any = 0.0
        self.xy: Any = 0.0
        self.yy = 0.0

    def add(self, x: Any, y: Any, step: float, weight: float) -> None:
        """Forget over a step (s), then add a pair with a weight."""
        keep = exp(-step / self._memory)
        self.n = self.n * keep + weight
        self.x = self.x * keep + weight * x
        self.y = self.y * keep + weight * y
        self.xx = self.xx * keep + weight * (x.conjugate() * x).real
        self.xy = self.xy * keep + weight * (x.conjugate() * y)
        self.yy = self.yy * keep + weight * (y.conjugate() * y).real

    def spread(self) -> Any:
        """Return the sum of |x - mean x|^2."""
        return self.xx - (self.x.conjugate() * self.x).real / self.n

    def product(self) -> Any:
        """Return the sum of conj(x - mean x) (y - mean y)."""
        return self.xy - self.x.conjugate() * self.y / self.n

    def variation(self) -> float:
        """Return the sum of |y - mean y|^2."""
        return float(self.yy - (self.y.conjugate() * self.y).real / self.n)
