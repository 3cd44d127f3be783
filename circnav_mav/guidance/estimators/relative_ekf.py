"""Extended Kalman filters of the relative motion, as arrays over hypotheses.

State x = (r, theta, d_x, d_y, kappa, b, g_x, g_y, f, l, e_x, e_y), shape (M, 12) for M
hypotheses:

    r, theta    range (m) and direction (rad) of p = vehicle - target
    d + g + e   wind - target velocity (m/s): d steady, g varying with time constant tau_g (gusts,
                side-slip, a turning target), e independent in each step (noise of heading and
                airspeed)
    kappa       true over measured airspeed
    b           slowly drifting error of the range (m), with time constant tau_b
    f, l        error of the measured acceleration, forward and to the left (m/s^2)

Frame: the paper's, rotated by the constant error of the compass. V: measured airspeed. u(psi): unit
vector of the heading psi.

    p' = v = kappa V u(psi) + d + g + e
    d' = white noise,   g' = -g/tau_g + white noise,   b' = -b/tau_b + white noise
    z = r + b + white noise,   measured acceleration = v' + (f, l) turned by psi + white noise

The acceleration measures changes of d + g + e independently of the heading. It reveals a gust, and
a vehicle that slips or lags, earlier than the range does. Without it, e is 0.

The state is polar because the measurement is then linear. A Cartesian filter linearizes each range
along a new bearing, which gives it false information on the bearing. In gusts its NEES (normalized
estimation error squared) reaches hundreds. The NEES of the polar filter stays near 2. The motion is
exact (its input is the chord of the air path) and linearized about the mean. Source: extended
Kalman filter in polar coordinates, as Aidala and Hammel, "Utilization of modified polar coordinates
for bearings-only tracking" (1983).
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.maths import Vector

Array = NDArray[np.float64]
STATES = 12
"""Number of states. Rows of the state: range, direction, drift, airspeed scale, range error, gust,
acceleration error, heading noise."""
R, THETA, DX, DY, KAPPA, B, GX, GY, FORWARD, LEFT, EX, EY = range(STATES)
DRIFT = np.zeros((2, STATES))
DRIFT[0, [DX, GX, EX]] = 1.0
DRIFT[1, [DY, GY, EY]] = 1.0
"""Matrix from the state to the total drift d + g + e, along x and y."""
MOVES = DRIFT[0] + 1j * DRIFT[1]
MOVES[EX:] /= 2
"""Displacement by the drift in a second, by the state, (12,): east + 1j north. The noise e lasts on
average half of a step."""
MOVED = 0.5 * DRIFT.sum(axis=0)
MOVED[EX:] = 1.0
"""Share of the growth over a step that moves the position with `MOVES`, by the state, (12,). The
drift grows linearly, so half of its growth moves the position. `MOVES` contains this half for the
noise e already."""
SPREADS = np.zeros(STATES)
SPREADS[[DX, GX, EX]] = 1 / 3, 1 / 3, 1 / 4
"""Variance of the position per variance of the growth over a step of 1 s, by the state, (12,)."""
BIAS_TIME = 2.0
"""Correlation time of the drifting range error, s. UWB and LoRa radios show 1 to 3 s."""
GUST_TIME = 10.0
"""Correlation time of gusts, s: the length scale of gusts near the ground (150 to 200 m), divided
by the speed of a small UAV."""
CLOSEST = 1.0
"""Lower bound of the range in the state, m. At the target the direction is singular."""
KAPPA_PSD = 1e-7
"""Process noise of kappa, 1/s. Without it, a change of the airspeed error by 10 % in ten minutes
causes a position error of 13 m after 20 min; with it, of 2 m."""
ACCELERATION_PSD = 1e-2
"""White noise of the measured acceleration, m^2/s^3, from vibration and delayed attitudes. The mean
over 0.1 s has a noise of 0.3 m/s^2."""
OUTLIER_SHARE = 0.05
"""Probability that a range or range rate is an outlier."""
OUTLIER_SPREAD = 100.0
"""Width of the interval over which outliers of the range are uniformly distributed, m."""


@dataclass(frozen=True)
class Noise:
    """Noise model of each of M hypotheses, arrays (M,).

    drift_psd: spectral density of the rate of change of the drift d, m^2/s^3.
    gust: standard deviation of each component of the gust g, m/s.
    white, drifting: standard deviations of the white and of the drifting range error, in units of
        the sample's sigma.
    nose: standard deviation of each component of e, the noise of heading and airspeed, m/s.
    acceleration_weight: 1 if the model uses the measured acceleration, else 0.
    scale_bounds: bounds of the airspeed scale kappa. Without bounds a filter can converge to a
        wrong solution.
    """

    drift_psd: Array
    gust: Array
    white: Array
    drifting: Array
    nose: Array
    acceleration_weight: Array
    scale_bounds: tuple[float, float]

    @cached_property
    def growth(self) -> Array:
        """Variances of the process noise before their factors of `transition`, (M, 12)."""
        none = np.zeros_like(self.gust)
        gust = self.gust**2
        nose = self.nose**2
        error = self.drifting**2
        scale = none + KAPPA_PSD
        psd = self.drift_psd
        rows = (none, none, psd, psd, scale, error, gust, gust, none, none, nose, nose)
        return np.stack(rows, axis=-1)


class VelocityChange(NamedTuple):
    """Measured acceleration over a step.

    change: integral of the measured acceleration, m/s.
    air: change of the velocity through the air V u(psi), with the measured airspeed, m/s.
    nose: integral of u(psi), s.
    across: airspeed times turn rate, m/s^2: acceleration across the nose in a turn.
    """

    change: Vector
    air: Vector
    nose: Vector
    across: float


class Hypotheses(NamedTuple):
    """M filters.

    x: states, (M, 12).
    P: covariances, (M, 12, 12).
    log_weight: logarithms of the unnormalized probabilities, (M,). The largest is 0.
    """

    x: Array
    P: Array
    log_weight: Array

    @property
    def weight(self) -> Array:
        """Probabilities of the hypotheses, (M,)."""
        weight = np.exp(self.log_weight)
        return np.asarray(weight / weight.sum())


class Measurement(NamedTuple):
    """A scalar measurement with the prediction of each of M hypotheses.

    innovation: measured minus predicted value, (M,).
    cross: covariance of the state and the predicted value, (M, 12).
    variance: variance of the innovation, (M,).
    outlier_spread: width of the interval over which outliers are uniformly distributed, in the unit
        of the value.
    """

    innovation: Array
    cross: Array
    variance: Array
    outlier_spread: float = OUTLIER_SPREAD


class Transition(NamedTuple):
    """Linearized motion and process noise of M hypotheses over a step.

    x: states after the step, (M, 12).
    J: Jacobian of range and direction, (M, 2, 12). The other rows of the Jacobian are diagonal.
    keep: factor of each of the other states, (12,).
    added: variances of the process noise, (M, 12).
    moved: covariances of the process noise: range and direction with the other states, (M, 2, 12).
    dt: duration of the step, s.
    """

    x: Array
    J: Array
    keep: Array
    added: Array
    moved: Array
    dt: float


def transition(
    h: Hypotheses, noise: Noise, dt: float, chord: Vector, sigma: float, accelerations: bool = False
) -> Transition:
    """Return the step of dt (s) along an air path with this chord, m, at the measured airspeed.

    sigma: standard deviation of the ranges, m.
    accelerations: True if accelerations were measured during dt. Otherwise e is 0.
    """
    r, theta, J = motion(h.x, dt, chord)
    keep = decay(dt)
    x = h.x * keep
    x[:, R] = r
    x[:, THETA] = theta
    error = (1 - keep[B] ** 2) * sigma**2
    gust = 1 - keep[GX] ** 2
    nose = 1.0 if accelerations and dt > 0 else 0.0
    factors = np.array((0, 0, dt, dt, dt, error, gust, gust, 0, 0, nose, nose))
    added = noise.growth * factors
    moved = J * (added * MOVED)[:, None]
    added[:, R] = added @ SPREADS * dt**2
    added[:, THETA] = added[:, R] / r**2
    return Transition(x, J, keep, added, moved, dt)


def predict(h: Hypotheses, step: Transition) -> Hypotheses:
    """Return the hypotheses after a step."""
    P = h.P * (step.keep[:, None] * step.keep)
    JP = step.J @ h.P
    place = JP @ step.J.swapaxes(1, 2)
    place[:, 1, 0] = place[:, 0, 1]
    rows = JP * step.keep + step.moved
    rows[:, :, :2] = place
    P[:, :2] = rows
    P[:, :, :2] = rows.swapaxes(1, 2)
    P.reshape(-1, STATES * STATES)[:, :: STATES + 1] += step.added
    return Hypotheses(step.x, P, h.log_weight * exp(-step.dt / 20.0))


def decay(dt: float) -> Array:
    """Return the factor of each state over dt (s), (12,). Range and direction change in `motion`
    instead."""
    bias = exp(-dt / BIAS_TIME)
    gust = exp(-dt / GUST_TIME)
    nose = 1.0 if dt <= 0 else 0.0
    return np.array((1.0, 1.0, 1.0, 1.0, 1.0, bias, gust, gust, 1.0, 1.0, nose, nose))


def motion(x: Array, dt: float, chord: Vector) -> tuple[Array, Array, Array]:
    """Return range (m) and direction (rad) of states x (..., 12) after dt (s) along a chord (m),
    and their Jacobian, (..., 2, 12).

    Complex numbers contain east and north components. Multiplying by conj(u) converts them to the
    components along and across the line of sight u.
    """
    moves = dt * MOVES
    moves[KAPPA] = complex(*chord)
    before = x.T[R]
    towards = np.exp(-1j * x.T[THETA])
    seen = before + (x @ moves) * towards
    r = np.maximum(np.abs(seen), CLOSEST)
    turned = seen.conj() * (1 / r)  # a division of complex numbers warns of NaN
    place = (towards * turned)[..., None] * moves
    place.T[R] = turned
    place.T[THETA] = 1j * before * turned
    J = np.empty((*x.shape[:-1], 2, STATES))
    J[..., 0, :] = place.real
    J[..., 1, :] = place.imag / r[..., None]
    theta = x.T[THETA] + np.arctan2(seen.imag, seen.real)
    return r, theta, J


def range_measurement(h: Hypotheses, noise: Noise, z: float, sigma: float) -> Measurement:
    """Return a range z (m) with standard deviation sigma (m) as a measurement for each
    hypothesis."""
    cross = h.P[:, R] + h.P[:, B]
    variance = np.maximum(cross[:, R] + cross[:, B], 0.0) + (noise.white * sigma) ** 2
    return Measurement(z - h.x[:, R] - h.x[:, B], cross, variance)


def rate_measurement(h: Hypotheses, r_dot: float, sigma: float, air: Vector) -> Measurement:
    """Return a range rate (m/s) with standard deviation sigma (m/s) as a measurement for each
    hypothesis.

    The range rate is n.(kappa V u(psi) + d + g + e) + white noise, with the unit vector n of p.

    air: velocity through the air V u(psi) at the same time, with the measured airspeed, m/s.
    """
    n = np.array((np.cos(h.x[:, THETA]), np.sin(h.x[:, THETA]))).T
    v = np.outer(h.x[:, KAPPA], air) + drift(h.x)
    H = n @ DRIFT
    H[:, THETA] = n[:, 0] * v[:, 1] - n[:, 1] * v[:, 0]
    H[:, KAPPA] = n @ air
    cross = (h.P @ H[..., None])[..., 0]
    # 0.1: added uncertainty of a measured range rate, as a share of V, if no accelerations are
    # used. (With accelerations, the noise of heading and airspeed is the state e.) A fifth of this
    # uncertainty is noise of heading and airspeed. The rest keeps the filter consistent in gusts:
    # the mean NEES is 2.4 with it, and 10 without it.
    nose = np.where(h.P[:, EX, EX] > 0, 0.0, 0.1 * np.hypot(*air)) ** 2
    variance = np.maximum((H * cross).sum(axis=1), 0.0) + sigma**2 + nose
    # 10.0: width of the interval over which outliers of the range rate are uniformly distributed,
    # m/s.
    return Measurement(r_dot - (n * v).sum(axis=1), cross, variance, 10.0)


def acceleration_measurements(
    h: Hypotheses, step: Transition, acceleration: VelocityChange
) -> tuple[Measurement, Measurement]:
    """Return the measured change of velocity as two uncorrelated measurements for each hypothesis
    after the step.

    change = kappa air + (d + g + e) after - (d + g + e) before + (f, l) turned by the nose + white
    noise

    h: hypotheses before the step.
    """
    c, s = acceleration.nose
    H = np.zeros((2, STATES))  # Jacobian by the states before the step
    # Estimate kappa from the turn rate of the gyros. The heading noise in `air` would bias kappa to
    # smaller values.
    H[:, KAPPA] = (-acceleration.across * s, acceleration.across * c)
    H[0, GX] = H[1, GY] = step.keep[GX] - 1
    H[:, FORWARD] = (c, s)
    H[:, LEFT] = (-s, c)
    H[0, EX] = H[1, EY] = -1.0
    expected = H.copy()
    expected[:, KAPPA] = acceleration.air
    innovation = np.array(acceleration.change) - h.x @ expected.T
    HP = H @ h.P
    variance = HP @ H.T
    variance.reshape(-1, 4)[:, ::3] += step.added @ DRIFT.T + ACCELERATION_PSD * step.dt
    cross = HP * step.keep + DRIFT * step.added[:, None]
    cross[:, :, :2] = HP @ step.J.swapaxes(1, 2) + DRIFT @ step.moved.swapaxes(1, 2)
    # The second component, without its regression on the first component.
    first = variance[:, 0, 0]
    slope = variance[:, 0, 1] / first
    rest = np.maximum(variance[:, 1, 1] - slope * variance[:, 0, 1], 1e-12)
    return (
        Measurement(innovation[:, 0], cross[:, 0], first),
        Measurement(
            innovation[:, 1] - slope * innovation[:, 0],
            cross[:, 1] - slope[:, None] * cross[:, 0],
            rest,
        ),
    )


Updated = tuple[Hypotheses, Array, NDArray[np.bool_]]
"""Hypotheses after a measurement, their normalized innovations squared (M,), and an array (M,) that
is True for each hypothesis that accepted the measurement."""


def correct(
    h: Hypotheses, noise: Noise, measured: Measurement, weight: Array | NDArray[np.bool_]
) -> Hypotheses:
    """Return the hypotheses corrected by a measurement.

    weight (M,): 1 for each hypothesis that uses the measurement, else 0.
    """
    share = weight / measured.variance
    x = h.x + measured.cross * (share * measured.innovation)[:, None]
    least, most = noise.scale_bounds
    x[:, R] = np.maximum(x[:, R], CLOSEST)
    x[:, KAPPA] = np.minimum(np.maximum(x[:, KAPPA], least), most)
    # K S K' = root root', which is exactly symmetric in floating point.
    root = measured.cross * np.sqrt(share)[:, None]
    return Hypotheses(x, h.P - root[:, :, None] * root[:, None], h.log_weight)


def update(h: Hypotheses, noise: Noise, measured: Measurement, gate: float) -> Updated:
    """Return the hypotheses after a measurement. Each hypothesis accepts or rejects the measurement
    by its own innovation. gate: in standard deviations."""
    nis = measured.innovation**2 / measured.variance
    accepted = nis < gate**2
    h = correct(h, noise, measured, accepted)
    fits = np.exp(-0.5 * np.minimum(nis, 1e3)) / np.sqrt(2 * np.pi * measured.variance)
    likelihood = (1 - OUTLIER_SHARE) * fits + OUTLIER_SHARE / measured.outlier_spread
    log_weight = h.log_weight + np.log(likelihood)
    return h._replace(log_weight=log_weight - log_weight.max()), nis, accepted


def mixture(h: Hypotheses) -> tuple[Array, Array]:
    """Return mean (12,) and covariance (12, 12) of the weighted hypotheses.

    Directions are averaged as differences from the direction of the most likely hypothesis."""
    weight = h.weight
    direction = h.x[h.log_weight.argmax(), THETA]
    x = h.x.copy()
    x[:, THETA] = direction + (x[:, THETA] - direction + np.pi) % (2 * np.pi) - np.pi
    mean = weight @ x
    apart = (x - mean) * np.sqrt(weight)[:, None]
    covariance = (weight @ h.P.reshape(-1, STATES * STATES)).reshape(STATES, STATES)
    return mean, covariance + apart.T @ apart


def polar(p: Array, P: Array) -> tuple[Array, Array]:
    """Convert a Cartesian state (p_x, p_y, ...), (12,), and its covariance (12, 12) to the polar
    state (r, theta, ...)."""
    r = max(float(np.hypot(p[0], p[1])), CLOSEST)
    east, north = p[:2] / r
    T = np.eye(STATES)
    T[:2, :2] = ((east, north), (-north / r, east / r))
    x = p.copy()
    x[R] = r
    x[THETA] = np.arctan2(p[1], p[0])
    turned = T @ P @ T.T
    return x, (turned + turned.T) / 2


def position(x: Array) -> Array:
    """Return p = vehicle - target (2, ...), m."""
    return np.asarray(x[R] * np.array((np.cos(x[THETA]), np.sin(x[THETA]))))


def drift(x: Array) -> Array:
    """Return the total drift d + g + e (..., 2), m/s."""
    return x[..., DX : DY + 1] + x[..., GX : GY + 1] + x[..., EX : EY + 1]
