"""The one flight in the air is worked out in plain floats; the same as in arrays, to the last bits."""

from math import inf, nan, pi, remainder

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import maths
from circnav_mav.guidance.estimators.prediction import Belief, predict_belief
from circnav_mav.guidance.estimators.relative_ekf import KAPPA, STATES, THETA, R, predict
from circnav_mav.guidance.law_selector import Handover, hand_over
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
    d = np.array(wind)[:, None]
    (many,) = drift(np.array([[x], [y]]), d, np.array([psi]), pending, **facts)
    off = drift((x, y), wind, psi, Pending(0.4 * omega, 0.4), **facts) - many
    # next to the cut of the heading error at pi both ways round are right
    assert abs(remainder(off, 2 * pi * facts["gains"].heading)) < 1e-6
    (circles,) = orbit_turn_rate(d, np.array([psi]), V=15.0, r_d=100.0)
    assert orbit_turn_rate(wind, psi, V=15.0, r_d=100.0) == pytest.approx(circles)


steps = st.tuples(
    st.floats(0, 0.5), st.booleans(), st.integers(-1, 3), st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(1, 400)
)


@given(st.lists(steps, max_size=40))
def test_the_handover_is_the_same_for_one_flight(steps):
    one, many = Handover(), Handover()
    for dt, *said in steps:
        trusted, favourite, by_range, by_bank, r = said
        facts = {"trusted": trusted, "favourite": favourite, "by_range": by_range, "by_bank": by_bank, "r": r}
        one = hand_over(one, dt, **facts, limit=0.35, r_d=100.0)
        many = hand_over(many, dt, **{name: np.array([fact]) for name, fact in facts.items()}, limit=0.35, r_d=100.0)
        assert (one.flies, one.favourite) == (many.flies[0], many.favourite[0])
        assert one.command == pytest.approx(many.command[0], abs=1e-12)


ONE = ("cos", "sin", "exp", "tanh", "rint", "sign", "sinc", "logical_not")
SHARE = ("arccos", "arcsin")
TWO = ("arctan2", "hypot", "minimum", "maximum")


@given(x=st.floats(-600, 600), y=st.floats(-1e6, 1e6))
def test_a_float_is_answered_as_numpy_answers_an_array(x, y):
    values = [*((n, (x,)) for n in ONE), *((n, (x / 600,)) for n in SHARE), *((n, (y, x)) for n in TWO)]
    for name, operands in [*values, ("sqrt", (abs(y),)), ("clip", (x, -abs(y), abs(y))), ("where", (x > y, x, y))]:
        function, expected = getattr(maths, name), getattr(np, name)(*operands)
        assert function(*operands) == pytest.approx(expected, rel=1e-12, abs=1e-12), name
        assert function(*map(np.array, operands)) == expected, name


def test_a_number_that_is_none_is_not_hidden_by_a_bound():
    assert np.isnan([maths.clip(nan, -1.0, 1.0), maths.minimum(nan, 1.0), maths.maximum(nan, 0.0)]).all()
    assert maths.clip(inf, -1.0, 1.0) == 1.0
