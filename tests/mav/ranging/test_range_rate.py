"""Range rates as NAMED_VALUE_FLOAT in m/s, under the name of the mission, from the sender of the
ranges and with its clock."""

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.reader import RangeRateReader, RangeReader
from tests.mav.ranging.receiver import copter_identity
from tests.rig import Voice

RADIO = Voice(1, 192)


class Pair:
    """Readers of range and range rate, with messages of a radio packed by pymavlink."""

    def __init__(self, height=None, **settings):
        settings = RangingSettings("named_value_float", name="R", rate_name="RR", **settings)
        self.ranging = RangeReader(settings, copter_identity())
        self.height = height
        self.rates = RangeRateReader(settings, self.ranging, NoiseCheck.of_rates(15.0, 0.35), 15.0)

    def range(self, metres, now, stamp=None):
        message = self._named(b"R", metres, now, stamp, RADIO)
        sample = self.ranging.read(message, now, height=self.height)
        if sample is not None:
            self.rates.range_taken(sample)
        return sample

    def rate(self, value, now, stamp=None, sender=RADIO):
        message = self._named(b"RR", value, now, stamp, sender)
        assert self.rates.carries(message)
        assert self.ranging.read(message, now) is None
        return self.rates.read(message, now, height=self.height)

    def _named(self, name, value, now, stamp, sender):
        stamp = round(1000 * now) + 500_000 if stamp is None else stamp
        message = mavlink.MAVLink_named_value_float_message(stamp % 2**32, name, value)
        return sender.message(message)


@pytest.mark.parametrize(("sign", "rate"), [("opening", -4.5), ("closing", 4.5)])
def test_range_rate_sign_follows_mission(sign, rate):
    pair = Pair(rate_sign=sign)
    pair.range(100.0, 1.0)
    sample = pair.rate(-4.5, 1.01, stamp=501_000)
    assert (sample.r_dot, sample.sigma, sample.stamp, sample.time) == pytest.approx(
        (rate, 0.3, 501.0, 1.0)
    )


def test_range_rate_is_accepted_only_from_sender_of_ranges():
    pair = Pair()
    assert pair.rate(1.0, 1.0) is None
    pair.range(100.0, 1.1)
    assert pair.rate(1.0, 1.2) is not None
    assert pair.rate(1.0, 1.3, sender=Voice(1, 1)) is None


def test_impossible_range_rates_are_rejected():
    pair = Pair()
    pair.range(100.0, 1.0)
    assert [pair.rate(value, 1.0) for value in (math.nan, math.inf, 46.0, -46.0)] == [None] * 4
    assert pair.rate(3.0, 1.0) is not None


def test_old_and_repeated_range_rates_are_rejected():
    pair = Pair()
    pair.range(100.0, 1.0, stamp=2**32 - 50)
    assert pair.rate(1.0, 1.0, stamp=2**32 - 50) is not None
    assert pair.rate(1.0, 1.01, stamp=2**32 - 50) is None
    # the stamp has wrapped; the sample is 0.2 s old
    assert pair.rate(1.0, 1.3, stamp=50).time == pytest.approx(1.1)
    assert pair.rate(1.0, 1.9, stamp=250) is None  # the sample is 0.6 s old


def test_slant_range_rate_becomes_horizontal():
    """rho = sqrt(130^2 - 50^2) = 120 m. In level flight rho' is 130/120 of the slant rate."""
    pair = Pair(height=50.0)
    pair.range(130.0, 1.0)
    sample = pair.rate(-6.0, 1.0)
    assert (sample.r_dot, sample.sigma) == pytest.approx((-6.5, 0.3 * 130 / 120))


def test_range_rate_of_opposite_sign_is_reported():
    pair = Pair()
    samples = []
    for i in range(60):
        t = 1.0 + i / 10
        pair.range(400.0 - 10.0 * t, t)
        samples.append(pair.rate(10.0 + 0.01 * (i % 7), t))
    assert samples[0] is not None and samples[-1] is None
    assert "opposite sign: see ranging.rate_sign" in pair.rates.trouble
