"""The laws on range and range rate: what they hold, what they never ask for, and their mirror images."""

from math import isfinite, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import laws, theory
from circnav_mav.guidance.laws import LAWS, Kind
from circnav_mav.guidance.radius_trim import MOST
from circnav_mav.guidance.tuning import default_gain

V, R_D = 15.0, 100.0
STATELESS = [law for law in LAWS.values() if law.kind is Kind.RANGE]
FEEDBACK = [law for law in STATELESS if law.name not in ("smooth", "switching", "bounded")]


def bounded(r, r_dot, *, V, r_d, k):
    """Counter-clockwise, as its source has it."""
    return laws.bounded(r, r_dot, V=V, r_d=r_d, k=-k)


def gain(law):
    return default_gain(law.name, V, R_D, 0.55)


@pytest.mark.parametrize("law", STATELESS, ids=lambda law: law.name)
@given(r=st.floats(1, 2000), r_dot=st.floats(-15, 15))
def test_the_other_sense_is_the_mirror_image(law, r, r_dot):
    k = gain(law)
    assert law.function(r, r_dot, V=V, r_d=R_D, k=k) == -law.function(r, r_dot, V=V, r_d=R_D, k=-k)


@pytest.mark.parametrize("law", FEEDBACK, ids=lambda law: law.name)
def test_on_the_circle_the_law_asks_for_the_circles_own_turn(law):
    assert law.function(R_D, 0.0, V=V, r_d=R_D, k=-gain(law)) == pytest.approx(V / R_D)


@pytest.mark.parametrize("law", [law for law in FEEDBACK if law.name != "relay"], ids=lambda law: law.name)
def test_far_out_an_approach_that_every_law_accepts_is_slower_than_the_vehicle(law):
    rates = np.linspace(-V, 0, 2001)
    turns = law.function(np.full_like(rates, 1e5), rates, V=V, r_d=R_D, k=-gain(law))
    asked_for = rates[np.abs(turns).argmin()]
    assert -0.8 * V <= asked_for < -0.2 * V


@given(r=st.floats(1, 2000), r_dot=st.floats(-15, 15), k=st.floats(0.011, 0.1))
def test_bounded_keeps_its_bound(r, r_dot, k):
    assert abs(bounded(r, r_dot, V=V, r_d=R_D, k=k)) <= 2 * k * V + 1e-9


def test_bounded_holds_the_exact_radius():
    k = 0.02
    r_s = sqrt(R_D**2 - 1 / k**2)
    assert bounded(R_D, 0.0, V=V, r_d=R_D, k=k) == pytest.approx(k * V * sqrt(1 - (r_s / R_D) ** 2))
    assert bounded(R_D, 0.0, V=V, r_d=R_D, k=k) == pytest.approx(V / R_D)


@pytest.mark.parametrize(("r", "asked"), [(120.0, sqrt(3) / 2), (60.0, 0.0), (30.0, -sqrt(3) / 2)])
def test_bounded_asks_for_an_approach_outside_and_for_as_quick_a_way_out_inside(r, asked):
    """r_s = 60 at r_d = 100 and k = 1/80: by hand at twice r_s, on it, and at half of it."""
    assert bounded(r, 3.0, V=V, r_d=R_D, k=1 / 80) == pytest.approx((3.0 + V * asked) / 80)


@pytest.mark.parametrize(("r", "turn"), [(102.0, 0.193), (250.0, 0.34), (98.0, 0.187), (1.0, 0.0415)])
def test_pd_is_its_equation_with_the_error_cut(r, turn):
    """V/r_d = 0.15, k r' = 0.04, and .0015 of the error, 100 m of it at most: k^2 V/4, and what half of V asks for."""
    assert laws.pd(r, 2.0, V=V, r_d=R_D, k=-0.02) == pytest.approx(turn)


def test_feedforward_is_the_turn_of_the_present_circle_and_the_closing_speed_missing():
    """V, r' and what is across: 15, 9, 12. gamma = .02 * 15/6 = .05, v* = 8.25; tanh 1 = 0.7615942, and tanh(50/165) =
    0.2940801; nearer than 43 m the circle is no smaller."""
    values = {"V": V, "r_d": R_D, "k": -0.02}
    assert laws.feedforward(265.0, -9.0, **values) == pytest.approx(12 / 265 + 0.02 * (-9 + 8.25 * 0.7615942), rel=1e-5)
    assert laws.feedforward(50.0, 9.0, **values) == pytest.approx(12 / 50 + 0.02 * (9 - 8.25 * 0.2940801), rel=1e-5)
    near, across = laws.feedforward(10.0, 9.0, **values), 0.02 * (9 + 8.25 * np.tanh(-90 / 165))
    assert near == pytest.approx(12 / 43 + across)


def test_pi_is_its_equation_and_its_integral_stays_within_its_bounds():
    """c = 7.5, delta = 50, k_i = .02 * .15 = .003; the integral comes to rest at 50 and is held below 100."""
    values = {"V": V, "r_d": R_D, "k": -0.02}
    s = -4.0 + 7.5 * 0.7615942
    turn, memory = laws.pi(150.0, -4.0, 20.0, 0.1, **values)
    assert (memory, turn) == pytest.approx((20 + 0.1 * s, 0.02 * s + 0.003 * memory), rel=1e-5)
    assert laws.pi(150.0, -4.0, 99.9, 0.1, **values)[1] == 100.0
    assert laws.pi(50.0, -4.0, 0.5, 0.1, **values)[1] == 0.0


@pytest.mark.parametrize("law", STATELESS, ids=lambda law: law.name)
@given(share=st.floats(1 - MOST, 1 + MOST), over=st.floats(1.001, 3), r=st.floats(0, 2000), r_dot=st.floats(-15, 15))
def test_every_law_stays_finite_for_every_trim_of_its_radius_and_gain_that_is_allowed(law, share, over, r, r_dot):
    k = over * (law.gain_bound(V, R_D) or 0.5 * gain(law))
    assert isfinite(law.function(r, r_dot, V=V, r_d=share * R_D, k=k))


@pytest.mark.parametrize("fed", [85.0, 90.0, 100 / 1.1])
def test_bounded_fed_less_than_its_gain_can_fly_holds_the_smallest_circle_that_it_can(fed):
    """Its turn there is V k at r' = 0, the circle of radius 1/k."""
    k = 1.1 / R_D
    assert bounded(1 / k, 0.0, V=V, r_d=fed, k=k) == pytest.approx(V * k)


def test_relay_changes_over_within_its_boundary_layer_and_not_at_once():
    """The loop bears 6/r_d = .06 rad/m, so that the layer is .2/.06 m/s to either side."""
    turns = [laws.relay(R_D, r_dot, V=V, r_d=R_D, k=-0.2) for r_dot in (-5.0, -5 / 3, 0.0, 5 / 3, 5.0)]
    assert turns == pytest.approx([0.15 - 0.2, 0.15 - 0.1, 0.15, 0.15 + 0.1, 0.15 + 0.2])


def test_pi_integral_comes_to_rest_at_the_circles_own_turn():
    r, psi, x, y, memory, dt = 160.0, 0.5, 160.0, 0.0, 0.0, 0.05
    for _ in range(8000):
        r, r_dot = np.hypot(x, y), V * (x * np.cos(psi) + y * np.sin(psi)) / np.hypot(x, y)
        turn, memory = laws.pi(r, r_dot, memory, dt, V=V, r_d=R_D, k=-0.06)
        psi += float(np.clip(turn, -0.35, 0.35)) * dt
        x, y = x + V * np.cos(psi) * dt, y + V * np.sin(psi) * dt
    assert r == pytest.approx(R_D, abs=1.0)
    assert turn == pytest.approx(V / R_D, abs=0.01)


def test_the_drift_that_a_circle_tolerates_is_that_in_which_it_is_the_smallest():
    """Most downwind the ground speed is V + W and the course turns by V/(V + W) of the nose's rate: the smallest circle
    has (V + W)^2/(V max_turn_rate). The benchmark's hardest wind, .53 V, just fits."""
    assert theory.tolerated_drift(15.0, 100.0, 0.35) == pytest.approx(sqrt(525) - 15, abs=1e-9)
    W = theory.tolerated_drift(22.0, 150.0, 0.3, turn_gain=0.72)
    assert pytest.approx(150.0) == (22.0 + W) ** 2 / (22.0 * 0.3 * 0.72)


def test_settling_prediction_is_half_a_turn_and_the_tangent():
    assert theory.settling_time(R_D * sqrt(2), V, R_D, 0.35) == pytest.approx(pi / 0.35 + R_D / V)
