"""The relative-motion filters against filterpy's extended Kalman filter and textbook equations."""

from math import pi

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.estimators.acquisition import Estimate
from circnav_mav.guidance.estimators.dead_reckoning import predict_mixture
from circnav_mav.guidance.estimators.relative_ekf import (
    ACCELERATION_PSD,
    BIAS_TIME,
    GUST_TIME,
    KAPPA,
    KAPPA_PSD,
    STATES,
    THETA,
    Hypotheses,
    R,
    VelocityChange,
    acceleration_measurements,
    correct,
    mixture,
    polar,
    position,
    predict,
    range_measurement,
    rate_measurement,
    transition,
    update,
)
from circnav_mav.guidance.maths import chord
from tests.guidance.relative import hypothesis, noise

DT = 0.1
SIGMA = 0.7
PSD = 0.02
GUST = 1.2
WHITE = 0.6
DRIFTING = 0.8
NOISE = noise(PSD, GUST, WHITE, DRIFTING)
STATE = np.array([180.0, 2.0, 1.0, -2.0, 1.02, 0.1, 0.3, -0.2, 0.1, -0.2, 0.3, 0.1])


def moved(x, path):
    """Return the predicted state of one hypothesis, from an independent model in Cartesian
    coordinates."""
    p = (
        x[0] * np.array([np.cos(x[1]), np.sin(x[1])])
        + x[4] * path
        + (x[2:4] + x[6:8] + x[10:] / 2) * DT
    )
    bias = x[5] * np.exp(-DT / BIAS_TIME)
    gust = x[6:8] * np.exp(-DT / GUST_TIME)
    turned = np.arctan2(p[1], p[0])
    return np.array(
        [
            np.hypot(*p),
            x[1] + np.angle(np.exp(1j * (turned - x[1]))),
            x[2],
            x[3],
            x[4],
            bias,
            *gust,
            *x[8:10],
            0,
            0,
        ]
    )


def jacobian(x, path):
    """Return the Jacobian of a function by central differences."""
    columns = []
    for i in range(STATES):
        h = 1e-6 * max(1.0, abs(x[i]))
        step = np.eye(STATES)[i] * h
        columns.append((moved(x + step, path) - moved(x - step, path)) / (2 * h))
    return np.array(columns).T


def process_noise(x):
    """Return the Cartesian process noise rotated into the polar frame of the state after the
    step."""
    steady = PSD * DT
    gusty = (1 - np.exp(-2 * DT / GUST_TIME)) * GUST**2
    Q = np.zeros((STATES, STATES))
    Q[:2, :2] = np.eye(2) * (steady + gusty) * DT**2 / 3
    for first, q in ((2, steady), (6, gusty)):
        at = slice(first, first + 2)
        Q[at, at] = np.eye(2) * q
        Q[:2, at] = Q[at, :2] = np.eye(2) * q * DT / 2
    Q[4, 4], Q[5, 5] = KAPPA_PSD * DT, (1 - np.exp(-2 * DT / BIAS_TIME)) * (DRIFTING * SIGMA) ** 2
    c = np.cos(x[1])
    s = np.sin(x[1])
    T = np.eye(STATES)
    T[:2, :2] = [[c, s], [-s / x[0], c / x[0]]]
    return T @ Q @ T.T


def test_filter_with_one_hypothesis_matches_filterpy_ekf():
    rng = np.random.default_rng(4)
    P = np.diag([4.0, 0.05, 9.0, 9.0, 2.5e-3, 0.2, 1.0, 1.0, 0.04, 0.04, 0.1, 0.1])
    reference = ExtendedKalmanFilter(dim_x=STATES, dim_z=1)
    reference.x = STATE[:, None].copy()
    reference.P = P.copy()
    H = np.eye(STATES)[[0]] + np.eye(STATES)[[5]]
    ours = hypothesis(STATE, P)
    psi = 0.3
    for _ in range(150):
        path = np.array(chord(15.0, psi, 0.03, DT))
        psi += 0.03
        state = reference.x[:, 0]
        F = jacobian(state, path)
        reference.x = moved(state, path)[:, None]
        reference.P = F @ reference.P @ F.T + process_noise(reference.x[:, 0])
        z = float(reference.x[0, 0] + rng.normal(0, 1.0))
        reference.update(np.array([[z]]), lambda _: H, lambda s: H @ s, R=(WHITE * SIGMA) ** 2)
        ours = predict(ours, transition(ours, NOISE, DT, path, SIGMA))
        ours, *_ = update(ours, NOISE, range_measurement(ours, NOISE, z, SIGMA), gate=1e3)
    assert ours.x[0] == pytest.approx(reference.x[:, 0], rel=1e-6, abs=1e-6)
    assert ours.P[0] == pytest.approx(reference.P, rel=1e-4, abs=1e-7)


def test_filter_update_rejects_outlier_without_state_change():
    before = hypothesis([100.0, 0, 0, 0, 1, *[0] * 7], 0.01 * np.eye(STATES))
    after, _, accepted = update(before, NOISE, range_measurement(before, NOISE, 120.0, SIGMA), 5.0)
    assert not accepted[0]
    assert np.array_equal(after.x, before.x)


def test_airspeed_scale_stays_within_15_percent():
    """A range error of 50 m that only the airspeed scale could explain."""
    P = np.diag([100.0, 0, 0, 0, 1, *[0] * 7])
    P[R, KAPPA] = P[KAPPA, R] = 9.0
    before = hypothesis([100.0, 0, 0, 0, 1, *[0] * 7], P)
    scales = [
        update(before, NOISE, range_measurement(before, NOISE, z, SIGMA), 10.0)[0].x[0, KAPPA]
        for z in (150.0, 50.0)
    ]
    assert scales == [1.15, 0.85]


def test_range_rate_update_matches_textbook_with_numerical_jacobian():
    """Reference: h(x) = n.(kappa V u + d + g + e) with its Jacobian by differences, and the
    textbook update in full matrices."""
    rng = np.random.default_rng(3)
    x = rng.normal(size=STATES) * 0.3 + np.array([120.0, 0.7, 2.0, -1.0, 1.0, *[0.0] * 7])
    root = 0.1 * rng.normal(size=(STATES, STATES))
    P = root @ root.T
    air = np.array([9.0, 12.0])

    def h(x):
        return np.array([np.cos(x[1]), np.sin(x[1])]) @ (x[4] * air + x[2:4] + x[6:8] + x[10:12])

    H = np.array([(h(x + 1e-6 * unit) - h(x - 1e-6 * unit)) / 2e-6 for unit in np.eye(STATES)])
    S = H @ P @ H + 0.3**2
    z = h(x) + 0.4
    before = hypothesis(x, P)
    after, *_ = update(before, NOISE, rate_measurement(before, z, 0.3, air), 5.0)
    assert after.x[0] == pytest.approx(x + P @ H / S * 0.4, abs=1e-6)
    assert after.P[0] == pytest.approx(P - np.outer(P @ H, H @ P) / S, abs=1e-7)


def test_mixture_of_hypotheses_averages_directions_across_pi():
    x = np.zeros((2, STATES))
    x[:, 0] = 100.0
    x[:, 1] = np.pi - 0.01, -np.pi + 0.01
    mean, P = mixture(Hypotheses(x, np.zeros((2, STATES, STATES)), np.zeros(2)))
    assert abs(np.cos(mean[1]) + 1) < 1e-6
    assert P[1, 1] == pytest.approx(1e-4, rel=1e-6)


def test_polar_state_matches_converted_position_and_covariance():
    p = np.array([30.0, -40.0, 1, 2, 1, *[0] * 7])
    P = np.diag([4.0, 4.0, *[1] * 10])
    x, polar_P = polar(p, P)
    assert position(x) == pytest.approx([30.0, -40.0])
    assert np.diag(polar_P) == pytest.approx([4.0, 4.0 / 50**2, *[1] * 10])


@given(
    seed=st.integers(0, 2**32 - 1),
    dt=st.floats(0.0, 20.0),
    heading=st.floats(-pi, pi),
    airspeed=st.floats(0.5, 30),
)
def test_mixture_prediction_equals_prediction_of_one_hypothesis(seed, dt, heading, airspeed):
    rng = np.random.default_rng(seed)
    mean = rng.normal(size=STATES) * [80, 2, 3, 3, 0.05, 0.3, 1, 1, 0.1, 0.1, 0, 0] + [
        150,
        0,
        0,
        0,
        1,
        *[0] * 7,
    ]
    mean[R] = max(mean[R], 1.0)
    root = rng.normal(size=(STATES, STATES)) * 0.1
    P = root @ root.T
    chord = rng.normal(size=2) * 10 * dt
    psd = 0.02
    gust = 1.3
    before = hypothesis(mean, P)
    after = predict(before, transition(before, noise(psd, gust, 0.7, 0.5), dt, chord, 0.5))
    x = after.x[0]
    Q = after.P[0]

    estimate = Estimate(mean, P, drift_psd=psd, gust=gust)
    ours = predict_mixture(estimate, dt, (chord[0], chord[1]), heading, airspeed, None)

    n = np.array([np.cos(x[THETA]), np.sin(x[THETA])])
    air = airspeed * np.array([np.cos(heading), np.sin(heading)])
    v = x[KAPPA] * air + x[2:4] + x[6:8]
    gradient = np.array([0.0, n[0] * v[1] - n[1] * v[0], *n, n @ air, 0.0, *n, 0, 0, 0, 0])
    assert [ours.r, ours.x, ours.y, *ours.drift] == pytest.approx(
        [x[R], *(x[R] * n), *(x[2:4] + x[6:8])], abs=1e-9
    )
    assert (ours.r_dot, ours.airspeed) == pytest.approx((n @ v, x[KAPPA] * airspeed), abs=1e-9)
    assert ours.r_variance == pytest.approx(Q[R, R], rel=1e-9)
    assert ours.direction_variance == pytest.approx(Q[THETA, THETA], rel=1e-9)
    assert ours.r_dot_variance == pytest.approx(gradient @ Q @ gradient, rel=1e-9)


@pytest.mark.parametrize("acceleration_weight", [0.0, 1.0])
def test_predicted_drift_includes_measured_velocity_change(
    acceleration_weight,
):
    """v = kappa V u(psi) + drift, so the drift changes by the change of v minus kappa times the
    change of V u(psi). The measured change is assigned to the drift, not to the gust. The
    accelerometer's error is (0.1, -0.2) m/s^2, forward and left, for 0.1 s at a heading of
    north."""
    acceleration = VelocityChange((0.35, 0.1), (-0.1, 0.2), (0.0, 0.1), 0.0)
    estimate = Estimate(
        STATE, np.eye(STATES), drift_psd=PSD, gust=GUST, acceleration_weight=acceleration_weight
    )
    ours = predict_mixture(estimate, DT, (0.5, 1.4), pi / 2, 15.0, acceleration)
    stays = 1.0 if acceleration_weight else np.exp(-DT / GUST_TIME)
    measured = acceleration_weight * np.array([0.35 + 1.02 * 0.1, 0.1 - 1.02 * 0.2])
    left = (
        np.array([1.0, -2.0]) + stays * np.array([0.3, -0.2]) + [0.3, 0.1] - np.array([0.02, 0.01])
    )
    assert ours.drift == pytest.approx(tuple(left + measured))


def test_prediction_with_measured_acceleration_matches_bayes_rule():
    """Reference: condition the prediction on the measured change of velocity in one joint
    covariance. Its variables are the 12 states before the step, the random steps of d and g, the
    new e, their effects on the position, and the accelerometer's noise."""
    nose = 0.4
    psi = 0.7
    turn = 2.2
    assumed = noise(PSD, GUST, WHITE, DRIFTING, nose, 1.0)
    x = STATE
    root = np.random.default_rng(1).normal(size=(STATES, STATES)) * 0.05
    P = root @ root.T
    path = np.array([1.2, 0.7])
    change = np.array([0.35, 0.1])
    air = np.array([-0.1, 0.2])
    u = np.array([np.cos(psi), np.sin(psi)])
    left = np.array([-np.sin(psi), np.cos(psi)])
    acceleration = VelocityChange(change, air, u * DT, turn)
    before = hypothesis(x, P)
    plain = predict(before, transition(before, assumed, DT, path, SIGMA))
    step = transition(before, assumed, DT, path, SIGMA, accelerations=True)
    ours = predict(before, step)
    for measured in acceleration_measurements(before, step, acceleration):
        ours = correct(ours, assumed, measured, assumed.acceleration_weight)

    F = jacobian(x, path)
    I2 = np.eye(2)
    steady = PSD * DT
    gusty = (1 - np.exp(-2 * DT / GUST_TIME)) * GUST**2
    H = np.zeros((2, STATES))
    H[:, 4], H[:, 6:8], H[:, 8], H[:, 9] = (
        turn * DT * left,
        (np.exp(-DT / GUST_TIME) - 1) * I2,
        u * DT,
        left * DT,
    )
    H[:, 10:] = -I2
    c = np.cos(plain.x[0, 1])
    s = np.sin(plain.x[0, 1])
    polar = np.array([[c, s], [-s / plain.x[0, 0], c / plain.x[0, 0]]])
    crossed = F @ P @ H.T
    crossed[:2] += polar * ((steady + gusty + nose**2) * DT / 2)
    crossed[2:4] += steady * I2
    crossed[6:8] += gusty * I2
    crossed[10:] += nose**2 * I2
    S = H @ P @ H.T + (steady + gusty + nose**2 + ACCELERATION_PSD * DT) * I2
    foreseen = x[4] * air + H[:, 6:] @ x[6:]
    expected = plain.x[0] + crossed @ np.linalg.solve(S, change - foreseen)
    assert ours.x[0] == pytest.approx(expected, abs=1e-6)
    moved_by_nose = np.zeros((STATES, 2))
    moved_by_nose[:2], moved_by_nose[10:] = polar * DT / 2, I2
    less = (
        plain.P[0]
        + nose**2 * moved_by_nose @ moved_by_nose.T
        - crossed @ np.linalg.solve(S, crossed.T)
    )
    assert ours.P[0] == pytest.approx(less, abs=1e-6)
