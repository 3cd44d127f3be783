"""The laws on range and range rate: equations, steady states, bounds of their commands, and default
gains."""

from math import asin, cos, isfinite, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import laws
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.laws import LAWS, Kind, smooth, switching
from circnav_mav.guidance.tuning import LawTuning

V = 15.0
R_D = 100.0
EXAMPLE = {"V": 1.0, "r_d": 10.0}
"""Speed V and radius r_d of all three examples of the paper."""
STATELESS = [law for law in LAWS.values() if law.kind is Kind.RANGE]
FEEDBACK = [law for law in STATELESS if law.name not in ("smooth", "switching")]

ranges = st.floats(1, 2000)
rates = st.floats(-15, 15)
speeds = st.floats(0.5, 60)
radii = st.floats(5, 2000)
lags = st.floats(0.05, 10)


def each(laws):
    return pytest.mark.parametrize("law", laws, ids=lambda law: law.name)


def gain(law):
    return law.default_gain(V, R_D, 0.55)


@each(STATELESS)
@given(r=ranges, r_dot=rates)
def test_law_of_opposite_direction_is_mirror_image(law, r, r_dot):
    k = gain(law)
    assert law.function(r, r_dot, V=V, r_d=R_D, k=k) == -law.function(r, r_dot, V=V, r_d=R_D, k=-k)


@each(STATELESS)
@given(
    over=st.floats(1.001, 3),
    r=st.floats(0, 2000),
    r_dot=rates,
)
def test_laws_stay_finite_for_every_allowed_gain(law, over, r, r_dot):
    k = over * (law.gain_bound(V, R_D) or 0.5 * gain(law))
    assert isfinite(law.function(r, r_dot, V=V, r_d=R_D, k=k))


@each(LAWS.values())
@given(V=speeds, r_d=radii, above=st.floats(1.01, 100))
def test_law_with_corrected_radius_settles_on_requested_radius(law, V, r_d, above):
    k = above * law.gain_bound(V, r_d)
    assert law.reached_radius(V, law.fed_radius(V, r_d, k), k) == pytest.approx(r_d, rel=1e-9)


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        (laws.reached_radius(10.0, 0.01), 10.98684113),  # example 1
        (laws.corrected_radius(10.0, 0.01), 8.66025404),  # example 2
        (laws.corrected_radius(10.0, -0.01), 8.66025404),
        (laws.smooth_gain_bound(10.0), 0.005),
        (laws.switching_gain_bound(15.0, 100.0), 0.15),
    ],
)
def test_law_1_settled_radii_and_gain_bounds_match_paper(number, expected):
    assert number == pytest.approx(expected, rel=1e-9)


@given(theta_b=st.floats(0, 2 * pi), r=st.floats(45, 1e3), turn=st.floats(-1, 1))
def test_range_acceleration_stays_within_closed_form_bound(theta_b, r, turn):
    """r'' = V sin(theta_b) theta_b' with theta_b' = omega + V sin(theta_b)/r (eq. `thetadot`).

    V = 15 m/s, omega_max = 1/3 rad/s, so the tightest turn is 45 m."""
    V = 15.0
    omega_max = 1 / 3
    acceleration = V * sin(theta_b) * (turn * omega_max + V * sin(theta_b) / r)
    assert abs(acceleration) <= laws.max_range_acceleration(V, omega_max, r) * (1 + 1e-12)


@pytest.mark.parametrize(("r", "bound"), [(1e-6, 10.0), (45.0, 10.0), (90.0, 7.5)])
def test_acceleration_bound_is_constant_inside_tightest_turn(r, bound):
    """The bound V^2/r + V omega_max grows for smaller ranges, but not inside the radius of the
    tightest turn, 45 m."""
    assert laws.max_range_acceleration(15.0, 1 / 3, r) == pytest.approx(bound)


@pytest.mark.parametrize("law", [smooth, switching])
@given(share=st.floats(0, 1, exclude_max=True), r_dot=rates, V=speeds, r_d=radii)
def test_laws_of_paper_do_not_turn_inside_circle(law, share, r_dot, V, r_d):
    assert law(min(share * r_d, np.nextafter(r_d, 0)), r_dot, V=V, r_d=r_d, k=0.1) == 0.0


@given(outside=st.floats(1, 100), r_dot=st.floats(-1, 1), k=st.floats(0.001, 1))
def test_law_1_matches_equation_of_paper(outside, r_dot, k):
    r = 10 * outside
    by_hand = k * (2 * r * 1.0 * cos(pi - asin(10 / r)) - 2 * r * r_dot)  # eq. `omega`
    assert float(smooth(r, r_dot, **EXAMPLE, k=k)) == pytest.approx(by_hand, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("r_dot", "turn"),
    [(0.0, -0.12), (1.0, -0.12), (-1.0, 0.12), (np.cos(np.pi - np.arcsin(0.5)), 0.0)],
    ids=["across", "departing", "closing", "tangent"],
)
def test_law_2_turns_clockwise_unless_closing_at_tangent_rate(r_dot, turn):
    """Example 3 of the paper, k = 0.12. At r = 20, flight along the tangent to the circle has r' =
    -sqrt(3)/2."""
    assert float(switching(20.0, r_dot, **EXAMPLE, k=0.12)) == turn


@each(FEEDBACK)
def test_law_commands_circle_turn_rate_on_circle(law):
    assert law.function(R_D, 0.0, V=V, r_d=R_D, k=-gain(law)) == pytest.approx(V / R_D)


@each(FEEDBACK)
def test_distant_vehicle_approaches_at_most_at_0_8_speed(law):
    rates = np.linspace(-V, 0, 2001)
    turns = [law.function(1e5, float(rate), V=V, r_d=R_D, k=-gain(law)) for rate in rates]
    asked_for = rates[np.abs(turns).argmin()]
    assert -0.8 * V <= asked_for < -0.2 * V


@pytest.mark.parametrize(
    ("r", "r_dot", "turn"),
    [
        (265.0, -9.0, 12 / 265 + 0.02 * (-9 + 8.25 * 0.7615942)),
        (50.0, 9.0, 12 / 50 + 0.02 * (9 - 8.25 * 0.2940833)),
        (10.0, 9.0, 12 / 43 + 0.02 * (9 - 8.25 * 0.4971057)),
    ],
)
def test_feedforward_matches_hand_calculation(r, r_dot, turn):
    """V = 15 m/s, r' = 9 m/s and the tangential speed is 12 m/s. By hand: gamma = 0.02 * 15/6 =
    0.05, v* = 8.25 m/s, and tanh of 1, 50/165 and 90/165. For ranges below 43 m the feedforward
    turn is constant."""
    assert laws.feedforward(r, r_dot, V=V, r_d=R_D, k=-0.02) == pytest.approx(turn, rel=1e-5)


@each(LAWS.values())
@given(V=speeds, r_d=radii, lag=lags)
def test_default_gain_above_bound_falls_with_lag(law, V, r_d, lag):
    gain = law.default_gain(V, r_d, lag)
    assert gain > law.gain_bound(V, r_d)
    assert law.default_gain(V, r_d, 2 * lag) <= gain


@pytest.mark.parametrize(
    ("law", "V", "r_d", "lag", "gain"),
    [
        # examples 1 and 2 of the paper: a loop without lag
        ("smooth", 1.0, 10.0, 0.1, 0.01),
        ("switching", 1.0, 10.0, 0.1, 0.12),  # example 3
        ("smooth", 15.0, 100.0, 1.5, 0.35 / (2 * 100 * 15 * 1.5)),
        *((law, 15.0, 100.0, 1.0, 0.5 / 15) for law in ("feedforward", "drift", "auto")),
        ("feedforward", 15.0, 100.0, 0.2, 6 / 100),
    ],
)
def test_default_gains_match_paper_and_flown_loops(law, V, r_d, lag, gain):
    """The default gain gives k V lag = 0.5 (law 1: 2 k r_d V lag = 0.35). With larger products,
    flown autopilots entered a limit cycle."""
    assert LAWS[law].default_gain(V, r_d, lag) == pytest.approx(gain)


def test_loop_lag_adds_turn_and_filter_delays():
    settings = EstimatorSettings(15.0, 0.35)
    lags = (
        LawTuning("auto", settings, turn, sigma, 0.1).loop_lag(100.0)
        for turn, sigma in ((0.4, 0.1), (0.4, 2.0), (1.4, 2.0))
    )
    quick, slow, slowest = lags
    assert 0.4 < quick < slow
    assert slowest == pytest.approx(slow + 1.0)
