"""Least-RMS lap when the circle demands more turn rate downwind than the vehicle has.

Without a plan the drift moves the vehicle outside the circle, where it stays until the drift is a
headwind again. On the planned lap the vehicle begins to turn at the limit earlier. The radius error
is then small everywhere. The lap is inside the circle where the drift is a tailwind, and outside
the circle before and after.

    turn of the nose = t - (t (e + e'') + t' e')/r_d <= limit,   t = v_g^2/(r_d V cos(crab))

e: radius error. t: turn rate that the circle requires. v_g: ground speed. All are functions of the
angle about the target; primes are derivatives by this angle. The inequality is linear in e. The
term t' e' accounts for a course that is not tangent to the circle. The least mean square of e over
time under this condition is a least-distance problem (Lawson, Hanson, Solving Least Squares
Problems, ch. 23).
"""

from functools import lru_cache
from math import atan2, floor, hypot, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.maths import REACHABLE, Vector, wrap

ANGLES = 72
"""Number of points of a lap: more points change the radius error by less than 2 %."""
DRIFT_STEP = 1 / 200
"""Grid step of planned laps in the drift, in units of V. One lap is planned for each cell of drift
and turn-rate limit, because the estimates vary by more than a cell."""
LIMIT_STEP = 1 / 400
"""Grid step of planned laps in the turn-rate limit, in units of V/r_d."""
MOST_OFFSET = 0.2
"""Largest planned radius error, in units of the radius. The linear inequality is invalid for a
larger error, so the error is clipped."""
_SPACING = 2 * pi / ANGLES
"""Angle between two points of a lap, rad."""


class Lap(NamedTuple):
    """Planned lap on a counter-clockwise circle.

    downwind: angle about the target with the highest ground speed, rad.
    table: e/r_d and its derivative by the angle, (ANGLES + 1, 2). The first row is half a lap
        before `downwind`.
    radius: r_d, m.
    """

    downwind: float
    table: NDArray[np.float64]
    radius: float

    def at(self, angle: float) -> tuple[float, float]:
        """Return the planned radius, m, and its slope de/d(angle), m/rad, at an angle (rad)."""
        place = (wrap(angle - self.downwind) + pi) / _SPACING
        before = min(int(place), ANGLES - 1)
        low, high = self.table[before : before + 2]
        offset, slope = (low + (place - before) * (high - low)).tolist()
        return self.radius * (1 + offset), self.radius * slope


def plan(d: Vector, *, V: float, r_d: float, limit: float) -> Lap | None:
    """Return the planned lap in drift d (m/s) at true airspeed V (m/s), or None if the vehicle can
    fly the circle itself. limit: of the turn rate, rad/s."""
    drift = min(hypot(d[0], d[1]) / V, REACHABLE)
    # Share of the turn-rate limit that a lap uses. The estimates of limit, drift and airspeed have
    # a joint error of 1 %. A lap that demands more turn rate than the vehicle has ends farther
    # outside. With a share of 1, the worst of three ArduPlane flights had a radius error of 1.50 m,
    # with 0.99 of 1.06 m.
    share = 0.99 * limit * r_d / V
    if (1 + drift) ** 2 <= share:
        return None
    table = _table(floor(drift / DRIFT_STEP), floor(share / LIMIT_STEP))
    return Lap(atan2(d[1], d[0]) - pi / 2, table, r_d)


@lru_cache(maxsize=512)
def _table(drift_cell: int, limit_cell: int) -> NDArray[np.float64]:
    """Return e/r_d and its slope over a lap, at the center of a grid cell."""
    from scipy.optimize import nnls  # imported here because its import takes half a second

    drift = (drift_cell + 0.5) * DRIFT_STEP
    limit = (limit_cell + 0.5) * LIMIT_STEP
    angle = _SPACING * np.arange(ANGLES) - pi
    nose = np.sqrt(1 - (drift * np.sin(angle)) ** 2)
    ground = nose + drift * np.cos(angle)
    turn = ground**2 / nose
    here = np.eye(ANGLES)
    after = np.roll(here, 1, 1)
    before = np.roll(here, -1, 1)
    bend = here + (after - 2 * here + before) / _SPACING**2
    slant = (after - before) / (2 * _SPACING)
    eased = turn[:, None] * bend + (slant @ turn)[:, None] * slant
    # Minimize |R e| with eased e >= turn - limit. The residual of this nonnegative problem gives
    # the solution.
    # 1e-3: weight of the curvature e + e'' relative to e: without this weight the planned turn
    # jumps. The weight costs 2 % of radius error.
    R = np.asarray(
        np.linalg.qr(np.vstack([here / np.sqrt(ground)[:, None], np.sqrt(1e-3) * bend]), mode="r")
    )
    G = np.linalg.solve(R.T, eased.T)
    E = np.vstack([G, turn - limit])
    f = np.eye(ANGLES + 1)[-1]
    left = E @ nnls(E, f, maxiter=100 * ANGLES)[0] - f
    e = np.clip(np.linalg.solve(R, -left[:-1] / left[-1]), -MOST_OFFSET, MOST_OFFSET)
    lap = np.stack([e, slant @ e], axis=-1)
    return np.concatenate([lap, lap[:1]])
