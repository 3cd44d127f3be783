"""The relative-motion filters as arrays: one step serves one flight and a thousand, one hypothesis and thirty-two.

State x = (r, theta, d_x, d_y, kappa, b, g_x, g_y), shape (8, M, B) for M hypotheses of each of B flights: r, theta =
range (m) and direction (rad) of p = vehicle - target, d + g = wind - target velocity (m/s), of which d is steady and g
comes and goes (gusts, a turning target), kappa = true over measured airspeed, b = slowly drifting error of the range
(m). Frame: the paper's, turned by whatever constant error the compass has.

    p' = kappa V u(psi) + d + g,   d' = white noise,   g' = -g/tau_g + white noise,   b' = -b/tau_b + white noise,
    z = r + b + white noise

Polar, because then the measurement is linear: a Cartesian filter draws each range along another bearing than the last
and so believes that it sees the bearing (in gusts its NEES reaches hundreds; this one's stays near 2). The motion is
exact (the air path comes in as a chord) and linearised about the mean. Source: extended Kalman filter in polar
coordinates, as Aidala and Hammel, "Utilization of modified polar coordinates for bearings-only tracking" (1983).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from circnav_mav.guidance.air_path import wrap

Array = Any
Row = tuple[Array, ...]
R, THETA, DX, DY, KAPPA, B, GX, GY = range(8)
STATES = 8
BIAS_TIME = 2.0
"""Correlation time of the drifting range error, s: what UWB and LoRa radios show (1..3 s)."""
GUST_TIME = 10.0
"""Correlation time of gusts, s: 150..200 m of low-level turbulence at the speed of a small UAV."""
KAPPA_RANGE = (0.85, 1.15)
"""Airspeed sensors err by no more; without the clamp a filter can lock on a wrong mode."""
CLOSEST = 1.0
"""The bearing is singular at the target: ranges count as at least this, m."""
POSITION_PSD, KAPPA_PSD = 1e-4, 1e-7
"""Process noise for what the model leaves out: m^2/s and 1/s."""
OUTLIER_SHARE, OUTLIER_SPREAD = 0.05, 100.0
"""A range may be worthless: with this probability it is anywhere within so many metres."""
WEIGHT_MEMORY = 20.0
"""Time, s, after which the evidence for a hypothesis counts 1/e."""


@dataclass(frozen=True, slots=True)
class Noise:
    """What each of M hypotheses assumes, arrays of shape (M, 1).

    drift_psd: of d', m^2/s^3. gust: standard deviation of each component of g, m/s. white, drifting: the two parts of
    the range error, in units of the sample's sigma.
    """

    drift_psd: Array
    gust: Array
    white: Array
    drifting: Array


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """M filters for each of B flights: x (8, M, B), P (8, 8, M, B), log_weight (M, B) with maximum 0 per flight."""

    x: Array
    P: Array
    log_weight: Array

    @property
    def weight(self) -> Array:
        """Probabilities of the hypotheses, shape (M, B)."""
        weight = np.exp(self.log_weight - self.log_weight.max(axis=0))
        return weight / weight.sum(axis=0)


@dataclass(frozen=True, slots=True)
class Innovation:
    """What a sample said to each hypothesis, shapes (M, B): normalised innovation squared, and whether it was taken."""

    nis: Array
    taken: Array


def predict(h: Hypotheses, noise: Noise, dt: Array, chord: Array, sigma: Array) -> Hypotheses:
    """Carry on by dt (B,), in s, along air paths whose chords are (2, B), in m at the measured airspeed."""
    x, keep = h.x.copy(), kept(dt)[:, None]
    x[R], x[THETA], rows = motion(h.x, dt, chord)
    x[B:] *= keep[B:]
    F: Array = np.array(rows)
    moved = np.einsum("ik...,kj...->ij...", F, h.P)
    place = np.einsum("ik...,jk...->ij...", moved, F)
    place[1, 0] = place[0, 1]
    steady, gusty = steps(noise.drift_psd, noise.gust, dt)
    moved *= keep
    moved[:, DX:KAPPA] += F[:, DX:KAPPA] * (steady / 2)
    moved[:, GX:] += F[:, GX:] * (gusty / 2)
    wander = wandered(steady, gusty, dt)
    place[0, 0] += wander
    place[1, 1] += wander / x[R] ** 2
    P = h.P * (keep[:, None] * keep)
    P[:2], P[:, :2] = moved, np.swapaxes(moved, 0, 1)
    P[:2, :2] = place
    drifting = (1 - keep[B] ** 2) * (noise.drifting * sigma) ** 2
    for i, q in ((DX, steady), (DY, steady), (GX, gusty), (GY, gusty), (KAPPA, KAPPA_PSD * dt), (B, drifting)):
        P[i, i] += q
    return Hypotheses(x, P, h.log_weight * np.exp(-dt / WEIGHT_MEMORY))


def motion(x: Any, dt: Array, chord: Any, xp: Any = np) -> tuple[Array, Array, tuple[Row, Row]]:
    """Range and direction after dt along a chord, and their rows of the Jacobian: what an error of each state does.

    The other states are multiplied by `kept`. x: by state, arrays or floats. xp: numpy, or `floats` for one flight.
    """
    c, s = xp.cos(x[THETA]), xp.sin(x[THETA])
    east, north = x[KAPPA] * chord[0] + (x[DX] + x[GX]) * dt, x[KAPPA] * chord[1] + (x[DY] + x[GY]) * dt
    along, across = x[R] + c * east + s * north, c * north - s * east
    r, turn = xp.maximum(xp.hypot(along, across), CLOSEST), xp.arctan2(across, along)
    theta = x[THETA] + turn
    n, t = axes(theta, xp)
    c, s, none = xp.cos(turn), xp.sin(turn), 0.0 * r
    out = c, x[R] * s, n[0] * dt, n[1] * dt, n[0] * chord[0] + n[1] * chord[1], none, n[0] * dt, n[1] * dt
    left = -s, x[R] * c, t[0] * dt, t[1] * dt, t[0] * chord[0] + t[1] * chord[1], none, t[0] * dt, t[1] * dt
    return r, theta, (out, tuple(entry / r for entry in left))


def kept(dt: Array) -> Array:
    """What is left of each state but range and direction after dt (B,), (8, B): the range error and gusts fade."""
    fade, calm, all_ = np.exp(-dt / BIAS_TIME), np.exp(-dt / GUST_TIME), np.ones_like(dt)
    return np.array([all_, all_, all_, all_, all_, fade, calm, calm])


def steps(drift_psd: Array, gust: Array, dt: Array, xp: Any = np) -> tuple[Array, Array]:
    """By how much the variances of d and g grow in dt, m^2/s^2."""
    return drift_psd * dt, (1 - xp.exp(-2 * dt / GUST_TIME)) * gust**2


def wandered(steady: Array, gusty: Array, dt: Array) -> Array:
    """By how much the variance of the place grows meanwhile, m^2, beyond what the motion does."""
    return (steady + gusty) * (dt**2 / 3) + POSITION_PSD * dt


def update(
    h: Hypotheses, noise: Noise, z: Array, sigma: Array, valid: Array, gate: float
) -> tuple[Hypotheses, Innovation]:
    """Take in one range per flight, z and sigma (B,), where valid (B,); per hypothesis refuse it outside the gate."""
    PH = h.P[:, R] + h.P[:, B]
    S = np.maximum(PH[R] + PH[B], 0.0) + (noise.white * sigma) ** 2
    nu = z - h.x[R] - h.x[B]
    nis = nu**2 / S
    taken = valid & (nis < gate**2)
    share = taken / S
    x = h.x + PH * (share * nu)
    np.maximum(x[R], CLOSEST, out=x[R])
    np.clip(x[KAPPA], *KAPPA_RANGE, out=x[KAPPA])
    learnt = PH * np.sqrt(share)  # K S K' as a product with itself: what is symmetric stays so, to the last bit
    P = h.P - learnt[:, None] * learnt[None, :]
    fits = (1 - OUTLIER_SHARE) * np.exp(-0.5 * np.minimum(nis, 1e3)) / np.sqrt(2 * np.pi * S)
    log_weight = h.log_weight + np.where(valid, np.log(fits + OUTLIER_SHARE / OUTLIER_SPREAD), 0.0)
    return Hypotheses(x, P, log_weight - log_weight.max(axis=0)), Innovation(nis, taken)


def axes(theta: Array, xp: Any = np) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Unit vectors along and across (left of) the line from the target."""
    c, s = xp.cos(theta), xp.sin(theta)
    return (c, s), (-s, c)


def mixture(h: Hypotheses) -> tuple[Array, Array]:
    """Mean (8, B) and covariance (8, 8, B) of the weighted hypotheses; directions are averaged about the heaviest."""
    w = h.weight
    heaviest = h.x[THETA, h.log_weight.argmax(axis=0), np.arange(w.shape[1])]
    x = h.x.copy()
    x[THETA] = heaviest + wrap(x[THETA] - heaviest)
    mean = (w * x).sum(axis=1)
    apart = x - mean[:, None]
    return mean, (w * (h.P + apart[:, None] * apart[None, :])).sum(axis=2)


def polar(p: Array, P: Array) -> tuple[Array, Array]:
    """State (p_x, p_y, ...) of shape (8, B) with covariance (8, 8, B) as (r, theta, ...)."""
    r = np.maximum(np.hypot(p[0], p[1]), CLOSEST)
    n = p[:2] / r
    T = np.zeros_like(P)
    for i in range(2, STATES):
        T[i, i] = 1.0
    T[0, 0], T[0, 1], T[1, 0], T[1, 1] = n[0], n[1], -n[1] / r, n[0] / r
    x = p.copy()
    x[R], x[THETA] = r, np.arctan2(p[1], p[0])
    turned = np.einsum("ij...,jk...,lk...->il...", T, P, T)
    return x, (turned + np.swapaxes(turned, 0, 1)) / 2


def position(x: Array) -> Array:
    """p = vehicle - target (2, ...), m."""
    return x[R] * np.stack([np.cos(x[THETA]), np.sin(x[THETA])])


def drift(x: Array) -> Array:
    """d + g (2, ...), m/s."""
    return x[DX : DY + 1] + x[GX : GY + 1]
