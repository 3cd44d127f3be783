"""Consistency of a measured range rate with the ranges."""

from math import cos, hypot, sin

import numpy as np
import pytest

from circnav_mav.guidance.rate_check import RateCheck

V = 15.0
HZ = 10.0


def flight(seconds, seed=1, sigma=0.5, rate_sigma=0.1, outliers=0.0, drifting=0.0, wind=5.0):
    """Return an approach and a circle of 100 m in wind: time, true range, true rate, measured range
    and measured rate."""
    chance = np.random.default_rng(seed)
    psi = 0.3
    x = -250.0
    y = 60.0
    slow = 0.0
    for n in range(round(seconds * HZ)):
        for _ in range(5):
            r = hypot(x, y)
            vx, vy = V * cos(psi) + wind, V * sin(psi)
            rate = (x * vx + y * vy) / r
            wanted = V / max(r, 40) + 0.06 * (rate + 8 * np.tanh(0.15 * (r - 100) / 8))
            psi += float(np.clip(wanted, -0.35, 0.35)) / HZ / 5
            x, y = x + vx / HZ / 5, y + vy / HZ / 5
        slow = 0.95 * slow + drifting * 0.31 * chance.normal()
        z = hypot(x, y) + sigma * chance.normal() + slow
        z += chance.uniform(-20, 20) if chance.random() < outliers else 0.0
        yield n / HZ, z, rate, rate + rate_sigma * chance.normal()


def check_rates(report, **noise):
    """Return the check, and the times (s) at which it dropped or accepted the rates. report:
    function of time, true rate and measured rate; returns the reported rate."""
    check = RateCheck()
    changes = []
    was = True
    for t, z, true, measured in flight(**noise):
        check.add_rate(t, report(t, true, measured))
        check.add_range(
            t,
            z,
            hypot(noise.get("sigma", 0.5), noise.get("drifting", 0.0)),
            noise.get("rate_sigma", 0.1),
        )
        if check.trusted != was:
            was = check.trusted
            changes.append(t)
    return check, changes


@pytest.mark.parametrize(
    "noise",
    [
        {},
        {"rate_sigma": 0.3},
        {"sigma": 0.02, "drifting": 0.15},
        {"outliers": 0.1},
        {"sigma": 1.0, "drifting": 2},
    ],
)
def test_range_rate_check_trusts_correct_range_rate(noise):
    for seed in (1, 2):
        check, changes = check_rates(
            lambda t, true, measured: measured, seconds=150.0, seed=seed, **noise
        )
        assert changes == []
        assert abs(check.bias) < 0.2


@pytest.mark.parametrize("since", [0.0, 6.0])
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (lambda true, measured: -measured, "opposite sign: see ranging.rate_sign"),
        (lambda true, measured: 1.5 * measured, "ranges change by"),
        (lambda true, measured: measured + 3.0, "ranges change by"),
        (lambda true, measured: 4.0, "ranges change by"),
    ],
    ids=["sign", "scale", "bias", "frozen"],
)
def test_range_rate_check_rejects_wrong_rate_within_3_s(since, fault, words):
    report = lambda t, true, measured: fault(true, measured) if t >= since else measured  # noqa: E731
    check, changes = check_rates(report, seconds=since + 9.0)
    assert changes[0] <= since + 3.0
    assert since or words in check.why


def test_range_rate_check_retries_rejected_rate_after_growing_delay():
    def report(t, true, measured):
        return measured + (5.0 if t < 20.0 or 40.0 <= t < 50.0 else 0.0)

    _, changes = check_rates(report, seconds=90.0)
    dropped, again, dropped_again, at_last = changes
    assert dropped <= 3.0
    assert 30.0 <= again <= 36.0
    assert 40.0 <= dropped_again <= 43.0
    assert 70.0 <= at_last <= 76.0


def test_range_rate_check_rejects_wrong_sign_throughout_circle():
    check, changes = check_rates(lambda t, true, measured: -measured, seconds=200.0, wind=0.0)
    assert (len(changes), check.trusted) == (1, False)


def test_range_rate_check_rejects_small_bias_within_20_s():
    """The slope over 2.5 s does not show this bias. The slope over 15 s shows it."""
    _, changes = check_rates(lambda t, true, measured: measured + 0.5, seconds=20.0)
    assert changes[0] > 10.0


def test_range_rate_check_estimates_small_carrier_offset():
    check, changes = check_rates(lambda t, true, measured: measured + 0.2, seconds=60.0)
    assert changes == []
    assert check.bias == pytest.approx(0.2, abs=0.1)
    check.reset()
    assert check.bias == 0.0
