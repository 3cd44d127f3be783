"""Tracking of the target by one Kalman filter per noise model, weighted by its likelihood. The
models assume a steady to gusty drift, and a white to drifting range error.

A model of negligible weight restarts from the mixture of its kind. There are two kinds: models that
use accelerations, and models that do not. The latter also supply the airspeed scale of the former.
"""

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.estimators import relative_ekf as ekf
from circnav_mav.guidance.estimators.acquisition import DRIFT_MOST, Estimate, Solution
from circnav_mav.guidance.estimators.interface import EstimatorSettings, MethodChange
from circnav_mav.guidance.estimators.relative_ekf import (
    KAPPA,
    STATES,
    THETA,
    Array,
    Hypotheses,
    Noise,
    R,
    VelocityChange,
)
from circnav_mav.guidance.maths import Vector

TRUSTED = 0.25
"""Standard deviation of the position, as a share of the range, below which an estimate begins to
steer."""
KEPT = 0.5
"""Standard deviation of the position, as a share of the range, above which a steering estimate
stops steering."""
LOST = 0.6
"""Standard deviation of the position, as a share of the range, above which the estimate is
discarded and the filter searches again."""
MISSED = 0.5
"""Share of recent samples outside the gate above which the filter searches again."""
RECENT = 3.0
"""Time constant of the share of recent samples outside the gate, s."""
SLOW = 3e-4
"""Spectral density of the rate of change of a slowly changing drift, m^2/s^3."""
WHITE = (1, 0)
"""Range error of a model with white noise alone: white and drifting part, in units of sigma."""
DRIFTING = (0.4, 0.9)
"""Range error of a model for radios whose error changes slowly: white and drifting part, in units
of sigma."""
MODELS = (
    (0, 0, 0, 0, *WHITE),  # steady drift
    (0, 0, 0, 0, *DRIFTING),
    (SLOW, 0, 0, 0, *WHITE),  # changes slowly
    (SLOW, 0, 0, 0, *DRIFTING),
    (5e-2, 0, 0, 0, *WHITE),  # changes quickly
    (1e-2, 0.1, 0, 0, *WHITE),  # gusts
    (0, 0.08, 0, 0, *WHITE),  # gusts in a steady wind
    (0, 0.02, 0, 0, *WHITE),  # weak gusts, or a heading that is wrong by 1 deg for seconds
    (SLOW, 0.2, 0.03, 1, *WHITE),  # gusts and a veering wind, measured by the accelerometers
)
"""Noise models. Columns: drift_psd (m^2/s^3), gust (as a share of V), nose (as a share of V),
acceleration_weight, white, drifting, as in `Noise`. Only models with a steady or slowly changing
drift have a drifting range error: with other drifts it cannot be observed."""
FORGOTTEN = -10.0
"""Log weight below which a model restarts from the mixture. The heaviest model has 0."""
REVIVED = FORGOTTEN / 2
"""Log weight of a model after its restart."""
AS_STEADY = np.eye(STATES)
AS_STEADY[[ekf.DX, ekf.DY], [ekf.GX, ekf.GY]] = 1.0
AS_STEADY[[ekf.GX, ekf.GY], [ekf.GX, ekf.GY]] = 0.0
"""Matrix that adds the gust to the steady drift."""


class Rate(NamedTuple):
    """Measured range rate.

    r_dot: range rate, m/s.
    sigma: standard deviation of r_dot, m/s.
    air: velocity through the air V u(psi) at the same time, with the measured airspeed V, m/s.
    """

    r_dot: float
    sigma: float
    air: Vector


class Tracker:
    """Kalman filters of all noise models.

    noise: noise models.
    tracks: hypotheses of the models.
    estimate: mixture of the hypotheses.
    nis: normalized innovation squared of the most likely model; None before the first range.
    refused: True if the last range was rejected.
    missed: share of recent ranges outside the gate.
    """

    def __init__(
        self, settings: EstimatorSettings, mean: Array, covariance: Array, trusted: bool = False
    ) -> None:
        """mean (12,), covariance (12, 12): initial estimate of every model."""
        self._settings = settings
        models = np.array(MODELS)
        models[:, 1:3] *= settings.speed
        psd, gust, nose, acceleration_weight, white, drifting = models.T
        bounds = settings.scale_bounds
        self.noise = Noise(psd, gust, white, drifting, nose, acceleration_weight, bounds)
        self._averaged = np.array((psd, gust, acceleration_weight))
        self._uses_accelerations = acceleration_weight > 0
        x = np.repeat(mean[None], len(MODELS), axis=0)
        P = np.repeat(covariance[None], len(MODELS), axis=0)
        self.tracks = Hypotheses(x, P, np.zeros(len(MODELS)))
        self.estimate = self._estimate(mean, covariance, self.tracks.weight, trusted)
        self.nis: float | None = None
        self.refused = False
        self.missed = 0.0

    @classmethod
    def located(cls, settings: EstimatorSettings, solution: Solution, sigma: float) -> "Tracker":
        """Return a tracker that starts from the solution of an acquisition. sigma: standard
        deviation of the ranges, m."""
        known = slice(0, ekf.B)
        mean = np.zeros(STATES)
        mean[known] = solution.x
        sigmas = np.zeros(STATES)
        sigmas[ekf.B] = 0.5 * sigma
        sigmas[[ekf.GX, ekf.GY]] = 0.02 * settings.speed
        sigmas[[ekf.FORWARD, ekf.LEFT]] = settings.acceleration_bias
        covariance = np.diag(sigmas**2)
        covariance[known, known] = solution.P
        return cls(settings, *ekf.polar(mean, covariance))

    def through_air(self, change: MethodChange) -> "Tracker":
        """Return a tracker that continues this track with own motion through the air. This tracker
        uses own motion over the ground."""
        mean = self.estimate.mean.copy()
        covariance = self.estimate.covariance.copy()
        mean[ekf.DX] += change.wind[0]
        mean[ekf.DY] += change.wind[1]
        mean[KAPPA] = 1.0
        covariance[ekf.DX, ekf.DX] += change.wind_sigma**2
        covariance[ekf.DY, ekf.DY] += change.wind_sigma**2
        bias = change.settings.acceleration_bias
        for state, sigma in (
            (KAPPA, change.scale_sigma),
            (ekf.FORWARD, bias),
            (ekf.LEFT, bias),
        ):
            covariance[state] = 0.0
            covariance[:, state] = 0.0
            covariance[state, state] = sigma**2
        return Tracker(change.settings, mean, covariance, self.estimate.trusted)

    @property
    def lost(self) -> bool:
        """True if the estimate is inconsistent, and the target must be acquired again."""
        estimate = self.estimate
        return not (
            estimate.finite
            and self.missed <= MISSED
            and estimate.spread <= LOST
            and hypot(*ekf.drift(estimate.mean)) <= DRIFT_MOST * self._settings.speed
        )

    def observe(
        self,
        dt: float,
        chord: Vector,
        z: float | None,
        sigma: float,
        since: float,
        acceleration: VelocityChange | None = None,
        rate: Rate | None = None,
    ) -> None:
        """Predict by dt (s) along a chord (m), and add the measurements at its end.

        z: range, m, or None.
        sigma: standard deviation of ranges, m.
        since: time since the range before, s.
        acceleration: measured during dt.
        rate: range rate.
        """
        h = self.tracks
        noise = self.noise
        gate = self._settings.gate
        if dt > 0:  # 0 for a rate measured at the same time as its range
            step = ekf.transition(h, noise, dt, chord, sigma, acceleration is not None)
            before = h
            h = ekf.predict(h, step)
            if acceleration is not None:
                for one in ekf.acceleration_measurements(before, step, acceleration):
                    h = ekf.correct(h, noise, one, noise.acceleration_weight)
        if z is not None:
            h, nis, accepted = ekf.update(h, noise, ekf.range_measurement(h, noise, z, sigma), gate)
            heaviest = h.log_weight.argmax()
            self.nis = float(nis[heaviest])
            self.refused = not accepted[heaviest]
            self.missed += (self.refused - self.missed) * since / (RECENT + since)
        if rate is not None:
            h, _, _ = ekf.update(h, noise, ekf.rate_measurement(h, *rate), gate)
        mean, covariance = ekf.mixture(h)
        h = _revive(h, self._uses_accelerations, mean, covariance)
        weight = h.weight
        self.tracks = _supply_scale(h, weight, self._uses_accelerations)
        self.estimate = self._estimate(mean, covariance, weight, self.estimate.trusted)

    def _estimate(self, mean: Array, covariance: Array, weight: Array, trusted: bool) -> Estimate:
        """Return the mixture as an estimate.

        weight: probabilities of the models, (M,).
        trusted: True if the estimate before could steer.
        """
        r = max(mean.item(R), 1.0)
        variance = covariance.item(R, R) / r**2 + covariance.item(THETA, THETA)
        spread = sqrt(max(variance, 0.0))
        drift_psd, gust, acceleration_weight = (self._averaged @ weight).tolist()
        # Hysteresis: an estimate that steers is used until it is much worse. Even then it holds the
        # circle better than a range-only law. A single bound would switch the law whenever the
        # spread fluctuates around this bound.
        return Estimate(
            mean,
            covariance,
            spread=spread,
            trusted=spread < (KEPT if trusted else TRUSTED),
            drift_psd=drift_psd,
            gust=gust,
            acceleration_weight=acceleration_weight,
        )


def _revive(
    h: Hypotheses, uses_accelerations: NDArray[np.bool_], mean: Array, covariance: Array
) -> Hypotheses:
    """Return the hypotheses with the models of negligible weight restarted.

    uses_accelerations: for each model, (M,).
    mean (12,), covariance (12, 12): mixture of all models.

    Each model restarts from the mixture of its own kind. If no model of this kind is left, the
    model restarts from the mixture of all models. A restarted model takes the whole drift for
    steady. After a change of the wind, the models that followed it contain the change as a gust.
    With this gust, the models of a steady wind would expect the old wind to return, and would fail
    again.

    Models that use accelerations can mistake a wrong airspeed for a gust that turns with the
    heading. The other models reveal this error only if they do not restart from an estimate with
    this error.
    """
    forgotten = h.log_weight < FORGOTTEN
    if not forgotten.any():
        return h
    x = h.x.copy()
    P = h.P.copy()
    for kind in (uses_accelerations, ~uses_accelerations):
        restarts = forgotten & kind
        if restarts.any():
            start, spread = mean, covariance
            if h.log_weight[kind].max() >= FORGOTTEN:
                start, spread = _mixture_of(h, kind)
            spread = AS_STEADY @ spread @ AS_STEADY.T
            x[restarts] = AS_STEADY @ start
            P[restarts] = (spread + spread.T) / 2
    return Hypotheses(x, P, np.where(forgotten, REVIVED, h.log_weight))


def _supply_scale(
    h: Hypotheses, weight: Array, uses_accelerations: NDArray[np.bool_]
) -> Hypotheses:
    """Return the hypotheses with the airspeed scale of the models without accelerations in each
    model with accelerations that is less certain of it. The other states of this model change by
    their covariance with the scale.

    Models with accelerations mistake side-slip, and a change of the wind, for a wrong scale. In a
    flight of ArduPlane their scale fell from 1.01 to 0.88 after the wind had changed. The true
    scale was 1.03, as the other models had found before.
    """
    weight = np.where(uses_accelerations, 0.0, weight)
    weight /= weight.sum()
    scale = h.x[:, KAPPA]
    variance = h.P[:, KAPPA, KAPPA]
    mean = weight @ scale
    certain = weight @ (variance + (scale - mean) ** 2)
    (uncertain,) = (uses_accelerations & (variance > certain)).nonzero()
    if not uncertain.size:
        return h
    x = h.x.copy()
    P = h.P.copy()
    for model in uncertain:
        gain = h.P[model, KAPPA] / variance[model]
        x[model] -= gain * (scale[model] - mean)
        P[model] -= gain[:, None] * gain * (variance[model] - certain)
    return Hypotheses(x, P, h.log_weight)


def _mixture_of(h: Hypotheses, chosen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return mean (12,) and covariance (12, 12) of the weighted hypotheses of some models, (M,)."""
    return ekf.mixture(Hypotheses(h.x[chosen], h.P[chosen], h.log_weight[chosen]))
