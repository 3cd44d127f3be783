"""What preflight says of a radio that measures the range rate, and of one that is frozen."""

import pytest

from circnav_mav.mav.check_result import Grade
from tests.pilot.test_preflight import Bench, bent, of, one, surveyed

RADIO = ("ranging.message=named_value_float", "ranging.rate_name=RR", "ranging.rate_sigma_mps=0.2")
SENDS = ("sim.ranging.message=named_value_float", "sim.ranging.rate_name=RR")


def line(*keys: str):
    return one(Bench("quickstart", *RADIO, *keys).lines(), "range rate")


@pytest.mark.parametrize(
    ("keys", "grade", "says"),
    [
        (SENDS, Grade.PASS, " Hz, newest "),
        ((*SENDS, "sim.ranging.rate_noise_mps=0.8"), Grade.WARN, "set ranging.rate_sigma_mps to it"),
        (SENDS[:1], Grade.FAIL, "0 NAMED_VALUE_FLOAT RR"),
        ((*SENDS, "sim.ranging.rate_noise_mps=0.0", "sim.ranging.rate_bias_mps=0.0"), Grade.WARN, "frozen, or too"),
    ],
)
def test_the_range_rate_is_judged_by_its_rate_and_its_noise(keys, grade, says):
    found = line(*keys)
    assert (found.grade, says in found.says) == (grade, True)


def test_a_rate_that_does_not_go_with_the_ranges_fails():
    found = line(*SENDS, "sim.ranging.rate_bias_mps=20.0")
    assert found.grade is Grade.FAIL
    assert "ranges change by" in found.says


def test_without_the_key_nothing_is_said_of_a_range_rate():
    assert of(Bench("quickstart").lines(), "range rate") == []


def test_a_range_that_never_changes_is_no_pass():
    ranges = surveyed("arducopter")[1].ranges
    still = tuple(type(one)(one.stamp, one.time, one.arrival, 150.0, one.sigma) for one in ranges)
    found = one(bent("arducopter", ranges=still), "noise")
    assert found.grade is Grade.WARN
    assert "a frozen radio" in found.says
