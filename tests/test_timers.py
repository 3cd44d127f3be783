"""Hysteresis, low-pass filter and reports with the time of their last change."""

from math import exp

import pytest

from circnav_mav.timers import Hysteresis, LowPass, Report


def states(inputs: str, raise_after: float, clear_after: float) -> str:
    """Return the states after inputs of 1 s each: x is active."""
    state = Hysteresis(raise_after, clear_after)
    return "".join(
        "x" if state.update(one == "x", float(now)) else "." for now, one in enumerate(inputs)
    )


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        ("..xxx.xxxx", "........." + "x"),  # an interruption starts the time again
        ("xxxxx.x..x...", "...xxxxxxxxx."),
        ("xxxx..xxx", "...xxxxxx"),
    ],
)
def test_hysteresis_changes_only_after_uninterrupted_input(inputs, expected):
    assert states(inputs, 3.0, 2.0) == expected


def test_hysteresis_without_times_equals_its_input():
    assert states("x.xx..", 0.0, 0.0) == "x.xx.."


def test_low_pass_forgets_first_sample_exponentially():
    low_pass = LowPass(2.0)
    assert low_pass.update(5.0, 0.1) == 5.0
    assert low_pass.update(1.0, 3.0) == pytest.approx(1 + 4 * exp(-1.5))


def test_report_is_treated_as_missing_when_old_or_frozen():
    report: Report[float] = Report()
    assert report.live(0.0, 1.0) is None
    for now in (0.0, 1.0, 2.0):
        report.update(7.0, now)
    assert (report.age(2.5), report.unchanged) == (0.5, 2.0)
    assert report.live(2.5, 1.0, 2.0) == 7.0
    assert report.live(3.5, 1.0) is None
    assert report.live(2.5, 1.0, 1.9) is None
    report.update(7.0, 3.0, must_change=False)
    assert report.live(3.0, 1.0, 1.9) is None, "still the value that did not change"
    report.update(7.5, 4.0)
    assert report.live(4.0, 1.0, 0.0) == 7.5
