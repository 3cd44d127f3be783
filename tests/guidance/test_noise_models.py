"""The noise models of the tracker: error, consistency and weights in simulated winds.

A plane flies a circle of 100 m radius at 15 m/s, with ranges at 10 Hz and a sigma of 0.5 m. For
each kind of wind, the tracker has a noise model. If this model is not the most likely one, its
level is wrong: the estimate lags behind the wind, or follows the noise of the ranges.
"""

from math import exp, pi, sqrt

import numpy as np
import pytest

from circnav_mav.guidance.estimators.relative_ekf import (
    DX,
    DY,
    FORWARD,
    GX,
    GY,
    KAPPA,
    LEFT,
    STATES,
    THETA,
    B,
    R,
    VelocityChange,
    polar,
)
from circnav_mav.guidance.estimators.tracker import Tracker
from tests.guidance.relative import RADIUS, SETTINGS, V

STEP = 0.1
SIGMA = 0.5
SIZE = 700
SETTLED = 200
"""Number of steps after which the initial estimate no longer matters."""


def smooth(rng, sigma, time=10.0):
    """Return a random process with standard deviation sigma and a correlation time, s."""
    keep = exp(-STEP / time)
    values = [sigma * rng.standard_normal()]
    for kick in rng.normal(0, sigma * sqrt(1 - keep**2), SIZE - 1).tolist():
        values.append(keep * values[-1] + kick)
    return np.array(values)


def steady(rng):
    return np.full(SIZE, 3.0 - 2.0j)


def wandering(psd):
    """Return a random walk of the wind. psd: spectral density of its rate of change, m^2/s^3."""

    def wind(rng):
        kicks = rng.normal(0, sqrt(psd * STEP), (SIZE, 2)) @ (1, 1j)
        return steady(rng) + np.cumsum(kicks)

    return wind


def gusty(sigma):
    """Return a steady wind with gusts of standard deviation sigma, m/s, along each axis."""

    def wind(rng):
        return steady(rng) + smooth(rng, sigma) + 1j * smooth(rng, sigma)

    return wind


def white(rng):
    return rng.normal(0, SIGMA, SIZE)


def drifting(rng):
    return rng.normal(0, 0.4 * SIGMA, SIZE) + smooth(rng, 0.9 * SIGMA, 2.0)


def vector(value):
    return value.real, value.imag


def started(place, wind, rng):
    """Return a tracker that starts 3 m and 0.5 m/s (1 sigma) off the truth."""
    mean = np.zeros(STATES)
    sigmas = np.zeros(STATES)
    mean[[0, 1]] = rng.normal(vector(place), 3.0)
    mean[[DX, DY]] = rng.normal(vector(wind), 0.5)
    mean[KAPPA] = 1.0
    sigmas[[0, 1]] = 3.0
    sigmas[[DX, DY]] = 0.5
    sigmas[KAPPA] = SETTINGS.scale_sigma
    sigmas[B] = 0.5 * SIGMA
    sigmas[[GX, GY]] = 0.02 * V
    sigmas[[FORWARD, LEFT]] = SETTINGS.acceleration_bias
    return Tracker(SETTINGS, *polar(mean, np.diag(sigmas**2)), True)


def fly(seed, wind, errors, accelerations):
    """Fly the circle. Yield error (m), NEES and weights of the tracker for each range."""
    rng = np.random.default_rng(seed)
    winds = wind(rng).tolist()
    range_errors = errors(rng).tolist()
    angle = 0.0
    tracker = None
    before = None
    for n in range(SIZE):
        place = RADIUS * np.exp(1j * angle)
        course = 1j * place / RADIUS
        along = (winds[n] * course.conjugate()).real
        speed = along + sqrt(V**2 - abs(winds[n]) ** 2 + along**2)
        nose = float(np.angle(speed * course - winds[n]))
        velocity = speed * course + complex(*rng.normal(0, 0.03, 2))
        air = V * np.exp(1j * nose)
        if tracker is None:
            tracker = started(place, winds[0], rng)
        else:
            path = (air + before[1]) / 2 * STEP
            change = None
            if accelerations:
                turned = (nose - before[2] + pi) % (2 * pi) - pi
                change = VelocityChange(
                    vector(velocity - before[0]),
                    vector(air - before[1]),
                    vector(path / V),
                    V * turned / STEP,
                )
            z = RADIUS + range_errors[n]
            tracker.observe(STEP, vector(path), z, SIGMA, STEP, change)
            if n >= SETTLED:
                estimate = tracker.estimate
                r, theta = estimate.mean[[R, THETA]]
                wrong = np.array((r - RADIUS, np.angle(np.exp(1j * (theta - angle)))))
                nees = wrong @ np.linalg.solve(estimate.covariance[:2, :2], wrong)
                error = abs(r * np.exp(1j * theta) - place)
                yield error, nees, *tracker.tracks.weight
        before = velocity, air, nose
        angle += speed * STEP / RADIUS


@pytest.mark.parametrize(
    ("wind", "errors", "accelerations", "largest_error", "largest_nees", "least_weights"),
    [
        pytest.param(steady, white, False, 0.53, 2.0, {0: 0.5}, id="steady"),
        pytest.param(steady, drifting, False, 1.4, 3.0, {1: 0.3, 3: 0.3}, id="drifting ranges"),
        pytest.param(wandering(1e-3), white, False, 1.9, 3.0, {2: 0.47}, id="slowly changing"),
        pytest.param(wandering(5e-2), white, False, 6.35, 3.3, {4: 0.6}, id="quickly changing"),
        pytest.param(gusty(0.02 * V), white, False, 2.9, 2.5, {7: 0.5}, id="weak gusts"),
        pytest.param(gusty(0.05 * V), white, False, 5.7, 2.0, {4: 0.4, 6: 0.3}, id="gusts"),
        pytest.param(gusty(0.08 * V), white, False, 8.6, 2.4, {6: 0.4}, id="medium gusts"),
        pytest.param(gusty(0.1 * V), white, False, 11.0, 3.0, {5: 0.55}, id="strong gusts"),
        pytest.param(gusty(0.05 * V), white, True, 2.68, 2.0, {8: 0.9}, id="measured gusts"),
        pytest.param(gusty(0.2 * V), white, True, 7.5, 4.0, {8: 0.9}, id="measured storm"),
    ],
)
def test_noise_model_of_each_wind_leads(
    wind, errors, accelerations, largest_error, largest_nees, least_weights
):
    """`least_weights` contains the numbers of models in `MODELS`, and their least mean weights."""
    flights = [row for seed in range(2) for row in fly(seed, wind, errors, accelerations)]
    error, nees, *weights = np.array(flights).T
    assert sqrt((error**2).mean()) < largest_error
    assert nees.mean() < largest_nees
    for model, least in least_weights.items():
        assert weights[model].mean() > least
