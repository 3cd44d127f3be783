"""Ranges that do not determine a place give no place."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from circnav_mav.extras.locate.estimator import Knowledge, NotLocated, locate
from circnav_mav.extras.locate.logs.table import read_logs
from tests.extras.locate.worlds import KNOWN, PLANE, circles
from tests.tools.bench.bench_undetermined import judged


@pytest.mark.parametrize(
    ("case", "why"), [("69-walk-straight.csv", "turn"), ("67-target-on-a-circle.csv", "move")]
)
def test_log_without_unique_place_is_not_located(case, why):
    (log,) = read_logs(Path(__file__).parent / "cases" / case)
    ranges, known = log.of("target", None)
    track = log.track(log.plane())
    answer = locate(log.plane(), track, ranges, Knowledge(500.0, sigma_known=known))
    assert isinstance(answer, NotLocated) and why in answer.why


def test_constant_range_is_not_located():
    track, ranges, _ = circles(target=(0.0, 0.0))
    constant = replace(ranges, r=np.full(len(ranges.r), 100.0))
    known = replace(KNOWN, up_sigma=50.0, sigma_known=False)
    answer = locate(PLANE, track, constant, known)
    assert isinstance(answer, NotLocated) and "do not change" in answer.why


@pytest.mark.parametrize(
    ("kind", "seed"),
    [*(("straight", seed) for seed in range(6)), ("noise", 3), ("half a lap", 1)],
)
def test_log_with_undetermined_place_gives_no_wrong_place(kind, seed):
    """The estimator knows the standard deviation of the ranges with the seeds 0 and 4 only."""
    assert judged(kind, seed) != "WRONG"
