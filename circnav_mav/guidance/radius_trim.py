"""A slow integral that takes the mean radius error to zero.

A law's radius rests on V and on the turn rate being what they are told to be; a vehicle whose true airspeed is 6 %
above the indicated one flies 2 m outside a circle of 150 m. The trim is added to the radius that the law is fed.
"""

NEAR = 0.2
"""The integral grows only within this fraction of the radius, where the law is linear, and while nothing saturates;
farther off it only unwinds, for what it holds may be what keeps the vehicle there."""
MOST = 0.15
"""Bound of the trim, as a fraction of the radius."""


def next_trim(trim: float, *, rate: float, r: float, r_d: float, step: float, saturated: bool) -> float:
    """The trim (m) after `step` seconds at range r, growing against the error with `rate` (1/s)."""
    after = trim - rate * (r - r_d) * step
    if saturated:
        return trim
    if abs(r - r_d) > NEAR * r_d:
        unwound = after if trim * after > 0 else 0.0
        return unwound if abs(unwound) < abs(trim) else trim
    return min(max(after, -MOST * r_d), MOST * r_d)
