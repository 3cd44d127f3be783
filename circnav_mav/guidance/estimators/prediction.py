"""What the belief of a flight says of a moment soon after its newest range: as `relative_ekf.predict`, but only what is
asked, and in plain floats."""

from dataclasses import dataclass
from math import cos, exp, sin

import numpy as np

from circnav_mav.guidance import floats
from circnav_mav.guidance.estimators.dead_reckoning import FeltStep
from circnav_mav.guidance.estimators.relative_ekf import (
    DX,
    DY,
    EX,
    EY,
    FORWARD,
    GUST_TIME,
    GX,
    GY,
    KAPPA,
    KAPPA_PSD,
    LEFT,
    STATES,
    Array,
    axes,
    motion,
    steps,
    wandered,
)


@dataclass(frozen=True, slots=True)
class Belief:
    """mean: the state of `relative_ekf`, 12 numbers. covariance (12, 12). drift_psd (m^2/s^3), gust (m/s), feels
    (0 .. 1): what it assumes."""

    mean: tuple[float, ...]
    covariance: Array
    drift_psd: float
    gust: float
    feels: float = 0.0


@dataclass(frozen=True, slots=True)
class Prediction:
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
    felt: FeltStep | None = None,
) -> Prediction:  # fmt: skip
    """The belief carried on by dt (s) along an air path (m, at the measured airspeed) to where the vehicle flies with
    that heading (rad) and that measured airspeed (m/s). felt: what was felt meanwhile, see `Knot.felt_since`."""
    x, calm = belief.mean, exp(-dt / GUST_TIME)
    r, theta, row = motion(x, dt, chord, floats)
    out, left = [0.0] * STATES, [0.0] * STATES
    for state, entry in row:
        out[state], left[state] = entry.real, entry.imag / r
    n, t = axes(theta, floats)
    air = airspeed * cos(heading), airspeed * sin(heading)
    d = x[DX] + calm * x[GX], x[DY] + calm * x[GY]
    if felt is not None:
        # the measured change in the place of the assumed one, as far as the models that feel it are believed
        c, s = felt.nose
        stays = calm + belief.feels * (1 - calm)
        errors = c * x[FORWARD] - s * x[LEFT], s * x[FORWARD] + c * x[LEFT]
        dx, dy = (
            x[DX + i] + stays * x[GX + i] + x[EX + i] - error + belief.feels * (change - x[KAPPA] * nose)
            for i, error, change, nose in zip((0, 1), errors, felt.change, felt.air, strict=True)
        )
        d = dx, dy
    v = x[KAPPA] * air[0] + d[0], x[KAPPA] * air[1] + d[1]
    across, ahead = t[0] * v[0] + t[1] * v[1], n[0] * air[0] + n[1] * air[1]
    rate = [across * entry for entry in left]  # r' = n.v, and an error of the direction turns n
    for state, gradient in (
        (DX, n[0]), (DY, n[1]), (KAPPA, ahead), (GX, calm * n[0]), (GY, calm * n[1])
    ):  # fmt: skip
        rate[state] += gradient
    if felt is not None:
        rate[EX], rate[EY] = rate[EX] + n[0], rate[EY] + n[1]
    rows = np.array((out, left, rate)).T  # (12, 3)
    of_r, of_direction, of_rate = (belief.covariance @ rows * rows).sum(axis=0).tolist()
    steady, gusty = steps(belief.drift_psd, belief.gust, dt, floats)
    wander = wandered(steady, gusty, dt)
    turned = wander / r**2
    return Prediction(
        r=r,
        x=r * n[0],
        y=r * n[1],
        drift=d,
        airspeed=x[KAPPA] * airspeed,
        r_dot=n[0] * v[0] + n[1] * v[1],
        r_variance=of_r + wander,
        direction_variance=of_direction + turned,
        r_dot_variance=of_rate + across**2 * turned + steady + gusty + KAPPA_PSD * dt * ahead**2,
    )
