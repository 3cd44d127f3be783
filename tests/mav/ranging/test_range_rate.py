"""NAMED_VALUE_FLOAT: meters per second under an agreed name, beside the range of the same sender
and clock."""

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.reader import RangeRateReader, RangeReader
from tests.rig import Voice

RADIO = Voice(1, 192)


class Pair:
    """A radio's range and rate, through pymavlink."""

    def __init__(self, height=None, **settings):
        settings = RangingSettings("named_value_float", name="R", rate_name="RR", **settings)
        self.ranging = RangeReader(settings)
        self.height = height
        self.rates = RangeRateReader(settings, self.ranging, NoiseCheck.of_rates(15.0, 0.35), 15.0)

    def range(self, metres, now, stamp=None):
        message = self._named(b"R", metres, now, stamp, RADIO)
        sample = self.ranging.read(message, now, height=self.height)
        if sample is not None:
            self.rates.range_taken(sample)
        return sample

    def rate(self, value, now, stamp=None, speaker=RADIO):
        message = self._named(b"RR", value, now, stamp, speaker)
        assert self.rates.carries(message)
        assert self.ranging.read(message, now) is None
        return self.rates.read(message, now, height=self.height)

    def _named(self, name, value, now, stamp, speaker):
        stamp = round(1000 * now) + 500_000 if stamp is None else stamp
        message = mavlink.MAVLink_named_value_float_message(stamp % 2**32, name, value)
        return speaker.message(message)


@pytest.mark.parametrize(("sign", "rate"), [("opening", -4.5), ("closing", 4.5)])
def test_it_is_positive_away_from_the_target_whichever_way_the_radio_counts(sign, rate):
    pair = Pair(rate_sign=sign)
    pair.range(100.0, 1.0)
    sample = pair.rate(-4.5, 1.01, stamp=501_000)
    assert (sample.r_dot, sample.sigma, sample.stamp, sample.time) == pytest.approx(
        (rate, 0.3, 501.0, 1.0)
    )


def test_it_counts_only_from_the_sender_of_the_ranges_and_after_the_first_of_them():
    pair = Pair()
    assert pair.rate(1.0, 1.0) is None
    pair.range(100.0, 1.1)
    assert pair.rate(1.0, 1.2) is not None
    assert pair.rate(1.0, 1.3, speaker=Voice(1, 1)) is None


def test_a_value_that_is_no_range_rate_of_this_vehicle_is_left_out():
    pair = Pair()
    pair.range(100.0, 1.0)
    assert [pair.rate(value, 1.0) for value in (math.nan, math.inf, 46.0, -46.0)] == [None] * 4
    assert pair.rate(3.0, 1.0) is not None


def test_it_has_the_clock_of_the_ranges_old_and_repeated_ones_are_left_out():
    pair = Pair()
    pair.range(100.0, 1.0, stamp=2**32 - 50)
    assert pair.rate(1.0, 1.0, stamp=2**32 - 50) is not None
    assert pair.rate(1.0, 1.01, stamp=2**32 - 50) is None
    assert pair.rate(1.0, 1.3, stamp=50).time == pytest.approx(1.1)  # the stamp wraps, 0.2 s late
    assert pair.rate(1.0, 1.9, stamp=250) is None  # 0.6 s late


def test_a_slant_range_rate_is_made_horizontal_as_its_range_is():
    """rho = sqrt(130^2 - 50^2) = 120 m. In level flight rho' is 130/120 of the slant rate."""
    pair = Pair(height=50.0)
    pair.range(130.0, 1.0)
    sample = pair.rate(-6.0, 1.0)
    assert (sample.r_dot, sample.sigma) == pytest.approx((-6.5, 0.3 * 130 / 120))


def test_a_lie_is_left_out_and_named():
    pair = Pair()
    said = []
    for i in range(60):
        t = 1.0 + i / 10
        pair.range(400.0 - 10.0 * t, t)
        said.append(pair.rate(10.0 + 0.01 * (i % 7), t))
    assert said[0] is not None and said[-1] is None
    assert "opposite sign: see ranging.rate_sign" in pair.rates.trouble
