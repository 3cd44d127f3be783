"""The truest lap of a vehicle that turns less than its circle asks for where the drift is behind it.

Without a plan it is carried outside, and stays there until the drift is ahead again. The planned lap begins to turn at
the limit earlier. It is a little outside before and after, inside in between, and nowhere far.

    turn of the nose = t - (t (e + e'') + t' e')/r_d <= limit,   t = v_g^2/(r_d V cos(crab))

e: radius error, by the angle round the target. t: turn that the circle asks for, by the angle, too. The equation is
linear; t' e' counts that the course is not the circle's. The least mean square of e over time under this condition is a
least-distance problem (Lawson, Hanson, Solving Least Squares Problems, ch. 23).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from circnav_mav.guidance.maths import Array, Batch, Number, Pair, arctan2, hypot, minimum, some, wrap

ANGLES = 72
"""Points of a lap: finer ones change the radius error by less than 2 %."""
BENDS = 1e-3
"""Weight of the bends e + e'' beside e itself: without it the planned turn jumps. It costs 2 % of radius error."""
DRIFT_STEP, LIMIT_STEP = 1 / 200, 1 / 400
"""Laps are planned for drifts (in units of V) and limits (of V/r_d) on this grid: the estimates vary more."""
SURE = 0.99
"""Share of the limit that a lap is planned for. Limit, drift and airspeed as estimated are a percent off together, and
a lap that asks for too much ends farther outside: of three flights of ArduPlane the worst held 1.50 m with 1, 1.06 m
with .99."""
MOST_DRIFT = 0.9
"""Drift in units of V beyond which no lap is flown anyway."""
MOST_OFFSET = 0.2
"""Bound of e in units of the radius: beyond it the linear equation does not hold."""
_SPACING = 2 * np.pi / ANGLES
"""Angle between two points of a lap, rad."""
_CIRCLE = np.zeros((ANGLES + 1, 2))
"""The lap that is the circle."""


class Lap(NamedTuple):
    """What is planned, for a counter-clockwise circle. downwind: angle round the target, rad, at which the ground speed
    is highest. table: e/r_d and its slope by the angle from half a lap before that, (ANGLES + 1, 2), of many flights
    (B, ANGLES + 1, 2). radius: r_d, m."""

    downwind: Array
    table: Batch
    radius: Array

    def at(self, angle: Number) -> tuple[Array, Array]:
        """Planned radius, m, and its slope de/d(angle), m/rad, where a vehicle is at this angle (rad)."""
        place = (wrap(angle - self.downwind) + np.pi) / _SPACING
        if not isinstance(place, np.ndarray):
            before = min(int(place), ANGLES - 1)
            low, high = self.table[before : before + 2]
            offset, slope = (low + (place - before) * (high - low)).tolist()
        else:
            number, flight = np.minimum(place.astype(int), ANGLES - 1), np.arange(place.size)
            low, high = self.table[flight, number], self.table[flight, number + 1]
            offset, slope = (low + (place - number)[:, None] * (high - low)).T
        return self.radius * (1 + offset), self.radius * slope


def plan(d: Pair, *, V: Number, r_d: Number, limit: Number) -> Lap | None:
    """The lap in drift d (2, ...), m/s, at true airspeed V. limit: of the turn rate, rad/s. None where the circle is
    within it, of all flights."""
    drift, limits = minimum(hypot(d[0], d[1]) / V, MOST_DRIFT), SURE * limit * r_d / V
    short = (1 + drift) ** 2 > limits
    if not some(short):
        return None
    cells: tuple[Array, Array] = np.floor(drift / DRIFT_STEP), np.floor(limits / LIMIT_STEP)
    if isinstance(short, np.ndarray):
        table = np.stack([_table(*cell) if one else _CIRCLE for one, *cell in zip(short, *cells, strict=True)])
    else:
        table = _table(*cells)
    return Lap(arctan2(d[1], d[0]) - np.pi / 2, table, r_d)


@lru_cache(maxsize=512)
def _table(drift_cell: float, limit_cell: float) -> Batch:
    """e/r_d and its slope over a lap, in the middle of a cell of the grid."""

    drift, limit = (drift_cell + 0.5) * DRIFT_STEP, (limit_cell + 0.5) * LIMIT_STEP
    angle = _SPACING * np.arange(ANGLES) - np.pi
    nose = np.sqrt(1 - (drift * np.sin(angle)) ** 2)
    ground = nose + drift * np.cos(angle)
    turn = ground**2 / nose
    here = np.eye(ANGLES)
    after, before = np.roll(here, 1, 1), np.roll(here, -1, 1)
    bend, slant = here + (after - 2 * here + before) / _SPACING**2, (after - before) / (2 * _SPACING)
    eased = turn[:, None] * bend + (slant @ turn)[:, None] * slant
    # least |R e| under eased e >= turn - limit: the residual of this nonnegative problem is the answer's direction
    R = np.asarray(np.linalg.qr(np.vstack([here / np.sqrt(ground)[:, None], np.sqrt(BENDS) * bend]), mode="r"))
    G = np.linalg.solve(R.T, eased.T)
    E, f = np.vstack([G, turn - limit]), np.eye(ANGLES + 1)[-1]
    left = E @ nnls(E, f, maxiter=100 * ANGLES)[0] - f
    e = np.clip(np.linalg.solve(R, -left[:-1] / left[-1]), -MOST_OFFSET, MOST_OFFSET)
    lap = np.stack([e, slant @ e], axis=-1)
    return np.concatenate([lap, lap[:1]])
