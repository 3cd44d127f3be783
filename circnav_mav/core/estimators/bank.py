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

from circnav_mav.core.air_path import wrap

Array = Any
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
    """Carry on by dt (s, scalar or (B,)) along an air path whose chord is (2, B), in m at the measured airspeed."""
    x, P = h.x.copy(), h.P.copy()
    fade, calm = np.exp(-dt / BIAS_TIME), np.exp(-dt / GUST_TIME)
    n, t = _axes(h.x[THETA])
    r, x[R], turn = h.x[R], *_moved(h.x, n, t, dt, chord)
    x[THETA] += turn
    x[B] *= fade
    x[GX:] *= calm
    n1, t1 = _axes(x[THETA])
    c, s = np.cos(turn), np.sin(turn)
    for of in (_rows(P), _columns(P)):
        east, north = (of(DX) + of(GX)) * dt + of(KAPPA) * chord[0], (of(DY) + of(GY)) * dt + of(KAPPA) * chord[1]
        along = c * of(R) + (r * s) * of(THETA) + n1[0] * east + n1[1] * north
        across = (r * c) * of(THETA) - s * of(R) + t1[0] * east + t1[1] * north
        of(R)[...], of(THETA)[...] = along, across / x[R]
        of(B)[...] *= fade
        of(GX)[...] *= calm
        of(GY)[...] *= calm
    steady, gusty = noise.drift_psd * dt, (1 - calm**2) * noise.gust**2
    moved = (steady + gusty) * (dt**2 / 3) + POSITION_PSD * dt
    P[R, R] += moved
    P[THETA, THETA] += moved / x[R] ** 2
    for first, q in ((DX, steady), (GX, gusty)):
        for axis in (0, 1):
            d = first + axis
            P[R, d] += n1[axis] * (q * dt / 2)
            P[d, R] = P[R, d]
            P[THETA, d] += t1[axis] * (q * dt / 2) / x[R]
            P[d, THETA] = P[THETA, d]
            P[d, d] += q
    P[KAPPA, KAPPA] += KAPPA_PSD * dt
    P[B, B] += (1 - fade**2) * (noise.drifting * sigma) ** 2
    return Hypotheses(x, P, h.log_weight * np.exp(-dt / WEIGHT_MEMORY))


def update(
    h: Hypotheses, noise: Noise, z: Array, sigma: Array, valid: Array, gate: float
) -> tuple[Hypotheses, Innovation]:
    """Take in one range per flight, z and sigma (B,), where valid (B,); per hypothesis refuse it outside the gate."""
    PH = h.P[:, R] + h.P[:, B]
    S = PH[R] + PH[B] + (noise.white * sigma) ** 2
    nu = z - h.x[R] - h.x[B]
    nis = nu**2 / S
    taken = valid & (nis < gate**2)
    K = PH * (taken / S)
    x = h.x + K * nu
    np.maximum(x[R], CLOSEST, out=x[R])
    np.clip(x[KAPPA], *KAPPA_RANGE, out=x[KAPPA])
    P = h.P - K[:, None] * PH[None, :]
    fits = (1 - OUTLIER_SHARE) * np.exp(-0.5 * np.minimum(nis, 1e3)) / np.sqrt(2 * np.pi * S)
    log_weight = h.log_weight + np.where(valid, np.log(fits + OUTLIER_SHARE / OUTLIER_SPREAD), 0.0)
    return Hypotheses(x, P, log_weight - log_weight.max(axis=0)), Innovation(nis, taken)


def _axes(theta: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Unit vectors along and across (left of) the line from the target."""
    c, s = np.cos(theta), np.sin(theta)
    return (c, s), (-s, c)


def _moved(x: Array, n: Any, t: Any, dt: Array, chord: Array) -> tuple[Array, Array]:
    """Range after the step, and the angle that p has turned."""
    step = x[KAPPA] * chord[0] + (x[DX] + x[GX]) * dt, x[KAPPA] * chord[1] + (x[DY] + x[GY]) * dt
    along, across = x[R] + n[0] * step[0] + n[1] * step[1], t[0] * step[0] + t[1] * step[1]
    return np.maximum(np.hypot(along, across), CLOSEST), np.arctan2(across, along)


def _rows(P: Array) -> Any:
    return lambda i: P[i]


def _columns(P: Array) -> Any:
    return lambda i: P[:, i]


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
    return x, np.einsum("ij...,jk...,lk...->il...", T, P, T)


def position(x: Array) -> Array:
    """p = vehicle - target (2, ...), m."""
    return x[R] * np.stack([np.cos(x[THETA]), np.sin(x[THETA])])


def drift(x: Array) -> Array:
    """d + g (2, ...), m/s."""
    return x[DX : DY + 1] + x[GX : GY + 1]
