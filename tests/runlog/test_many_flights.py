"""Metrics of many flights at once, as in the benchmark, on synthetic flights."""

from math import inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.laws import settling_time
from circnav_mav.runlog import many_flights
from circnav_mav.runlog.many_flights import tangent_time

TIME = np.arange(0, 100, 0.1)
SPEED = {"V": 15.0, "r_d": 100.0, "max_turn_rate": 0.45}
"""Speed (m/s), radius (m) and turn limit (rad/s), with a smallest turning radius of 33.3 m."""


def column(*values):
    return np.stack(np.broadcast_arrays(*values), axis=1)


def test_settling_time_is_after_last_exit_from_band():
    r = column(100 + 50 * np.exp(-TIME / 10), np.full_like(TIME, 130.0), np.full_like(TIME, 100.0))
    assert many_flights.last_exit(TIME, r, 100.0, 10.0) == pytest.approx(
        [10 * np.log(5), inf, 0.0], abs=0.11
    )


def test_wrong_and_missing_rotation_are_detected():
    """The bearing of the third flight changes only slowly: this flight did not circle the
    target."""
    angle = column(0.15 * TIME, -0.15 * TIME, 0.003 * TIME)
    assert many_flights.right_way(angle, np.ones(3)).tolist() == [True, False, True]
    assert many_flights.right_way(angle, -np.ones(3)).tolist() == [False, True, False]
    assert many_flights.went_round(angle).tolist() == [True, True, False]


def test_overshoot_is_largest_error_beyond_circle():
    e = 80 * np.exp(-TIME / 9) * np.cos(TIME / 5)
    assert many_flights.overshoot(column(100 + e, 100 - e), 100.0) == pytest.approx([-e.min()] * 2)


@pytest.mark.parametrize(
    ("north", "psi", "sense", "least", "most"),
    [(-300.0, pi / 2, 1, 20.0, 20.0), (-60.0, pi / 2, 1, 4.0, 4.0), (60.0, -pi / 2, -1, 4.0, 4.0),
     (-60.0, pi / 2, -1, 12.0, 40.0)],
    ids=["along the tangent", "near", "mirrored", "opposite direction requires a turn back"],
)  # fmt: skip
def test_dubins_time_matches_geometric_construction(north, psi, sense, least, most):
    """The path starts 100 m east of the target. least, most: bounds of its time at 15 m/s, s."""
    (time,) = tangent_time(
        np.array([[100.0], [north]]), np.array([psi]), np.array([float(sense)]), **SPEED
    )
    assert least - 1e-6 <= time <= most + 1e-6


@given(
    r=st.floats(180, 900),
    bearing=st.floats(-pi, pi),
    psi=st.floats(-pi, pi),
    sense=st.sampled_from([-1.0, 1.0]),
)
def test_dubins_path_lies_within_geometric_bounds(r, bearing, psi, sense):
    """The path is at most one full turn at the limit and its width longer than the tangent from the
    start."""
    p = np.array([[r * np.cos(bearing)], [r * np.sin(bearing)]])
    way = 15.0 * tangent_time(p, np.array([psi]), np.array([sense]), **SPEED)[0]
    rho = 15.0 / 0.45
    tangent = np.sqrt(r**2 - 100.0**2)
    assert r - 100.0 - 1e-6 <= way <= tangent + 2 * pi * rho + 2 * rho


def test_settling_time_is_dubins_time_of_worst_heading():
    heading = np.radians(np.arange(0.0, 360.0))
    away = np.stack([np.full(360, 500.0), np.zeros(360)])
    worst = tangent_time(away, heading, np.ones(360), V=15.0, r_d=100.0, max_turn_rate=0.35).max()
    assert settling_time(500.0, 15.0, 100.0, 0.35) == pytest.approx(worst, abs=1.0)
