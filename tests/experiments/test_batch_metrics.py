"""Metrics on flights drawn by hand."""

from math import inf

import numpy as np
import pytest

from circnav_mav.experiments.batch import metrics

TIME = np.arange(0, 100, 0.1)


def column(*values):
    return np.stack(np.broadcast_arrays(*values), axis=1)


def test_settled_from_the_last_exit_and_never_if_it_ends_outside():
    r = column(100 + 50 * np.exp(-TIME / 10), np.full_like(TIME, 130.0), np.full_like(TIME, 100.0))
    settled = metrics.last_exit(TIME, r, 100.0, 0.1)
    assert settled[0] == pytest.approx(10 * np.log(5), abs=0.11)
    assert settled[1] == inf and settled[2] == 0.0


def test_rms_is_the_size_of_a_constant_error():
    assert metrics.rms(np.full((10, 2), -3.0)) == pytest.approx([3.0, 3.0])


def test_the_wrong_way_round_is_noticed_although_the_radius_is_perfect():
    angle = column(0.15 * TIME, -0.15 * TIME)
    assert metrics.right_way(angle, np.array([1.0, 1.0])).tolist() == [True, False]
    assert metrics.right_way(angle, np.array([-1.0, -1.0])).tolist() == [False, True]


def test_overshoot_is_inward_for_starts_outside_and_outward_for_starts_inside():
    r = column(100 + 80 * np.exp(-TIME / 9) * np.cos(TIME / 5), 100 - 80 * np.exp(-TIME / 9) * np.cos(TIME / 5))
    inward, outward = metrics.overshoot(r, 100.0)
    assert inward == pytest.approx(outward)
    assert inward == pytest.approx(100 - r[:, 0].min())


def test_who_is_blown_away_has_not_gone_round_the_wrong_way():
    """A lost flight sees its target under a bearing that creeps a little, either way."""
    creeping = np.linspace(0.0, 0.3, len(TIME))
    angle = np.stack([creeping, -creeping, np.linspace(0.0, -20.0, len(TIME))], axis=1)
    assert metrics.went_round(angle).tolist() == [False, False, True]
