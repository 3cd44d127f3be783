"""NAMED_VALUE_FLOAT: metres under an agreed name (mavlink.md 1.3)."""

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.ranging.interface import RangingSettings
from tests.mav.ranging.ear import Ear


class NamedEar(Ear):
    def __init__(self, name="RADIO", **settings):
        super().__init__(RangingSettings(message="named_value_float", name=name, sigma=0.5, **settings))

    def named(self, value, name="RADIO"):
        return self.hear(mavlink.MAVLink_named_value_float_message(501_000, name.encode(), value))


def test_it_counts_metres_and_milliseconds():
    sample = NamedEar().named(321.5)
    assert (sample.r, sample.sigma, sample.stamp) == (321.5, 0.5, 501.0)
    assert sample.source == "NAMED_VALUE_FLOAT"


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        *dict.fromkeys((math.nan, math.inf, -math.inf), "not_finite").items(),
        *((0.0, "no_range"), (-1, "no_range")),
        *((4.99, "below_min"), (5.0, None), (400.0, None), (400.1, "above_max")),
    ],
)
def test_a_value_that_is_no_range_or_beyond_the_missions_limits_is_rejected_by_its_reason(value, reason):
    ear = NamedEar(min_range=5.0, max_range=400.0)
    assert (ear.named(value) is None) == (reason is not None)
    assert ear.rejected == ({reason: 1} if reason else {})


@pytest.mark.parametrize(
    ("wanted", "name", "taken"), [("RADIO", "RADIO", 1), ("RADIO", "RADIO2", 0), ("R" * 10,) * 2 + (1,)]
)
def test_it_is_picked_by_its_name_of_up_to_ten_characters_and_others_are_not_counted(wanted, name, taken):
    ear = NamedEar(wanted)
    assert (ear.named(100.0, name) is not None) == taken
    assert ear.rejected == {}
