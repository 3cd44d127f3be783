"""Whether ranges scatter more than their sensor says."""

from math import hypot, sin

import numpy as np
import pytest

from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.types import RangeSample

V, LIMIT = 15.0, 0.35


def ranges(told: float, sigma: float, *, hz: float = 10.0, seconds: float = 20.0, seed: int = 1, lost: float = 0.0):
    """Ranges of a vehicle that weaves as hard as it can past a target 40 m off, with white noise."""
    chance = np.random.default_rng(seed)
    psi, x, y = 0.0, -120.0, 40.0
    for n in range(round(seconds * hz)):
        for _ in range(10):
            psi += LIMIT * np.sign(sin(0.7 * n / hz)) / hz / 10
            x, y = x + V * np.cos(psi) / hz / 10, y + V * np.sin(psi) / hz / 10
        z = hypot(x, y) + chance.normal(0, sigma)
        if chance.random() >= lost:
            yield RangeSample(n / hz, n / hz, z, told)


def believed(samples) -> list[float]:
    check = NoiseCheck(V, LIMIT)
    return [check.inflate(sample.stamp, sample.r, sample.sigma) for sample in samples]


@pytest.mark.parametrize("hz", [2.0, 5.0, 10.0, 50.0])
@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.5, 2.0])
def test_who_tells_the_truth_is_believed_however_the_vehicle_turns(hz, sigma):
    for seed in range(5):
        assert set(believed(ranges(sigma, sigma, hz=hz, seed=seed))) == {sigma}


@pytest.mark.parametrize(("told", "sigma"), [(0.01, 0.5), (0.1, 0.5), (0.5, 5.0)])
def test_a_sensor_that_says_too_little_is_found_out_within_seconds(told, sigma):
    for seed in range(5):
        sigmas = believed(ranges(told, sigma, seed=seed))
        assert sigmas[:20] == [told] * 20
        assert sigmas[60:] == pytest.approx([sigma] * len(sigmas[60:]), rel=0.8)
        assert np.median(sigmas[60:]) == pytest.approx(sigma, rel=0.35)


def test_a_sensor_that_says_too_much_is_left_alone():
    assert set(believed(ranges(2.0, 0.1))) == {2.0}


def test_lost_ranges_and_outliers_do_not_confuse_it():
    for seed in range(5):
        chance = np.random.default_rng(seed)
        samples = [
            RangeSample(s.stamp, s.time, s.r + chance.uniform(-50, 50), s.sigma) if chance.random() < 0.1 else s
            for s in ranges(0.5, 0.5, lost=0.3, seconds=60.0, seed=seed)
        ]
        assert set(believed(samples)) == {0.5}


def test_what_was_found_first_is_kept_for_telling():
    check = NoiseCheck(V, LIMIT)
    for sample in ranges(0.5, 0.5):
        check.inflate(sample.stamp, sample.r, sample.sigma)
    assert check.found is None
    for sample in ranges(0.01, 0.5):
        check.inflate(sample.stamp + 100, sample.r, sample.sigma)
    assert check.found == pytest.approx((0.01, 0.5), rel=0.6)
