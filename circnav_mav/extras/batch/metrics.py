"""How good the flights of a batch were, each number per flight. Tracks have shape (N, B); SI units.

See `circnav_mav.runlog.metrics` for one recorded flight, and for what was commanded.
"""

import numpy as np

from circnav_mav.guidance.maths import Batch


def rms(values: Batch) -> Batch:
    """Root mean square over time, (B,)."""
    return np.asarray(np.sqrt(np.mean(np.asarray(values, float) ** 2, axis=0)))


def last_exit(time: Batch, r: Batch, r_d: float, within: float) -> Batch:
    """Time (B,) after which |r - r_d| stays within so many m; infinite if the flight ends outside."""
    outside = np.abs(r - r_d) > within
    step = time[1] - time[0]
    newest = len(time) - 1 - outside[::-1].argmax(axis=0)
    settled = np.where(outside.any(axis=0), time[newest] + step, 0.0)
    return np.asarray(np.where(outside[-1], np.inf, settled))


def overshoot(r: Batch, r_d: float) -> Batch:
    """How far a flight went beyond the circle after it first reached it, m, (B,); 0 if it never did or never passed.

    For starts outside this is how deep it went inside, for starts inside how far out.
    """
    outside = r[0] > r_d
    e = np.where(outside, r_d - r, r - r_d)
    reached = np.maximum.accumulate(e >= 0, axis=0)
    return np.asarray(np.where(reached, e, 0.0).max(axis=0))


def swept(angle: Batch) -> Batch:
    """Angle swept round the target, rad, counter-clockwise positive, (B,)."""
    unwrapped = np.unwrap(angle, axis=0)
    return np.asarray(unwrapped[-1] - unwrapped[0])


def right_way(angle: Batch, sense: Batch) -> Batch:
    """Whether the flight went round in the sense asked for. Range alone cannot tell."""
    return np.asarray(np.sign(swept(angle)) == sense)


def went_round(angle: Batch) -> Batch:
    """Whether the flight went round at all, (B,): a quarter turn or more, as in `metrics.direction_of`."""
    return np.abs(swept(angle)) >= np.pi / 2


def tangent_time(p: Batch, psi: Batch, sense: Batch, *, V: float, r_d: float, max_turn_rate: float) -> Batch:
    """Time (s), (B,), to the tangent point: one turn at the limit, then the straight line that touches the circle (a
    Dubins path). In still air it is the yardstick for settling.

    For starts outside, p = vehicle - target (2, B), heading psi (B,). sense: +1 counter-clockwise, -1 clockwise.
    """
    rho = V / max_turn_rate
    best = np.full(np.shape(psi), np.inf)
    x, y, heading = p[0], p[1] * sense, psi * sense
    for side in (1.0, -1.0):
        cx, cy = x - side * rho * np.sin(heading), y + side * rho * np.cos(heading)
        D, offset = np.hypot(cx, cy), r_d - side * rho
        exists = abs(offset) <= D
        line = np.sqrt(np.maximum(D**2 - offset**2, 0.0))
        course = np.arctan2(-cy, -cx) - np.arcsin(np.minimum(offset / np.maximum(D, 1e-9), 1.0))
        turn = np.mod(side * (course - heading) + 1e-9, 2 * np.pi) - 1e-9
        length = turn * rho + line
        best = np.minimum(best, np.where(exists, length, np.inf))
    return best / V
