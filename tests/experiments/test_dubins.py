"""Dubins times to the tangent point against what can be drawn by hand. Turning radius 33.3 m."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.experiments.batch.metrics import tangent_time

SPEED = {"V": 15.0, "r_d": 100.0, "max_turn_rate": 0.45}


def test_along_the_tangent_the_time_is_its_length():
    p = np.array([[100.0], [-300.0]])
    assert tangent_time(p, np.array([pi / 2]), np.ones(1), **SPEED) == pytest.approx([20.0])


def test_the_right_sense_counts():
    p, psi = np.array([[100.0], [-60.0]]), np.array([pi / 2])
    assert tangent_time(p, psi, np.ones(1), **SPEED) == pytest.approx([4.0])
    assert tangent_time(p, psi, -np.ones(1), **SPEED) > 12.0
    mirrored = np.array([[100.0], [60.0]])
    assert tangent_time(mirrored, -psi, -np.ones(1), **SPEED) == pytest.approx([4.0])


@given(r=st.floats(180, 900), bearing=st.floats(-pi, pi), psi=st.floats(-pi, pi), sense=st.sampled_from([-1.0, 1.0]))
def test_the_way_lies_between_straight_to_the_circle_and_a_turn_about_with_the_tangent(r, bearing, psi, sense):
    """A whole turn at the limit, and its width, are the most that comes on top of the tangent from here."""
    p = np.array([[r * np.cos(bearing)], [r * np.sin(bearing)]])
    way = 15.0 * tangent_time(p, np.array([psi]), np.array([sense]), **SPEED)[0]
    rho, tangent = 15.0 / 0.45, np.sqrt(r**2 - 100.0**2)
    assert r - 100.0 - 1e-6 <= way <= tangent + 2 * pi * rho + 2 * rho
