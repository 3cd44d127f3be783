"""Extended Kalman filters of the relative motion, as arrays over hypotheses and flights.

State x = (r, theta, d_x, d_y, kappa, b, g_x, g_y, f, l, e_x, e_y), shape (12, M, B) for M
hypotheses of each of B flights:

    r, theta    range (m) and direction (rad) of p = vehicle - target
    d + g + e   wind - target velocity (m/s): d steady, g varying with time constant tau_g (gusts,
                side-slip, a turning target), e independent in each step (noise of heading and
                airspeed)
    kappa       true over measured airspeed
    b           slowly drifting error of the range (m)
    f, l        error of the measured acceleration, forward and to the left (m/s^2)

Frame: the paper's, rotated by the constant error of the compass. V: measured airspeed. u(psi): unit
vector of the heading psi.

    p' = v = kappa V u(psi) + d + g + e
    d' = white noise,   g' = -g/tau_g + white noise,   b' likewise
    z = r + b + white noise,   measured acceleration = v' + (f, l) turned by psi + white noise

The acceleration measures changes of d + g + e independently of the heading. It reveals a gust, and
a vehicle that slips or lags, earlier than the range does. Without it, e is 0.

The state is polar because the measurement is then linear. A Cartesian filter linearizes each range
along a new bearing, which gives it false information on the bearing. In gusts its NEES (normalized
estimation error squared) reaches hundreds; here it stays near 2. The motion is exact (its input is
the chord of the air path) and linearized about the mean. Source: extended Kalman filter in polar
coordinates, as Aidala and Hammel, "Utilization of modified polar coordinates for bearings-only
tracking" (1983).
"""

from typing import Any, NamedTuple

import numpy as np

from circnav_mav.guidance.maths import (
    Array,
    Batch,
    Number,
    arctan2,
    cos,
    exp,
    maximum,
    sin,
    unit,
    wrap,
)

R, THETA, DX, DY, KAPPA, B, GX, GY, FORWARD, LEFT, EX, EY = range(12)
STATES = 12
"""Rows of the state: range, direction, drift, airspeed scale, range error, gust, acceleration
error, heading noise."""
AXES = np.zeros((2, STATES, 1, 1))
AXES[0, [DX, GX, EX]] = AXES[1, [DY, GY, EY]] = 1.0
"""Selection of the states that are a drift to the east and to the north."""
BIAS_TIME = 2.0
"""Correlation time of the drifting range error, s: UWB and LoRa radios show 1 to 3 s."""
GUST_TIME = 10.0
"""Correlation time of gusts, s: their length scale near the ground, 150 to 200 m, divided by a
small UAV's speed."""
CLOSEST = 1.0
"""Smallest range of the state, m: the bearing is singular at the target."""
POSITION_PSD = 1e-4
KAPPA_PSD = 1e-7
"""Process noise of the position (m^2/s) and of kappa (1/s), for effects that are not modeled."""
ACCELERATION_PSD = 1e-2
"""White noise of the measured acceleration, m^2/s^3: 0.3 m/s^2 in a mean over 0.1 s, from vibration
and delayed attitudes."""
ACCELERATION_BIAS_TIME = 4000.0
"""Time, s, in which the error of the measured acceleration changes by its own standard
deviation."""
OUTLIER_SHARE = 0.05
OUTLIER_SPREAD = 100.0
"""Probability that a range is an outlier, and width of the interval over which outliers are
uniform, m."""
RATE_SPREAD = 10.0
"""Width of the interval over which outliers of the range rate are uniform, m/s."""
NOSE = 0.1
"""Added uncertainty of a measured range rate, as a share of V, if no accelerations are used. A
fifth is noise of heading and airspeed. The rest keeps the filter consistent in gusts (mean NEES
2.4, without it 10)."""
WEIGHT_MEMORY = 20.0
"""Time, s, in which the evidence for a hypothesis decays to 1/e."""


class Noise(NamedTuple):
    """Noise model of each of M hypotheses, arrays of shape (M, 1).

    drift_psd: spectral density of d', m^2/s^3. gust: standard deviation of each component of g,
    m/s. white, drifting: the two parts of the range error, in units of the sample's sigma. nose:
    standard deviation of each component of e, m/s. acceleration_weight: 1 if the model uses the
    measured acceleration, else 0. scale_bounds: bounds of kappa, an unbounded filter can lock on to
    a wrong mode. acceleration_bias: standard deviation of f and l, m/s^2.
    """

    drift_psd: Array
    gust: Array
    white: Array
    drifting: Array
    nose: Array = 0.0
    acceleration_weight: Array = 0.0
    scale_bounds: tuple[float, float] = (0.85, 1.15)
    acceleration_bias: float = 0.2


class VelocityChange(NamedTuple):
    """Measured acceleration over a step, arrays (2, B), or pairs for one flight.

    change: its integral, m/s. air: change of V u(psi) at the measured airspeed, m/s. nose: integral
    of u(psi), s. across: airspeed times turn rate, m/s^2, shape (B,) or one number.
    """

    change: Array
    air: Array
    nose: Array
    across: Array

    def of(self, flights: Any) -> "VelocityChange":
        """Return the selected flights."""
        return VelocityChange(*(part[..., flights] for part in self))


class Rates(NamedTuple):
    """Measured range rates of B flights, arrays (B,): r_dot and its sigma, m/s, where valid. air
    (2, B): V u(psi) at the same time and the measured airspeed, m/s."""

    r_dot: Array
    sigma: Array
    valid: Array
    air: Array

    def of(self, flights: Any) -> "Rates":
        """Return the selected flights."""
        return Rates(*(part[..., flights] for part in self))


class Hypotheses(NamedTuple):
    """M filters for each of B flights: x (12, M, B), P (12, 12, M, B), log_weight (M, B) with
    maximum 0 per flight."""

    x: Array
    P: Array
    log_weight: Array

    @property
    def weight(self) -> Array:
        """Probabilities of the hypotheses, shape (M, B)."""
        weight = np.exp(self.log_weight)
        return weight / weight.sum(axis=0)


def predict(
    h: Hypotheses,
    noise: Noise,
    dt: Batch,
    chord: Batch,
    sigma: Batch,
    felt: VelocityChange | None = None,
) -> Hypotheses:
    """Return the hypotheses predicted by dt (B,), s, along air paths with chords (2, B), m, at the
    measured airspeed.

    sigma (B,): standard deviation of the ranges, m. felt: acceleration measured during dt, if any.
    """
    # decay of each state other than range and direction
    keep = np.ones((STATES, 1, dt.size))
    x = h.x
    P = h.P
    keep[B], keep[GX:FORWARD], keep[EX:] = np.exp(-dt / BIAS_TIME), np.exp(-dt / GUST_TIME), dt <= 0
    r, theta, row = motion(x, dt, chord)
    place = np.zeros(x.shape, complex)
    for state, entry in row:
        place[state] = entry
    # Jacobian rows of range and direction after the step, and of the measured acceleration, by the
    # states before
    rows = np.empty((2 if felt is None else 4, *x.shape))
    rows[0], rows[1] = place.real, place.imag / r
    # effect of the drift's process noise
    half = rows[:2, DX:KAPPA] / 2
    lever = np.zeros(rows.shape)
    lever[:2, DX:KAPPA] = lever[:2, GX:FORWARD] = lever[:2, EX:] = half
    if felt is not None:
        rows[2:], lever[2:] = _acceleration_rows(felt, keep), AXES
    moved = np.einsum("ik...,kj...->ij...", rows, P)
    near = np.einsum("ik...,jk...->ij...", moved, rows)
    moved *= keep
    steady, gusty = steps(noise.drift_psd, noise.gust, dt)
    fresh = 0.0 if felt is None else (dt > 0) * noise.nose**2
    q = np.zeros(x.shape)  # process noise of each state
    q[DX:KAPPA], q[GX:FORWARD], q[EX:] = steady, gusty, fresh
    moved += lever * q
    q[KAPPA], q[B] = KAPPA_PSD * dt, (1 - keep[B] ** 2) * (noise.drifting * sigma) ** 2
    q[FORWARD:EX] = noise.acceleration_bias**2 / ACCELERATION_BIAS_TIME * dt
    wander = wandered(steady, gusty, dt) + fresh * (dt / 2) ** 2
    near[0, 0] += wander
    near[1, 1] += wander / r**2
    near[1, 0] = near[0, 1]
    x = x * keep
    P = P * (keep[:, None] * keep)
    x[R], x[THETA] = r, theta
    P[:2], P[:, :2] = moved[:2], np.swapaxes(moved[:2], 0, 1)
    P[:2, :2] = near[:2, :2]
    variances = np.einsum("ii...->i...", P)
    variances += q
    if felt is not None:
        all_ = steady + gusty + fresh
        moved[2:, :2] = near[2:, :2] + np.swapaxes(half, 0, 1) * all_
        acceleration_noise = all_ + ACCELERATION_PSD * dt
        expected = felt.air[:, None] * h.x[KAPPA] + (rows[2:, GX:] * h.x[GX:]).sum(axis=1)
        _correct(
            x,
            P,
            noise.acceleration_weight,
            moved[2:],
            near[2:, 2:],
            acceleration_noise,
            felt.change[:, None] - expected,
            noise.scale_bounds,
        )
    return Hypotheses(x, P, h.log_weight * np.exp(-dt / WEIGHT_MEMORY))


def _acceleration_rows(felt: VelocityChange, keep: Batch) -> Array:
    """Return the Jacobian of the measured change of velocity by the states before the step, (2, 12,
    1, B):

    change = kappa air + (d + g + e) after - (d + g + e) before + (f, l) turned by the nose + white
    noise
    """
    c, s = felt.nose
    rows = np.zeros((2, STATES, 1, c.size))
    # kappa is estimated from the turn rate of the gyros: the heading noise in `air` would bias it
    # low
    rows[0, KAPPA], rows[1, KAPPA] = -felt.across * s, felt.across * c
    rows[0, GX] = rows[1, GY] = keep[GX] - 1
    rows[0, FORWARD] = rows[1, LEFT] = c
    rows[0, LEFT], rows[1, FORWARD] = -s, s
    rows[0, EX] = rows[1, EY] = -1.0
    return rows


def _correct(
    x: Batch, P: Batch, acceleration_weight: Batch, C: Batch, S: Batch, noise: Batch, nu: Batch,
    bounds: tuple[float, float],
) -> None:  # fmt: skip
    """Correct x and P in place by two measurements, for the models that use them
    (`acceleration_weight`).

    C (2, 12, M, B): covariance of measurements and state. S (2, 2, M, B): covariance of the
    predicted measurements. noise (M, B): variance of each measurement. nu (2, M, B): innovations.
    bounds: of kappa.
    """
    # Solving the 2 x 2 system by its Cholesky factor keeps P symmetric.
    a = np.sqrt(S[0, 0] + noise)
    b = S[0, 1] / a
    e = np.sqrt(np.maximum(S[1, 1] + noise - b * b, 1e-12))
    gain = C / a
    gain[1] = (C[1] - b * gain[0]) / e
    gain *= acceleration_weight
    first = nu[0] / a
    x += gain[0] * first + gain[1] * ((nu[1] - b * first) / e)
    P -= np.einsum("ki...,kj...->ij...", gain, gain)
    _within_bounds(x, bounds)


def _within_bounds(x: Batch, bounds: tuple[float, float]) -> None:
    np.maximum(x[R], CLOSEST, out=x[R])
    least, most = bounds
    np.minimum(np.maximum(x[KAPPA], least), most, out=x[KAPPA])


def motion(x: Any, dt: Number, chord: Any) -> tuple[Array, Array, tuple[tuple[int, Array], ...]]:
    """Return range (m) and direction (rad) after dt (s) along a chord (m), and their Jacobian as
    (state, entry) pairs.

    An entry's real part is the derivative of the range. Its imaginary part is the derivative of the
    direction, times the range. States without effect are omitted. x: by state, arrays or floats.
    Complex numbers hold east and north. Multiplying by conj(u) converts them to along and across
    the line of sight u.
    """
    towards = unit(-x[THETA])
    path = chord[0] + 1j * chord[1]
    drifts = x[DX] + x[GX] + x[EX] / 2 + 1j * (x[DY] + x[GY] + x[EY] / 2)
    seen = x[R] + (x[KAPPA] * path + drifts * dt) * towards
    turn = arctan2(seen.imag, seen.real)
    turned = unit(-turn)
    after = towards * turned
    east = after * dt
    north = 1j * east
    row = (
        (R, turned),
        (THETA, 1j * x[R] * turned),
        (DX, east),
        (DY, north),
        (KAPPA, after * path),
        (GX, east),
        (GY, north),
        (EX, east / 2),
        (EY, north / 2),
    )
    return maximum(abs(seen), CLOSEST), x[THETA] + turn, row


def steps(drift_psd: Number, gust: Number, dt: Number) -> tuple[Array, Array]:
    """Return the growth of the variances of d and g in dt, m^2/s^2."""
    return drift_psd * dt, (1 - exp(-2 * dt / GUST_TIME)) * gust**2


def wandered(steady: Number, gusty: Number, dt: Number) -> Array:
    """Return the process noise of the position in dt, m^2, from the growth `steady` and `gusty` of
    the drift."""
    return (steady + gusty) * (dt**2 / 3) + POSITION_PSD * dt


Updated = tuple[Hypotheses, Array, Array]
"""Hypotheses after a measurement, their normalized innovation squared (M, B), and True (M, B) where
it was accepted."""


def update(
    h: Hypotheses, noise: Noise, z: Batch, sigma: Batch, valid: Batch, gate: float
) -> Updated:
    """Add one range per flight, z and sigma (B,), m, where valid (B,). Each hypothesis has its own
    gate."""
    PH = h.P[:, R] + h.P[:, B]
    S = np.maximum(PH[R] + PH[B], 0.0) + (noise.white * sigma) ** 2
    return _fused(h, noise, PH, z - h.x[R] - h.x[B], S, valid, gate, OUTLIER_SPREAD)


def update_rate(h: Hypotheses, noise: Noise, rates: Rates, gate: float) -> Hypotheses:
    """Add a range rate per flight: z = n.(kappa V u(psi) + d + g + e) + white noise, n = unit
    vector of p."""
    n, t = axes(h.x[THETA])
    vx, vy = (h.x[KAPPA] * air + d for air, d in zip(rates.air, drift(h.x), strict=True))
    along = n[0] * vx + n[1] * vy
    across = t[0] * vx + t[1] * vy
    ahead = n[0] * rates.air[0] + n[1] * rates.air[1]
    H = (
        (THETA, across),
        (KAPPA, ahead),
        *((x, n[0]) for x in (DX, GX, EX)),
        *((y, n[1]) for y in (DY, GY, EY)),
    )
    PH = sum(of * h.P[:, state] for state, of in H)
    # with accelerations, the noise of the heading is a state: e
    nose = np.where(h.P[EX, EX] > 0, 0.0, NOSE * np.hypot(*rates.air)) ** 2
    S = np.maximum(sum(of * PH[state] for state, of in H), 0.0) + rates.sigma**2 + nose
    return _fused(h, noise, PH, rates.r_dot - along, S, rates.valid, gate, RATE_SPREAD)[0]


def _fused(
    h: Hypotheses,
    noise: Noise,
    PH: Batch,
    nu: Batch,
    S: Batch,
    valid: Batch,
    gate: float,
    spread: float,
) -> Updated:
    """Return the hypotheses after a measurement with innovation nu of variance S. PH: covariance of
    states and measurement. spread: width of the uniform distribution of outliers."""
    nis = nu**2 / S
    taken = valid & (nis < gate**2)
    share = taken / S
    x = h.x + PH * (share * nu)
    _within_bounds(x, noise.scale_bounds)
    learnt = PH * np.sqrt(share)  # K S K' as a product with itself stays exactly symmetric
    P = h.P - learnt[:, None] * learnt[None, :]
    fits = (1 - OUTLIER_SHARE) * np.exp(-0.5 * np.minimum(nis, 1e3)) / np.sqrt(2 * np.pi * S)
    log_weight = h.log_weight + np.where(valid, np.log(fits + OUTLIER_SHARE / spread), 0.0)
    return Hypotheses(x, P, log_weight - log_weight.max(axis=0)), nis, taken


def axes(theta: Number) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the unit vectors along and across (left of) the line from the target."""
    c = cos(theta)
    s = sin(theta)
    return (c, s), (-s, c)


def mixture(h: Hypotheses) -> tuple[Array, Array]:
    """Return mean (12, B) and covariance (12, 12, B) of the weighted hypotheses.

    Directions are averaged about the most likely hypothesis's direction."""
    w = h.weight
    heaviest = h.x[THETA, h.log_weight.argmax(axis=0), np.arange(w.shape[1])]
    x = h.x.copy()
    x[THETA] = heaviest + wrap(x[THETA] - heaviest)
    mean = np.einsum("mb,imb->ib", w, x)
    apart = (x - mean[:, None]) * np.sqrt(w)
    return mean, np.einsum("mb,ijmb->ijb", w, h.P) + np.einsum("imb,jmb->ijb", apart, apart)


def polar(p: Batch, P: Batch) -> tuple[Array, Array]:
    """Return a Cartesian state (p_x, p_y, ...), (12, B), and its covariance (12, 12, B) as (r,
    theta, ...)."""
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


def position(x: Batch) -> Array:
    """Return p = vehicle - target (2, ...), m."""
    return x[R] * np.stack([np.cos(x[THETA]), np.sin(x[THETA])])


def drift(x: Batch) -> Array:
    """Return d + g + e (2, ...), m/s."""
    return x[DX : DY + 1] + x[GX : GY + 1] + x[EX : EY + 1]
