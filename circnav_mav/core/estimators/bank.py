"""The relative-motion filters as arrays: one step serves one flight and a thousand, one hypothesis and thirty-two.

State x = (p_x, p_y, d_x, d_y, kappa, b), shape (6, M, B) for M hypotheses of each of B flights:
p = vehicle - target (m), d = wind - target velocity (m/s), kappa = true over measured airspeed, b = slowly drifting
error of the range (m). Frame: the paper's (x right, y up), turned by whatever constant error the compass has.

    p' = kappa V u(psi) + d,   d' = white noise,   b' = -b/tau + white noise,   z = |p| + b + white noise

The motion is linear and exact (the air path comes in as a chord); only the range is not, and it is taken to second
order: an uncertainty sigma_t across the line of sight makes |p| longer by sigma_t^2/(2r) and adds (sigma_t^2/r)^2/2
to its variance. Source: extended Kalman filter with second-order terms, Bar-Shalom, Li, Kirubarajan (2001), ch. 10.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any
PX, PY, DX, DY, KAPPA, B = range(6)
STATES = 6
BIAS_TIME = 2.0
"""Correlation time of the drifting range error, s: what UWB and LoRa radios show (1..3 s)."""
KAPPA_RANGE = (0.85, 1.15)
"""Airspeed sensors err by no more; without the clamp a filter can lock on a wrong mode."""
POSITION_PSD, KAPPA_PSD = 1e-4, 1e-7
"""Process noise for what the model leaves out: m^2/s and 1/s."""
OUTLIER_SHARE, OUTLIER_SPREAD = 0.05, 100.0
"""A range may be worthless: with this probability it is anywhere within so many metres."""
WEIGHT_MEMORY = 20.0
"""Time, s, after which the evidence for a hypothesis counts 1/e."""


@dataclass(frozen=True, slots=True)
class Noise:
    """What each of M hypotheses assumes, arrays of shape (M, 1).

    drift_psd: of d', m^2/s^3. white, drifting: the range error's two parts, in units of the sample's sigma.
    """

    drift_psd: Array
    white: Array
    drifting: Array


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """M filters for each of B flights: x (6, M, B), P (6, 6, M, B), log_weight (M, B) with maximum 0 per flight."""

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


def ring(r: Array, sigma: Array, count: int, drift_sigma: float, kappa_sigma: float = 0.05) -> Hypotheses:
    """Hypotheses all round a target that was ranged at r (B,): equal weights, drift unknown."""
    angle = 2 * np.pi * np.arange(count)[:, None] / count
    r, sigma = np.broadcast_arrays(np.asarray(r, float), np.asarray(sigma, float))
    n = np.stack([np.cos(angle), np.sin(angle)])
    x = np.zeros((STATES, count, r.size))
    x[PX], x[PY], x[KAPPA] = n[0] * r, n[1] * r, 1.0
    P = np.zeros((STATES, STATES, count, r.size))
    along, across = 2 * sigma**2, (np.pi * r / count) ** 2
    P[PX, PX] = n[0] ** 2 * along + n[1] ** 2 * across
    P[PY, PY] = n[1] ** 2 * along + n[0] ** 2 * across
    P[PX, PY] = P[PY, PX] = n[0] * n[1] * (along - across)
    P[DX, DX] = P[DY, DY] = drift_sigma**2
    P[KAPPA, KAPPA] = kappa_sigma**2
    P[B, B] = sigma**2
    return Hypotheses(x, P, np.zeros((count, r.size)))


def predict(h: Hypotheses, noise: Noise, dt: Array, chord: Array, sigma: Array) -> Hypotheses:
    """Carry on by dt (B,) along an air path whose chord is (2, B), in m at the measured airspeed."""
    x, P = h.x.copy(), h.P.copy()
    fade = np.exp(-dt / BIAS_TIME)
    x[PX] += x[DX] * dt + x[KAPPA] * chord[0]
    x[PY] += x[DY] * dt + x[KAPPA] * chord[1]
    x[B] *= fade
    P[PX] += P[DX] * dt + P[KAPPA] * chord[0]
    P[PY] += P[DY] * dt + P[KAPPA] * chord[1]
    P[:, PX] += P[:, DX] * dt + P[:, KAPPA] * chord[0]
    P[:, PY] += P[:, DY] * dt + P[:, KAPPA] * chord[1]
    P[B] *= fade
    P[:, B] *= fade
    q = noise.drift_psd * dt
    for p, d in ((PX, DX), (PY, DY)):
        P[p, p] += q * (dt**2 / 3) + POSITION_PSD * dt
        P[p, d] += q * (dt / 2)
        P[d, p] += q * (dt / 2)
        P[d, d] += q
    P[KAPPA, KAPPA] += KAPPA_PSD * dt
    P[B, B] += (1 - fade**2) * (noise.drifting * sigma) ** 2
    return Hypotheses(x, P, h.log_weight * np.exp(-dt / WEIGHT_MEMORY))


def update(
    h: Hypotheses, noise: Noise, z: Array, sigma: Array, valid: Array, gate: float
) -> tuple[Hypotheses, Innovation]:
    """Take in one range per flight, z and sigma (B,), where valid (B,); per hypothesis refuse it outside the gate."""
    x, P = h.x, h.P
    r = np.maximum(np.hypot(x[PX], x[PY]), 1e-3)
    n, t = (x[PX] / r, x[PY] / r), (-x[PY] / r, x[PX] / r)
    PH = n[0] * P[:, PX] + n[1] * P[:, PY] + P[:, B]
    across = t[0] ** 2 * P[PX, PX] + 2 * t[0] * t[1] * P[PX, PY] + t[1] ** 2 * P[PY, PY]
    bend = across / r
    S = n[0] * PH[PX] + n[1] * PH[PY] + PH[B] + (noise.white * sigma) ** 2 + 0.5 * bend**2
    nu = z - r - x[B] - 0.5 * bend
    nis = nu**2 / S
    taken = valid & (nis < gate**2)
    K = PH * (taken / S)
    x = x + K * nu
    np.clip(x[KAPPA], *KAPPA_RANGE, out=x[KAPPA])
    P = P - K[:, None] * PH[None, :]
    fits = (1 - OUTLIER_SHARE) * np.exp(-0.5 * np.minimum(nis, 1e3)) / np.sqrt(2 * np.pi * S)
    log_weight = h.log_weight + np.where(valid, np.log(fits + OUTLIER_SHARE / OUTLIER_SPREAD), 0.0)
    log_weight = log_weight - log_weight.max(axis=0)
    return Hypotheses(x, P, log_weight), Innovation(nis, taken)


def mixture(h: Hypotheses) -> tuple[Array, Array]:
    """Mean (6, B) and covariance (6, 6, B) of the weighted hypotheses."""
    w = h.weight
    mean = (w * h.x).sum(axis=1)
    apart = h.x - mean[:, None]
    return mean, (w * (h.P + apart[:, None] * apart[None, :])).sum(axis=2)
