"""The one flight in the air is worked out in plain floats; the same as in arrays, to the last bits."""

from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import floats
from circnav_mav.guidance.estimators.prediction import Belief, predict_belief
from circnav_mav.guidance.estimators.relative_ekf import KAPPA, STATES, THETA, R, predict
from circnav_mav.guidance.law_selector import ONE_AT_START, at_start, hand_over
from circnav_mav.guidance.turn_response import Pending
from circnav_mav.guidance.vector_field import drift, drift_gains, orbit_turn_rate
from tests.guidance.relative import hypothesis, noise

angles = st.floats(-pi, pi)
few = st.floats(-10, 10)


@given(seed=st.integers(0, 2**32 - 1), dt=st.floats(0.0, 20.0), heading=angles, airspeed=st.floats(0.5, 30))
def test_one_flight_is_predicted_as_the_bank_predicts_it(seed, dt, heading, airspeed):
    rng = np.random.default_rng(seed)
    mean = rng.normal(size=STATES) * [80, 2, 3, 3, 0.05, 0.3, 1, 1, 0.1, 0.1, 0, 0] + [150, 0, 0, 0, 1, *[0] * 7]
    mean[R] = max(mean[R], 1.0)
    root = rng.normal(size=(STATES, STATES)) * 0.1
    P, chord, psd, gust = root @ root.T, rng.normal(size=2) * 10 * dt, 0.02, 1.3
    after = predict(hypothesis(mean, P), noise(psd, gust, 0.7, 0.5), np.array([dt]), chord[:, None], np.array([0.5]))
    x, Q = after.x[:, 0, 0], after.P[:, :, 0, 0]

    belief = Belief(tuple(mean.tolist()), P, psd, gust)
    ours = predict_belief(belief, dt, (chord[0], chord[1]), heading=heading, airspeed=airspeed)

    n, air = np.array([np.cos(x[THETA]), np.sin(x[THETA])]), airspeed * np.array([np.cos(heading), np.sin(heading)])
    v = x[KAPPA] * air + x[2:4] + x[6:8]
    gradient = np.array([0.0, n[0] * v[1] - n[1] * v[0], *n, n @ air, 0.0, *n, 0, 0, 0, 0])
    assert [ours.r, ours.x, ours.y, *ours.drift] == pytest.approx([x[R], *(x[R] * n), *(x[2:4] + x[6:8])], abs=1e-9)
    assert (ours.r_dot, ours.airspeed) == pytest.approx((n @ v, x[KAPPA] * airspeed), abs=1e-9)
    assert ours.r_variance == pytest.approx(Q[R, R], rel=1e-9)
    assert ours.direction_variance == pytest.approx(Q[THETA, THETA], rel=1e-9)
    assert ours.r_dot_variance == pytest.approx(gradient @ Q @ gradient, rel=1e-9)


@given(x=st.floats(-500, 500), y=st.floats(-500, 500), wind=st.tuples(few, few), psi=angles, omega=st.floats(-0.5, 0.5))
def test_the_drift_law_is_the_same_for_one_flight(x, y, wind, psi, omega):
    facts = {"V": 15.0, "r_d": 100.0, "max_turn_rate": 0.35, "gains": drift_gains(15.0, 0.4, 2.5)}
    pending = Pending(np.array([0.4 * omega]), 0.4)
    many = drift(np.array([[x], [y]]), np.array(wind)[:, None], np.array([psi]), pending, **facts)
    one = drift((x, y), wind, psi, Pending(0.4 * omega, 0.4), **facts, xp=floats)
    # next to the cut of the heading error at pi both ways round are right
    cut = 2 * pi * facts["gains"].heading
    assert abs(remainder_of(one - float(many[0]), cut)) < 1e-6
    circle = {"V": 15.0, "r_d": 100.0}
    assert orbit_turn_rate(wind, psi, **circle, xp=floats) == pytest.approx(float(orbit_turn_rate(wind, psi, **circle)))


def remainder_of(value, cut):
    return value - cut * round(value / cut)


steps = st.tuples(
    st.floats(0, 0.5), st.booleans(), st.integers(-1, 3), st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(1, 400)
)  # fmt: skip


@given(st.lists(steps, max_size=40))
def test_the_handover_is_the_same_for_one_flight(steps):
    one, many = ONE_AT_START, at_start()
    for dt, trusted, favourite, by_range, by_bank, r in steps:
        say = {"by_range": by_range, "by_bank": by_bank, "limit": 0.35, "r": r, "r_d": 100.0}
        one = hand_over(one, dt, trusted=trusted, favourite=favourite, **say, xp=floats)
        many = hand_over(many, dt, trusted=np.array([trusted]), favourite=np.array([favourite]), **say)
        assert (one.flies, one.favourite) == (many.flies[0], many.favourite[0])
        assert one.command == pytest.approx(float(many.command[0]), abs=1e-12)


@given(x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6))
def test_plain_floats_answer_as_numpy_does(x, y):
    for name in ("arctan2", "hypot", "minimum", "maximum"):
        assert getattr(floats, name)(x, y) == pytest.approx(float(getattr(np, name)(x, y)), rel=1e-15, abs=1e-15)
    assert floats.sinc(x / 1e3) == pytest.approx(float(np.sinc(x / 1e3)), abs=1e-12)
    assert floats.clip(x, -abs(y), abs(y)) == np.clip(x, -abs(y), abs(y))
    assert floats.where(x > y, x, y) == np.where(x > y, x, y)
    assert floats.logical_not(x > y) == np.logical_not(x > y)


def test_a_number_that_is_none_is_not_hidden_by_a_bound():
    assert np.isnan([floats.clip(nan, -1.0, 1.0), floats.minimum(nan, 1.0), floats.maximum(nan, 0.0)]).all()
    assert floats.clip(inf, -1.0, 1.0) == 1.0
