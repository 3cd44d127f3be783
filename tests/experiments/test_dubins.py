"""Dubins times against what can be drawn by hand."""

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.experiments.dubins import circle_time, shortest, tangent_time

SPEED = {"V": 15.0, "r_d": 100.0, "max_turn_rate": 0.15 * 15 / 5}


def test_straight_ahead_is_the_distance():
    assert shortest(0.0, 0.0, 0.0, 5.0, 0.0, 0.0) == pytest.approx(5.0)


def test_turning_back_beside_oneself_is_half_a_circle():
    assert shortest(0.0, 0.0, 0.0, 0.0, 2.0, pi) == pytest.approx(pi)


def test_turning_back_on_the_spot_takes_three_turns():
    assert shortest(0.0, 0.0, 0.0, 0.0, 0.0, pi) == pytest.approx(7 * pi / 3)


@given(x=st.floats(-6, 6), y=st.floats(-6, 6), h=st.floats(-3, 3), h1=st.floats(-3, 3))
def test_a_path_and_its_mirror_image_are_equally_long(x, y, h, h1):
    assert shortest(0, 0, h, x, y, h1) == pytest.approx(shortest(0, 0, -h, x, -y, -h1), abs=1e-6)


@given(x=st.floats(-6, 6), y=st.floats(-6, 6), h=st.floats(-3, 3))
def test_no_path_is_shorter_than_the_distance_or_the_turn(x, y, h):
    length = shortest(0.0, 0.0, 0.0, x, y, h)
    assert length >= np.hypot(x, y) - 1e-6
    assert length >= abs(h) - 1e-6


def test_along_the_tangent_the_time_is_its_length():
    p = np.array([[100.0], [-300.0]])
    assert tangent_time(p, np.array([pi / 2]), np.ones(1), **SPEED) == pytest.approx([20.0])


def test_the_right_sense_counts():
    p, psi = np.array([[100.0], [-60.0]]), np.array([pi / 2])
    assert tangent_time(p, psi, np.ones(1), **SPEED) == pytest.approx([4.0])
    assert tangent_time(p, psi, -np.ones(1), **SPEED) > 12.0
    mirrored = np.array([[100.0], [60.0]])
    assert tangent_time(mirrored, -psi, -np.ones(1), **SPEED) == pytest.approx([4.0])


def test_cutting_in_is_never_slower_than_the_tangent():
    rng = np.random.default_rng(2)
    angle, psi = rng.uniform(0, 2 * pi, (2, 50))
    p = rng.uniform(140, 600, 50) * np.stack([np.cos(angle), np.sin(angle)])
    around = circle_time(p, psi, np.ones(50), **SPEED)
    assert np.all(around <= tangent_time(p, psi, np.ones(50), **SPEED) + 0.01)
    assert np.all(around >= (np.hypot(*p) - 100) / 15 - 1e-9)


def test_from_the_middle_the_circle_is_met_from_within():
    time = circle_time(np.zeros((2, 1)), np.zeros(1), np.ones(1), **SPEED)
    rho = 15 / SPEED["max_turn_rate"]
    straight_then_left = (sqrt((100 - rho) ** 2 - rho**2) + rho * (pi / 2 + np.arcsin(rho / (100 - rho)))) / 15
    assert time[0] == pytest.approx(straight_then_left, abs=0.05)
