"""Stability margin of the drift law's loop on a circle, computed before the flight.

The loop is linearized about the circle at the most critical point, where the drift is a tailwind.
There the ground speed v = V + W is highest, and the course turns by V/v times the turn of the nose.
e: radius error, m. psi: heading error, rad. c: commanded turn rate, rad/s.

    e = -V P c/(s^2 + (v/r_d)^2),   psi = s P c/(s^2 + (v/r_d)^2),   pending = (1 - M) c/s
    M = e^(-s dead)/(lag s + 1)

The slopes of the law in e, psi and pending are finite differences of its function. P: response of
the vehicle, from the family of tests/guidance/test_margins.py, scaled to the mission's delay. M:
model of P in the guidance, with errors of +-20 %.

On a large circle v/r_d is small compared with the crossover, and the margin depends on the delay
alone. On a small circle the vehicle turns far within its delay.
"""

from collections.abc import Callable
from functools import lru_cache
from itertools import product
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.turn_response import Pending
from circnav_mav.guidance.vector_field import drift, drift_gains

LINK = 0.05
"""Delay of link and control period, s, in addition to the vehicle's delay."""
DEAD_SHARE = 0.3
"""Share of the dead time in the delay of these vehicles. With a larger share, the sensitivity is
lower."""
DAMPINGS = (0.3, 0.6, None)
"""Family of vehicles: damping of the response. None: response of first order."""
KNOWN = (0.8, 1.0, 1.2)
"""Family of vehicles: delay in the guidance's model over true delay."""
MOST_SENSITIVITY = 2.3
"""Largest sensitivity |1/(1 + L)| of a loop with sufficient margin. The phase margin is then at
least 25 deg, and the gain margin at least 5 dB. Large circles have a sensitivity of 2.1 at most.
On firmware, a plane at 15 m/s on a radius of 60 m in 5 m/s of wind (sensitivity 2.6) oscillated. A
plane at 22 m/s on a radius of 150 m (1.8) did not."""
DESIGN_DRIFT = 1 / 3
"""Drift, in units of V, in which a circle should keep its margin. If the turn rate allows less
drift on this circle, that smaller drift is used instead."""
LARGEST = 10.0
"""Upper end of the search for a radius with margin, in units of the given radius."""
_S = 1j * np.logspace(-1.3, 1, 100)
"""Frequencies times j, rad/s: from a slow lap to far beyond any crossover."""
Complex = NDArray[Any]
"""Frequency response at the frequencies `_S`."""


@lru_cache(maxsize=1024)
def sensitivity(V: float, r_d: float, W: float, delay: float, late: float, limit: float) -> float:
    """Return the largest sensitivity over the family of vehicles.

    V: speed, m/s.
    W: drift, m/s.
    delay: of the vehicle's turn, s.
    late: delay of the reported turn, s. The gains use the sum of `delay`, LINK and `late`.
    limit: of the turn rate, rad/s.
    """
    worst = 0.0
    for known, damping in product(KNOWN, DAMPINGS):
        dead = DEAD_SHARE * delay
        lag = (1 - DEAD_SHARE) * delay
        frequency = 2 * (damping or 0.0) / lag
        answer: Complex = 1 / (lag * _S + 1)
        if damping is not None:
            answer = frequency**2 / (_S**2 + 2 * damping * frequency * _S + frequency**2)
        P = answer * np.exp(-_S * (dead + LINK))
        M = np.exp(-_S * (dead + LINK) * known) / (lag * known * _S + 1)
        settles = 1 / lag if damping is None else damping * frequency
        loop = _loop(P, M, V, r_d, W, (delay + LINK) * known, settles, late, limit)
        worst = max(worst, float(np.abs(1 / (1 + loop)).max()))
    return worst


def _loop(
    P: Complex,
    M: Complex,
    V: float,
    r_d: float,
    W: float,
    ahead: float,
    settles: float,
    late: float,
    limit: float,
) -> Complex:
    """Return the loop gain, opened at the vehicle."""
    v = V + W
    gains = drift_gains(V, ahead + late, settles)
    under_way = v**2 / (V * r_d) * ahead

    def law(e: float, psi: float, pending: float) -> float:
        what = Pending(under_way + pending, ahead, settles)
        heading = pi / 2 + psi
        return drift(
            (r_d + e, 0.0), (0.0, W), heading, what, V=V, r_d=r_d, max_turn_rate=limit, gains=gains
        )

    # Use a small step for the derivatives (m, rad). Outside the circle the commanded direction
    # depends on the square root of the radius error, so its derivative changes with the error.
    h = 1e-4
    by_e = (law(h, 0, 0) - law(-h, 0, 0)) / (2 * h)
    by_psi, by_pending = (
        (law(0, h * a, h * b) - law(0, -h * a, -h * b)) / (2 * h) for a, b in ((1, 0), (0, 1))
    )
    circle = _S**2 + (v / r_d) ** 2
    return np.asarray(-P * (by_psi * _S - by_e * V) / circle / (1 - by_pending * (1 - M) / _S))


def drift_with_margin(
    V: float, r_d: float, most: float, delay: float, late: float, limit: float
) -> float:
    """Return the largest drift up to `most`, m/s, in which a circle keeps its margin. The value is
    negative if the margin is missing even in still air."""

    def sound(W: float) -> bool:
        return sensitivity(V, r_d, W, delay, late, limit) <= MOST_SENSITIVITY

    if sound(most):
        return most
    if not sound(0.0):
        return -1.0
    return _border(0.0, most, sound)


def radius_with_margin(
    V: float, r_d: float, W: float, delay: float, late: float, limit: float
) -> float:
    """Return the smallest radius above r_d, m, that keeps its margin in a drift W (m/s), or inf."""

    def short(radius: float) -> bool:
        return sensitivity(V, radius, W, delay, late, limit) > MOST_SENSITIVITY

    return float("inf") if short(LARGEST * r_d) else _border(r_d, LARGEST * r_d, short)


def _border(low: float, high: float, holds: Callable[[float], bool]) -> float:
    """Return the value at which a condition changes from true (low) to false (high), by bisection
    to 1 %."""
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return (low + high) / 2
