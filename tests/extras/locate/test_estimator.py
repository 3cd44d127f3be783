"""The place and its covariance in synthetic worlds."""

from dataclasses import replace
from math import hypot

import numpy as np
import pytest

from circnav_mav.extras.locate.estimator import Ranges, Track, locate
from circnav_mav.extras.locate.place import Place
from tests.extras.locate.worlds import KNOWN, PLANE, circles


def found(track, ranges, known=KNOWN):
    place = locate(PLANE, track, ranges, known)
    assert isinstance(place, Place), place
    return place


def test_place_error_reaches_geometric_bound_with_perfect_positions():
    """The Cramer-Rao bound is 0.053 m (1 sigma per axis) with all ranges, and 0.075 m with the half
    of them that the estimator uses here."""
    errors = []
    for seed in range(6):
        track, ranges, target = circles(seed=seed, gps=0.0)
        place = found(track, ranges, replace(KNOWN, gps_sigma=0.01))
        errors += [place.east - target[0], place.north - target[1]]
    assert np.sqrt(np.mean(np.square(errors))) < 0.11


def test_place_covariance_is_consistent_with_gps_error():
    """For chi-squared with two degrees of freedom, 95 % of the values are below 5.99 and half are
    above 1.39."""
    squares = []
    for seed in range(24):
        track, ranges, target = circles(seed=seed)
        place = found(track, ranges)
        error = np.array([place.east, place.north]) - target
        squares.append(error @ np.linalg.solve(place.covariance, error))
    # 2 sigma below the expected 0.95, by the binomial distribution of 24 flights
    assert np.mean(np.array(squares) < 5.99) >= 0.86
    assert 0.7 < np.median(squares) < 2.5


def test_place_covariance_covers_scale_error_fitted_as_bias():
    """On one circle, a bias of a few meters explains a scale error of 10 % nearly as well as the
    scale does. The place then has an error of meters."""
    angle = np.linspace(0, 3 * np.pi, 300)
    time = np.arange(300.0)
    track = Track(time, 80 * np.sin(angle), 80 * np.cos(angle), np.zeros(300))
    known = replace(KNOWN, up=0.0, up_sigma=0.05, gps_sigma=0.05)
    squares = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        target = rng.uniform(-40.0, 40.0, 2)
        r = np.hypot(track.east - target[0], track.north - target[1])
        ranges = Ranges(time, 1.1 * r + rng.normal(0, 0.5, 300), np.full(300, 0.5))
        place = locate(PLANE, track, ranges, known)
        if isinstance(place, Place):
            error = np.array([place.east, place.north]) - target
            squares.append(error @ np.linalg.solve(place.covariance, error))
    assert len(squares) >= 8
    assert np.mean(np.array(squares) < 5.99) >= 0.9


def test_target_height_is_determined_only_by_two_circles():
    one = circles((100.0,), bias=1.5, gps=0.0, laps=2)
    two = circles((100.0, 60.0), bias=1.5, gps=0.0, laps=2)
    known = replace(KNOWN, gps_sigma=0.01)
    assert not found(*one[:2], known).up_known
    place = found(*two[:2], known)
    # The radio's scale is one more state (prior sigma 0.03 %). It adds 0.05 m to the height error.
    assert place.up_known and abs(place.up - 400.0) < 0.6
    assert place.bias == pytest.approx(1.5, abs=0.5)


def test_estimator_finds_velocity_of_moving_target():
    track, ranges, target = circles(velocity=(2.5, -1.5), laps=2)
    place = found(track, ranges)
    assert place.moves and hypot(place.velocity[0] - 2.5, place.velocity[1] + 1.5) < 0.3
    assert hypot(place.east - target[0], place.north - target[1]) < 4 * place.sigma
    assert not found(*circles(laps=2)[:2]).moves


def test_estimator_rejects_and_counts_outliers():
    track, ranges, target = circles(outliers=0.2)
    place = found(track, ranges)
    assert hypot(place.east - target[0], place.north - target[1]) < 3 * place.sigma
    assert place.outliers == pytest.approx(0.2 * (place.used + place.outliers), rel=0.3)


def test_slowly_varying_range_error_increases_place_covariance():
    track, ranges, _ = circles(gps=0.0, laps=3)
    rng = np.random.default_rng(3)
    drift = [0.0]
    for _ in ranges.r[1:]:
        drift.append(0.98 * drift[-1] + rng.normal(0, 0.1))
    known = replace(KNOWN, gps_sigma=0.01)
    white = found(track, ranges, known).sigma
    assert found(track, replace(ranges, r=ranges.r + np.array(drift)), known).sigma > 1.5 * white
