"""DISTANCE_SENSOR: cm, cm^2 and ms; what it says when there is no range (mavlink.md 1.2)."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from tests.mav.ranging.ear import Ear


def test_it_counts_centimetres_square_centimetres_and_milliseconds():
    sample = Ear().distance(12345, stamp=500_000, now=2.0, covariance=100)
    assert (sample.r, sample.sigma, sample.stamp) == pytest.approx((123.45, 0.10, 500.0))
    assert (sample.time, sample.source) == (2.0, "DISTANCE_SENSOR")
    assert RANGING_MESSAGES["distance_sensor"].farthest == 655.34  # u16 centimetres of which 65535 means none


@pytest.mark.parametrize("unknown", [0, 255])
def test_an_unknown_covariance_gives_the_missions_noise(unknown):
    """255 by the definition; ArduPilot fills in 0 always."""
    assert Ear().distance(covariance=unknown).sigma == 0.5


@pytest.mark.parametrize(
    ("cm", "fields", "reason"),
    [
        (0, {}, "no_range"),
        (1, {"min_distance": 0}, None),
        (19, {"min_distance": 20}, "below_min"),
        (20, {"min_distance": 20}, None),
        (59999, {"max_distance": 60000}, None),
        (60000, {"max_distance": 60000}, "no_range"),
        (60001, {"max_distance": 60000}, "no_range"),
        (65534, {"max_distance": 65535}, None),
        (65534, {"max_distance": 0}, None),
        (65535, {"max_distance": 65535}, "no_range"),
        (65535, {"max_distance": 0}, "no_range"),
        (10000, {"signal_quality": 0}, None),
        (10000, {"signal_quality": 1}, "poor_quality"),
        (10000, {"signal_quality": 2}, None),
    ],
)
def test_a_distance_within_its_limits_is_taken_and_another_rejected_by_its_reason(cm, fields, reason):
    ear = Ear()
    sample = ear.distance(cm, **fields)
    assert ear.rejected == ({reason: 1} if reason else {})
    assert (sample is None) if reason else sample.r == pytest.approx(cm / 100)


@pytest.mark.parametrize("wanted", [None, 25])
def test_a_downward_sensor_measures_height_and_is_never_taken(wanted):
    ear = Ear(RangingSettings(message="distance_sensor", orientation=wanted))
    assert ear.distance(orientation=25) is None
    assert ear.rejected == {}


@pytest.mark.parametrize(
    ("wanted", "fields", "taken"),
    [
        ((2, 24), {"id": 2}, True),
        ((2, 24), {"id": 3}, False),
        ((2, 24), {"id": 2, "orientation": 0}, False),
        ((0, 0), {"id": 0, "orientation": 0}, True),
        ((0, 0), {"id": 1, "orientation": 0}, False),
        ((0, 0), {"id": 0, "orientation": 24}, False),
    ],
)
def test_it_is_picked_by_id_and_orientation(wanted, fields, taken):
    ear = Ear(RangingSettings(message="distance_sensor", sensor_id=wanted[0], orientation=wanted[1]))
    assert (ear.distance(**fields) is not None) == taken
    assert ear.rejected == ({} if taken else {"other_sensor": 1})
    assert ear.reader.refused == 0, "another sensor is nobody's error"


@given(
    cm=st.integers(0, 65535), low=st.integers(0, 65535), high=st.integers(0, 65535), stamp=st.integers(0, 2**32 - 1),
    quality=st.integers(0, 255), covariance=st.integers(0, 255), way=st.integers(0, 255), height=st.floats(0, 700),
)  # fmt: skip
def test_whatever_it_says_a_sample_is_finite_and_positive(cm, low, high, stamp, quality, covariance, way, height):
    ear = Ear(height=height)
    fields = {"min_distance": low, "max_distance": high, "signal_quality": quality, "covariance": covariance}
    sample = ear.distance(cm, stamp=stamp, orientation=way, **fields)
    if sample is None:
        assert sum(ear.rejected.values()) == (way != 25)
    else:
        assert 0 < sample.r <= 655.34
        assert 0 < sample.sigma < math.inf
