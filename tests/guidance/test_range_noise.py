"""The noise check: it compares the scatter of the ranges with the reported sigma and detects frozen
ranges."""

from math import hypot, sin

import numpy as np
import pytest

from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.types import RangeSample

V = 15.0
LIMIT = 0.35


def ranges(
    reported: float,
    sigma: float,
    *,
    hz: float = 10.0,
    seconds: float = 20.0,
    seed: int = 1,
    lost: float = 0.0,
):
    """Return ranges with white noise. The vehicle passes a target at 40 m and turns at its limit to
    alternating sides."""
    chance = np.random.default_rng(seed)
    psi = 0.0
    x = -120.0
    y = 40.0
    for n in range(round(seconds * hz)):
        for _ in range(10):
            psi += LIMIT * np.sign(sin(0.7 * n / hz)) / hz / 10
            x, y = x + V * np.cos(psi) / hz / 10, y + V * np.sin(psi) / hz / 10
        z = hypot(x, y) + chance.normal(0, sigma)
        if chance.random() >= lost:
            yield RangeSample(n / hz, n / hz, z, reported)


def corrected_sigmas(samples, check=None) -> list[float]:
    check = check or NoiseCheck.of_ranges(V, LIMIT)
    return [check.corrected(sample.stamp, sample.r, sample.sigma) for sample in samples]


@pytest.mark.parametrize("hz", [2.0, 5.0, 10.0, 50.0])
@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.5, 2.0])
def test_noise_check_uses_reported_sigma_when_correct_during_turns(hz, sigma):
    for seed in range(3):
        assert set(corrected_sigmas(ranges(sigma, sigma, hz=hz, seed=seed))) == {sigma}


@pytest.mark.parametrize(("reported", "sigma"), [(0.01, 0.5), (0.1, 0.5), (0.5, 5.0)])
def test_noise_check_raises_too_small_sigma_within_seconds(reported, sigma):
    for seed in range(3):
        check = NoiseCheck.of_ranges(V, LIMIT)
        sigmas = corrected_sigmas(ranges(reported, sigma, seed=seed), check)
        assert check.found == pytest.approx((reported, sigma), rel=0.6)
        assert sigmas[:20] == [reported] * 20
        assert sigmas[30] > 2 * reported
        assert sigmas[60:] == pytest.approx([sigma] * len(sigmas[60:]), rel=0.8)
        assert np.median(sigmas[60:]) == pytest.approx(sigma, rel=0.35)


def circling(
    reported: float,
    sigma: float,
    *,
    drifting: float = 0.0,
    step: float = 0.0,
    seconds: float = 60.0,
    seed: int = 1,
):
    """Return ranges on a circle whose radius oscillates by 0.5 m in wind. drifting: sigma of a slow
    error with a time constant of 2 s, m. step: resolution of the ranges, m."""
    chance = np.random.default_rng(seed)
    slow = 0.0
    for n in range(round(seconds * 10)):
        slow = 0.951 * slow + drifting * 0.309 * chance.normal()
        z = 100.0 + 0.5 * sin(0.15 * n / 10) + slow + chance.normal(0, sigma)
        yield RangeSample(n / 10, n / 10, round(z / step) * step if step else z, reported)


@pytest.mark.parametrize(
    ("sigma", "drifting", "least", "most"), [(0.1, 0, 0.15, 0.27), (0.02, 0.15, 0.08, 0.25)]
)
def test_noise_check_lowers_too_large_sigma_with_margin(sigma, drifting, least, most):
    """The UWB radio reports a sigma of 0.5 m. Its true error is 0.1 m, white or slow."""
    for seed in range(3):
        sigmas = corrected_sigmas(circling(0.5, sigma, drifting=drifting, seed=seed))
        assert sigmas[:200] == [0.5] * 200
        assert sigmas[250] < most
        assert least < np.median(sigmas[300:]) < most


def test_noise_check_lowers_too_large_sigma_during_turns():
    assert corrected_sigmas(ranges(1.0, 0.05, seconds=60.0))[-1] < 0.5


def test_noise_check_does_not_lower_sigma_of_slow_error():
    for seed in range(3):
        assert set(corrected_sigmas(circling(0.15, 0.02, drifting=0.15, seed=seed))) == {0.15}
        assert set(corrected_sigmas(circling(2.24, 1.0, drifting=2.0, seed=seed))) == {2.24}


def test_noise_check_lowers_sigma_no_further_than_message_resolution():
    assert min(corrected_sigmas(circling(0.5, 0.0, step=0.01))) >= 0.01
    assert min(corrected_sigmas(circling(2.0, 0.0, step=1.0, seconds=120.0))) >= 0.29


def test_noise_check_measures_resolution_that_becomes_coarse_in_flight():
    """With the smallest difference of the whole flight as the resolution, a copter of PX4 lost its
    circle."""
    fine = list(circling(0.5, 0.3, step=0.01))
    coarse = [
        sample._replace(stamp=sample.stamp + 60.0, time=sample.time + 60.0)
        for sample in circling(0.5, 0.3, step=1.0, seconds=120.0)
    ]
    assert min(corrected_sigmas([*fine, *coarse])[-900:]) >= 0.29


def test_noise_check_raises_lowered_sigma_when_noise_grows():
    check = NoiseCheck.of_ranges(V, LIMIT)
    sigmas = [
        check.corrected(t + s.stamp, s.r, 0.5)
        for t, sigma in ((0.0, 0.1), (60.0, 0.5))
        for s in circling(0.5, sigma)
    ]
    assert np.median(sigmas[400:600]) < 0.3
    assert min(sigmas[660:]) == 0.5


def repeated(samples, *, moving=True, since=None) -> list[float]:
    """Return, after each range, the duration (s) of the frozen state that the check reports. From
    the stamp `since` on, the range is constant."""
    check = NoiseCheck.of_ranges(V, LIMIT)
    frozen_times = []
    held = None
    for sample in samples:
        held = sample.r if held is None or since is None or sample.stamp <= since else held
        check.corrected(sample.stamp, held, sample.sigma, moving=moving)
        frozen_times.append(check.repeated)
    return frozen_times


@pytest.mark.parametrize("approach", [False, True])
def test_noise_check_reports_constant_range_after_10_s(approach):
    frozen_times = repeated((ranges if approach else circling)(0.5, 0.1, seconds=40.0), since=15.0)
    assert not any(frozen_times[:249])
    assert frozen_times[252] == pytest.approx(10.0, abs=0.3)
    assert all(frozen_times[252:])


def test_noise_check_reports_frozen_radio_only_during_motion():
    assert repeated(circling(0.5, 0.1), since=0.0)[105]
    assert not any(repeated(circling(0.5, 0.1), since=0.0, moving=False))


@pytest.mark.parametrize(("sigma", "step"), [(0.02, 1.0), (0.1, 2.0), (0.0, 0.01)])
def test_noise_check_accepts_coarse_radio_on_perfect_circle(sigma, step):
    """The approach shows the resolution of the radio. On the circle the range is then constant
    although the radio works."""
    way = [
        RangeSample(s.stamp, s.stamp, round(s.r / step) * step, 0.5)
        for s in ranges(0.5, sigma, seconds=15.0)
    ]
    circle = [RangeSample(15.0 + n / 10, 0.0, 100.0, 0.5) for n in range(600)]
    settles = [
        RangeSample(15.0 + n / 10, 0.0, round((100 + 40 * 0.9**n) / step) * step, 0.5)
        for n in range(80)
    ]
    later = [RangeSample(s.stamp + 8.0, 0.0, s.r, 0.5) for s in circle]
    assert not any(repeated([*way, *settles, *later]))


def test_noise_check_ignores_lost_ranges_and_outliers():
    for seed in range(5):
        chance = np.random.default_rng(seed)
        samples = [
            RangeSample(s.stamp, s.time, s.r + chance.uniform(-50, 50), s.sigma)
            if chance.random() < 0.1
            else s
            for s in ranges(0.5, 0.5, lost=0.3, seconds=60.0, seed=seed)
        ]
        assert set(corrected_sigmas(samples)) == {0.5}
