"""The laws on range and range rate: equations, steady states, bounds of their commands, and default
gains."""

from math import asin, cos, isfinite, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance import laws
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.laws import LAWS, Kind, smooth, switching
from circnav_mav.guidance.tuning import LawTuning
from circnav_mav.guidance.watches import MOST_TRIM

V = 15.0
R_D = 100.0
EXAMPLE = {"V": 1.0, "r_d": 10.0}
"""The paper's three examples share these."""
STATELESS = [law for law in LAWS.values() if law.kind is Kind.RANGE]
FEEDBACK = [law for law in STATELESS if law.name not in ("smooth", "switching", "bounded")]

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
def test_the_other_sense_is_the_exact_mirror_image(law, r, r_dot):
    k = gain(law)
    assert law.function(r, r_dot, V=V, r_d=R_D, k=k) == -law.function(r, r_dot, V=V, r_d=R_D, k=-k)


@each(STATELESS)
@given(points=st.lists(st.tuples(ranges, rates), min_size=1, max_size=8))
def test_many_flights_fly_the_law_of_one(law, points):
    r, r_dot = np.array(points).T
    values = {"V": V, "r_d": R_D, "k": gain(law)}
    one_by_one = [law.function(*point, **values) for point in points]
    np.testing.assert_allclose(law.function(r, r_dot, **values), one_by_one, rtol=1e-12, atol=1e-12)


@each(STATELESS)
@given(
    share=st.floats(1 - MOST_TRIM, 1 + MOST_TRIM),
    over=st.floats(1.001, 3),
    r=st.floats(0, 2000),
    r_dot=rates,
)
def test_every_law_stays_finite_for_every_trim_of_its_radius_and_gain_that_is_allowed(
    law, share, over, r, r_dot
):
    k = over * (law.gain_bound(V, R_D) or 0.5 * gain(law))
    assert isfinite(law.function(r, r_dot, V=V, r_d=share * R_D, k=k))


@each(LAWS.values())
@given(V=speeds, r_d=radii, above=st.floats(1.01, 100))
def test_the_radius_fed_is_the_one_that_reaches_the_radius_asked_for(law, V, r_d, above):
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
def test_law_1_reaches_and_is_fed_the_papers_radii_above_the_papers_bounds(number, expected):
    assert number == pytest.approx(expected, rel=1e-9)


@given(theta_b=st.floats(0, 2 * pi), r=st.floats(45, 1e3), turn=st.floats(-1, 1))
def test_no_turn_accelerates_the_range_beyond_its_bound(theta_b, r, turn):
    """r'' = V sin(theta_b) theta_b' with theta_b' = omega + V sin(theta_b)/r (eq. `thetadot`).

    V = 15 m/s, omega_max = 1/3 rad/s, so the tightest turn is 45 m."""
    V = 15.0
    omega_max = 1 / 3
    acceleration = V * sin(theta_b) * (turn * omega_max + V * sin(theta_b) / r)
    assert abs(acceleration) <= laws.max_range_acceleration(V, omega_max, r) * (1 + 1e-12)


@pytest.mark.parametrize(("r", "bound"), [(1e-6, 10.0), (45.0, 10.0), (90.0, 7.5)])
def test_the_acceleration_bound_stops_growing_inside_the_tightest_turn(r, bound):
    """V^2/r + V omega_max of the same vehicle."""
    assert laws.max_range_acceleration(15.0, 1 / 3, r) == pytest.approx(bound)


@pytest.mark.parametrize("law", [smooth, switching])
@given(share=st.floats(0, 1, exclude_max=True), r_dot=rates, V=speeds, r_d=radii)
def test_inside_the_circle_the_papers_laws_do_not_turn(law, share, r_dot, V, r_d):
    assert law(min(share * r_d, np.nextafter(r_d, 0)), r_dot, V=V, r_d=r_d, k=0.1) == 0.0


@given(outside=st.floats(1, 100), r_dot=st.floats(-1, 1), k=st.floats(0.001, 1))
def test_law_1_is_the_equation_of_the_paper(outside, r_dot, k):
    r = 10 * outside
    by_hand = k * (2 * r * 1.0 * cos(pi - asin(10 / r)) - 2 * r * r_dot)  # eq. `omega`
    assert float(smooth(r, r_dot, **EXAMPLE, k=k)) == pytest.approx(by_hand, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("r_dot", "turn"),
    [(0.0, -0.12), (1.0, -0.12), (-1.0, 0.12), (np.cos(np.pi - np.arcsin(0.5)), 0.0)],
    ids=["across the line of sight", "straight away", "straight at the target", "on the tangent"],
)
def test_law_2_turns_clockwise_unless_the_vehicle_closes_as_fast_as_the_tangent(r_dot, turn):
    """Example 3, k = 0.12. At r = 20 the tangent rate is -sqrt(3)/2."""
    assert float(switching(20.0, r_dot, **EXAMPLE, k=0.12)) == turn


@each(FEEDBACK)
def test_on_the_circle_the_law_asks_for_the_circles_own_turn(law):
    assert law.function(R_D, 0.0, V=V, r_d=R_D, k=-gain(law)) == pytest.approx(V / R_D)


@each([law for law in FEEDBACK if law.name != "relay"])
def test_far_out_an_approach_that_every_law_accepts_is_slower_than_the_vehicle(law):
    rates = np.linspace(-V, 0, 2001)
    turns = law.function(np.full_like(rates, 1e5), rates, V=V, r_d=R_D, k=-gain(law))
    asked_for = rates[np.abs(turns).argmin()]
    assert -0.8 * V <= asked_for < -0.2 * V


@pytest.mark.parametrize(
    ("r", "asked"), [(120.0, sqrt(3) / 2), (100.0, 0.8), (60.0, 0.0), (30.0, -sqrt(3) / 2)]
)
def test_bounded_asks_for_an_approach_outside_and_for_as_quick_a_way_out_inside(r, asked):
    """r_s = 60 at r_d = 100 and k = 1/80. By hand at twice r_s, on the circle, on r_s, and at half
    of it."""
    assert laws.bounded(r, 3.0, V=V, r_d=R_D, k=-1 / 80) == pytest.approx((3.0 + V * asked) / 80)


@pytest.mark.parametrize("fed", [60.0, 72.0, 80.0])
def test_bounded_fed_less_than_its_gain_can_fly_holds_the_smallest_circle_that_it_can(fed):
    """At r' = 0 it turns at V k, on the circle of radius 1/k."""
    assert laws.bounded(80.0, 0.0, V=V, r_d=fed, k=-1 / 80) == pytest.approx(V / 80)


def test_relay_changes_over_within_its_boundary_layer_and_not_at_once():
    """The loop allows 6/r_d = 0.06 rad/m, so the layer is 0.2/0.06 m/s to either side."""
    turns = [
        laws.relay(R_D, r_dot, V=V, r_d=R_D, k=-0.2) for r_dot in (-5.0, -5 / 3, 0.0, 5 / 3, 5.0)
    ]
    assert turns == pytest.approx([0.15 - 0.2, 0.15 - 0.1, 0.15, 0.15 + 0.1, 0.15 + 0.2])


@pytest.mark.parametrize(
    ("r", "turn"), [(102.0, 0.193), (250.0, 0.34), (98.0, 0.187), (1.0, 0.0415)]
)
def test_pd_is_its_equation_with_the_error_cut(r, turn):
    """V/r_d = 0.15 and k r' = 0.04. The error counts with k^2 V/4 = 0.0015, up to 100 m, which
    demand a radial speed of V/2."""
    assert laws.pd(r, 2.0, V=V, r_d=R_D, k=-0.02) == pytest.approx(turn)


@pytest.mark.parametrize(
    ("r", "r_dot", "turn"),
    [
        (265.0, -9.0, 12 / 265 + 0.02 * (-9 + 8.25 * 0.7615942)),
        (50.0, 9.0, 12 / 50 + 0.02 * (9 - 8.25 * 0.2940833)),
        (10.0, 9.0, 12 / 43 + 0.02 * (9 - 8.25 * 0.4971057)),
    ],
)
def test_feedforward_is_the_turn_of_the_present_circle_and_the_closing_speed_missing(
    r, r_dot, turn
):
    """V, r' and the tangential speed are 15, 9 and 12 m/s. gamma = 0.02 * 15/6 = 0.05, v* = 8.25;
    tanh of 1, 50/165 and 90/165. Nearer than 43 m the circle gets no smaller."""
    assert laws.feedforward(r, r_dot, V=V, r_d=R_D, k=-0.02) == pytest.approx(turn, rel=1e-5)


def test_pi_is_its_equation_and_its_integral_stays_within_its_bounds():
    """c = 7.5, delta = 50, k_i = 0.02 * 0.15 = 0.003. The integral settles at 50 and is held below
    100."""
    values = {"V": V, "r_d": R_D, "k": -0.02}
    s = -4.0 + 7.5 * 0.7615942
    turn, memory = laws.pi(150.0, -4.0, 20.0, 0.1, **values)
    assert (memory, turn) == pytest.approx((20 + 0.1 * s, 0.02 * s + 0.003 * memory), rel=1e-5)
    assert laws.pi(150.0, -4.0, 99.9, 0.1, **values)[1] == 100.0
    assert laws.pi(50.0, -4.0, 0.5, 0.1, **values)[1] == 0.0


@each(LAWS.values())
@given(V=speeds, r_d=radii, lag=lags)
def test_every_default_gain_meets_its_own_condition_and_is_none_higher_in_a_later_loop(
    law, V, r_d, lag
):
    gain = law.default_gain(V, r_d, lag)
    assert gain > law.gain_bound(V, r_d)
    assert law.default_gain(V, r_d, 2 * lag) <= gain


@pytest.mark.parametrize(
    ("law", "V", "r_d", "lag", "gain"),
    [
        (
            "smooth",
            1.0,
            10.0,
            0.1,
            0.01,
        ),  # examples 1 and 2 of the paper, where the loop has no lag
        ("switching", 1.0, 10.0, 0.1, 0.12),  # example 3
        *(
            (law, 15.0, 100.0, 1.0, 0.5 / 15)
            for law in ("feedforward", "pd", "pi", "drift", "auto")
        ),
    ],
)
def test_default_gains_are_the_papers_and_in_a_late_loop_those_at_which_vehicles_do_not_swing(
    law, V, r_d, lag, gain
):
    """k V lag = 0.5. Above it, autopilots were seen in a limit cycle."""
    assert LAWS[law].default_gain(V, r_d, lag) == pytest.approx(gain)


def test_the_loop_is_as_late_as_turn_and_filter_together():
    settings = EstimatorSettings(15.0, 0.35)
    lags = (
        LawTuning("auto", settings, turn, sigma, 0.1).loop_lag(100.0)
        for turn, sigma in ((0.4, 0.1), (0.4, 2.0), (1.4, 2.0))
    )
    quick, slow, slowest = lags
    assert 0.4 < quick < slow
    assert slowest == pytest.approx(slow + 1.0)
