"""What a belief of one flight says of a moment soon after its newest range: as `bank.predict`, in plain floats."""

from dataclasses import dataclass
from math import cos, exp, sin

import numpy as np

from circnav_mav.core import floats
from circnav_mav.core.estimators.bank import (
    DX,
    DY,
    GUST_TIME,
    GX,
    GY,
    KAPPA,
    KAPPA_PSD,
    Array,
    axes,
    motion,
    steps,
    wandered,
)
from circnav_mav.core.values import OwnMotion


@dataclass(frozen=True, slots=True)
class Belief:
    """mean: the state of `bank`, 8 floats. covariance (8, 8). drift_psd (m^2/s^3), gust (m/s): what it assumes."""

    mean: tuple[float, ...]
    covariance: Array
    drift_psd: float
    gust: float


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


def predict_one(belief: Belief, dt: float, chord: tuple[float, float], own: OwnMotion) -> Prediction:
    """The belief carried on by dt (s) along an air path (m, at the measured airspeed) to where own motion is `own`."""
    x, calm = belief.mean, exp(-dt / GUST_TIME)
    r, theta, (out, left) = motion(x, dt, chord, floats)
    n, t = axes(theta, floats)
    air = own.airspeed * cos(own.heading), own.airspeed * sin(own.heading)
    d = x[DX] + calm * x[GX], x[DY] + calm * x[GY]
    v = x[KAPPA] * air[0] + d[0], x[KAPPA] * air[1] + d[1]
    across, ahead = t[0] * v[0] + t[1] * v[1], n[0] * air[0] + n[1] * air[1]
    rate = [across * entry for entry in left]  # r' = n.v, and an error of the direction turns n
    for state, gradient in (
        (DX, n[0]), (DY, n[1]), (KAPPA, ahead), (GX, calm * n[0]), (GY, calm * n[1])
    ):  # fmt: skip
        rate[state] += gradient
    rows = np.array((out, left, rate))
    of_r, of_direction, of_rate = ((rows @ belief.covariance) * rows).sum(axis=1).tolist()
    steady, gusty = steps(belief.drift_psd, belief.gust, dt, floats)
    wander = wandered(steady, gusty, dt)
    turned = wander / r**2
    return Prediction(
        r=r,
        x=r * n[0],
        y=r * n[1],
        drift=d,
        airspeed=x[KAPPA] * own.airspeed,
        r_dot=n[0] * v[0] + n[1] * v[1],
        r_variance=of_r + wander,
        direction_variance=of_direction + turned,
        r_dot_variance=of_rate + across**2 * turned + steady + gusty + KAPPA_PSD * dt * ahead**2,
    )
