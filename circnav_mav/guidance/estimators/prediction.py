"""What the belief of a flight says of a moment soon after its newest range: as `relative_ekf.predict`, but only what is
asked, and in plain floats."""

from math import cos, exp, sin
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.estimators import relative_ekf as ekf
from circnav_mav.guidance.maths import Array


class Belief(NamedTuple):
    """mean: the state of `relative_ekf`, 12 numbers. covariance (12, 12). drift_psd (m^2/s^3), gust (m/s), feels
    (0 .. 1): what it assumes."""

    mean: tuple[float, ...]
    covariance: Array
    drift_psd: float
    gust: float
    feels: float = 0.0


class Prediction(NamedTuple):
    """p = vehicle - target = (x, y), m, at range r. drift: m/s. airspeed: true, m/s. r_dot: m/s. Variances: of r (m^2),
    of the direction (rad^2), of r_dot (m^2/s^2)."""

    r: float
    x: float
    y: float
    drift: tuple[float, float]
    airspeed: float
    r_dot: float
    r_variance: float
    direction_variance: float
    r_dot_variance: float


def predict_belief(
    belief: Belief, dt: float, chord: tuple[float, float], *, heading: float, airspeed: float,
    felt: ekf.Felt | None = None,
) -> Prediction:  # fmt: skip
    """The belief carried on by dt (s) along an air path (m, at the measured airspeed) to where the vehicle flies with
    that heading (rad) and that measured airspeed (m/s). felt: what was felt meanwhile, see `Knot.felt_since`."""
    _, _, *steady_d, kappa, _, gx, gy, forward, sideways, ex, ey = belief.mean
    calm = exp(-dt / ekf.GUST_TIME)
    r, theta, row = ekf.motion(belief.mean, dt, chord)
    out, left = [0.0] * ekf.STATES, [0.0] * ekf.STATES
    for state, entry in row:
        out[state], left[state] = entry.real, entry.imag / r
    n, t = ekf.axes(theta)
    air = airspeed * cos(heading), airspeed * sin(heading)
    d = steady_d[0] + calm * gx, steady_d[1] + calm * gy
    if felt is not None:
        # the measured change in the place of the assumed one, as far as the models that feel it are believed
        (c, s), stays = felt.nose, calm + belief.feels * (1 - calm)
        errors = c * forward - s * sideways, s * forward + c * sideways
        dx, dy = (
            steady + stays * g + e - error + belief.feels * (change - kappa * nose)
            for steady, g, e, error, change, nose in zip(
                steady_d, (gx, gy), (ex, ey), errors, felt.change, felt.air, strict=True
            )
        )
        d = dx, dy
    v = kappa * air[0] + d[0], kappa * air[1] + d[1]
    across, ahead = t[0] * v[0] + t[1] * v[1], n[0] * air[0] + n[1] * air[1]
    rate = [across * entry for entry in left]  # r' = n.v, and an error of the direction turns n
    rate[ekf.KAPPA] += ahead
    for i, along in enumerate(n):
        rate[ekf.DX + i] += along
        rate[ekf.GX + i] += calm * along
        if felt is not None:
            rate[ekf.EX + i] += along
    rows = np.array((out, left, rate)).T  # (12, 3)
    of_r, of_direction, of_rate = (belief.covariance @ rows * rows).sum(axis=0).tolist()
    steady, gusty = ekf.steps(belief.drift_psd, belief.gust, dt)
    wander = ekf.wandered(steady, gusty, dt)
    turned = wander / r**2
    return Prediction(
        r=r,
        x=r * n[0],
        y=r * n[1],
        drift=d,
        airspeed=kappa * airspeed,
        r_dot=n[0] * v[0] + n[1] * v[1],
        r_variance=of_r + wander,
        direction_variance=of_direction + turned,
        r_dot_variance=of_rate + across**2 * turned + steady + gusty + ekf.KAPPA_PSD * dt * ahead**2,
    )
