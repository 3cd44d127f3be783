"""Figures of a circle, worked out by hand."""

import numpy as np
import pytest

from circnav_mav.guidance.types import Direction
from circnav_mav.runlog import metrics


def column(*values):
    return np.array(values, dtype=float)


@pytest.mark.parametrize(
    ("radius", "settled"),
    [
        ([150, 130, 104, 100, 96], 2.0),
        ([150, 104, 120, 104, 100], 3.0),
        ([150, 130, 104, 100, 94], None),
        ([100, 100, 100, 100, 100], 0.0),
        ([150, 130, 120, 110, 105], 4.0),
        ([150, 130, 120, 110, 105.1], None),
        ([150, 100, 100, np.nan, 100], 4.0),
        ([94.9, 95, 95, 95, 95], 1.0),
    ],
)
def test_settled_means_the_last_entry_into_five_percent(radius, settled):
    """r_d = 100 m: the band is 95 to 105 m, both included. Time counts from the first sample."""
    assert metrics.settling_time(column(10, 11, 12, 13, 14), column(*radius), 100.0) == settled


def test_a_flight_that_swings_out_of_the_band_on_every_lap_is_not_settled_by_its_last_entry():
    """+-8 m at 100 m, 40 s a lap: the last entry, 5 s before the end, is no settling."""
    time = np.arange(0.0, 195.0)
    swinging = 100 - 8 * np.cos(2 * np.pi * time / 40)
    assert metrics.settling_time(time, swinging, 100.0) > 170
    assert metrics.settled(time, swinging, 100.0) is None


@pytest.mark.parametrize(("entered", "settled"), [(60, 60.0), (200, 200.0), (201, None)])
def test_a_settled_flight_was_within_the_band_through_all_of_the_last_third(entered, settled):
    time = np.arange(0.0, 301.0)
    radius = np.where(time < entered, 150.0, 101.0)
    assert metrics.settled(time, radius, 100.0) == settled


def test_nothing_flown_is_nothing_known():
    empty = column()
    assert metrics.settling_time(empty, empty, 100.0) is metrics.settled(empty, empty, 100.0) is None
    assert metrics.mean(empty) is metrics.rms_error(empty, 100.0) is None
    assert metrics.swept_angle(empty, empty) == 0.0
    assert len(metrics.last_part(empty, empty)) == 0


def test_the_last_third_is_a_third_of_the_time_and_not_of_the_samples():
    time = column(0, 1, 2, 3, 4, 5, 20, 30)
    assert list(metrics.last_part(time, time)) == [20, 30]
    assert list(metrics.last_part(column(0, 1, 2, 3), column(5, 6, 7, 8))) == [7, 8], "both its ends included"


def test_the_mean_hides_what_the_rms_error_shows():
    assert (metrics.mean(column(90, 110)), metrics.rms_error(column(90, 110), 100.0)) == (100.0, 10.0)


@pytest.mark.parametrize(
    ("turns", "direction"),
    [(1.0, Direction.COUNTERCLOCKWISE), (-3.7, Direction.CLOCKWISE), (0.26, Direction.COUNTERCLOCKWISE),
     (-0.26, Direction.CLOCKWISE), (0.24, None), (-0.24, None), (0.0, None)],
)  # fmt: skip
def test_the_swept_angle_counts_every_turn_and_from_a_quarter_on_it_has_a_sense(turns, direction):
    """North up, east right: counter-clockwise from east is positive, seen from above."""
    angle = 1.0 + np.linspace(0, turns * 2 * np.pi, 1000)
    swept = metrics.swept_angle(5 * np.sin(angle), 5 * np.cos(angle))
    assert swept == pytest.approx(turns * 2 * np.pi)
    assert metrics.direction_of(swept) is direction


def test_from_north_over_east_to_south_is_clockwise():
    assert metrics.direction_of(metrics.swept_angle(column(1, 0, -1), column(0, 1, 0))) is Direction.CLOCKWISE
