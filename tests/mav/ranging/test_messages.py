"""Ranges decoded from each ranging message, by its MAVLink definition, including the codes for "no
range"."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from tests.mav.ranging.receiver import Receiver
from tests.rig import Voice, beacon, distance

NONE = 2**32 - 1
DISTANCE = RangingSettings(message="distance_sensor", sigma_m=0.5)
BEACON = RangingSettings(message="ranging_beacon", beacon_id=3, sigma_m=0.5)
NAMED = RangingSettings(message="named_value_float", name="RADIO", sigma_m=0.5)


def sensor(cm, stamp_ms=501_000, **fields):
    return distance(cm, stamp_ms, **fields)


def radio(mm, stamp_us=501_000_000, sequence=0, **fields):
    return beacon(mm, stamp_us, sequence, **{"beacon_id": 3, **fields})


def named(metres, name="RADIO"):
    return mavlink.MAVLink_named_value_float_message(501_000, name.encode(), metres)


def test_ranging_messages_match_mavlink_definitions():
    for kind in RANGING_MESSAGES.values():
        assert mavlink.mavlink_map[kind.id].msgname == kind.type
        assert set(kind.marks) <= set(mavlink.mavlink_map[kind.id].fieldnames)
    # current_distance: u16, cm; 65535 means no range
    assert RANGING_MESSAGES["distance_sensor"].farthest == 655.34
    # range: u32, mm; the largest value means no range
    assert RANGING_MESSAGES["ranging_beacon"].farthest == 4_294_967.0
    other = Receiver(BEACON)
    assert other.distance() is None
    assert other.rejected == {}


@pytest.mark.parametrize(
    ("settings", "message", "expected"),
    [
        # range in cm, variance in cm^2, stamp in ms
        (DISTANCE, sensor(12345, covariance=100), (123.45, 0.10, 501.0)),
        # ArduPilot always sends variance 0: use sigma_m of the mission
        (DISTANCE, sensor(12345, covariance=0), (123.45, 0.5, 501.0)),
        # 255 means unknown, by the definition: use sigma_m of the mission
        (DISTANCE, sensor(12345, covariance=255), (123.45, 0.5, 501.0)),
        # range and accuracy in mm, stamp in us
        (BEACON, radio(1_234_567, range_accuracy=120), (1234.567, 0.120, 501.0)),
        (BEACON, radio(1_234_567, range_accuracy=0), (1234.567, 0.5, 501.0)),
        (BEACON, radio(1_234_567, range_accuracy=NONE), (1234.567, 0.5, 501.0)),
        # stamp since 1970
        (BEACON, radio(1000, 1_700_000_000_250_000), (1.0, 0.5, 1_700_000_000.25)),
        (NAMED, named(321.5), (321.5, 0.5, 501.0)),  # range in m, stamp in ms
    ],
)
def test_ranging_messages_use_units_of_their_definition(settings, message, expected):
    sample = Receiver(settings).receive(message, 2.0)
    assert (sample.r, sample.sigma, sample.stamp) == pytest.approx(expected, rel=1e-12)
    assert (sample.time, sample.source) == (2.0, message.get_type())


@pytest.mark.parametrize(
    ("settings", "message", "reason"),
    [
        (DISTANCE, sensor(0), "no_range"),
        (DISTANCE, sensor(1, min_distance=0), None),
        (DISTANCE, sensor(19, min_distance=20), "below_min"),
        (DISTANCE, sensor(20, min_distance=20), None),
        (DISTANCE, sensor(59999, max_distance=60000), None),
        (DISTANCE, sensor(60000, max_distance=60000), "no_range"),
        (DISTANCE, sensor(60001, max_distance=60000), "no_range"),
        (DISTANCE, sensor(65534, max_distance=65535), None),
        (DISTANCE, sensor(65534, max_distance=0), None),
        (DISTANCE, sensor(65535, max_distance=65535), "no_range"),
        (DISTANCE, sensor(65535, max_distance=0), "no_range"),
        (DISTANCE, sensor(10000, signal_quality=0), None),
        (DISTANCE, sensor(10000, signal_quality=1), "poor_quality"),
        (DISTANCE, sensor(10000, signal_quality=2), None),
        (BEACON, radio(0), "no_range"),
        (BEACON, radio(NONE), "no_range"),
        (BEACON, radio(100_000, status=1), "poor_quality"),
        (BEACON, radio(100_000, status=255), "poor_quality"),
        (BEACON, radio(100_000, status=0xFE), None),
        (BEACON, radio(100_000, beacon_id=4), "other_sensor"),
        *((NAMED, named(value), "not_finite") for value in (math.nan, math.inf, -math.inf)),
        *((NAMED, named(value), "no_range") for value in (0.0, -1.0)),
        *((NAMED, named(value), None) for value in (5.0, 1e6)),
        (NAMED, named(1.001e6), "above_max"),
    ],
)
def test_invalid_ranging_message_is_rejected_with_reason(settings, message, reason):
    receiver = Receiver(settings)
    assert (receiver.receive(message) is None) == (reason is not None)
    assert receiver.rejected == ({reason: 1} if reason else {})


@pytest.mark.parametrize(
    ("marks", "message", "accepted"),
    [
        ({"sensor_id": 2, "orientation": 24}, sensor(10000, id=2), True),
        ({"sensor_id": 2, "orientation": 24}, sensor(10000, id=3), False),
        ({"sensor_id": 2, "orientation": 24}, sensor(10000, id=2, orientation=0), False),
        ({"sensor_id": 0, "orientation": 0}, sensor(10000, id=0, orientation=0), True),
        ({"sensor_id": 0, "orientation": 0}, sensor(10000, id=1, orientation=0), False),
        ({"sensor_id": 0, "orientation": 0}, sensor(10000, id=0, orientation=24), False),
        ({}, sensor(10000, orientation=25), None),  # a downward sensor measures the height
        ({"orientation": 25}, sensor(10000, orientation=25), None),
        # NAMED_VALUE_FLOAT: only the value with the name of the mission is a range
        ({"name": "RADIO"}, named(100.0, "RADIO2"), None),
        ({"name": "R" * 10}, named(100.0, "R" * 10), True),
    ],
)
def test_ranging_message_is_selected_by_fields_of_mission(marks, message, accepted):
    receiver = Receiver(RangingSettings(message=message.get_type().lower(), **marks))
    assert (receiver.receive(message) is not None) == bool(accepted)
    assert receiver.rejected == ({"other_sensor": 1} if accepted is False else {})
    assert receiver.reader.refused == 0


@pytest.mark.parametrize("component", [1, 192])
def test_equal_range_within_measurement_period_is_repetition(component):
    """An autopilot sends its last range again, and many radios print each line several times. A
    radio with a resolution of 1 m may measure equal ranges, one in each period."""
    receiver = Receiver()
    taken = [
        receiver.distance(15000, now=now, sender=Voice(1, component)) is not None
        for now in (1.0, 1.02, 1.08, 1.1, 1.2)
    ]
    assert taken == [True, False, False, True, True]
    assert receiver.rejected == {"repeat": 2}


def test_repeated_beacon_sequence_is_rejected():
    receiver = Receiver(BEACON)
    messages = [
        radio(100_000, 501_000_000 + 100_000 * i, number)
        for i, number in enumerate((255, 255, 0, 1))
    ]
    assert [receiver.receive(one, 1 + 0.1 * i) is not None for i, one in enumerate(messages)] == [
        True,
        False,
        True,
        True,
    ]
    assert receiver.rejected == {"repeat": 1}


@given(
    cm=st.integers(0, 65535),
    low=st.integers(0, 65535),
    high=st.integers(0, 65535),
    stamp=st.integers(0, 2**32 - 1),
    quality=st.integers(0, 255),
    covariance=st.integers(0, 255),
    way=st.integers(0, 255),
    height=st.floats(0, 700),
)
def test_distance_sensor_samples_are_finite_and_positive(
    cm, low, high, stamp, quality, covariance, way, height
):
    receiver = Receiver(height=height)
    fields = {
        "min_distance": low,
        "max_distance": high,
        "signal_quality": quality,
        "covariance": covariance,
    }
    sample = receiver.distance(cm, stamp=stamp, orientation=way, **fields)
    if sample is None:
        assert sum(receiver.rejected.values()) == (way != 25)
    else:
        assert 0 < sample.r <= 655.34
        assert 0 < sample.sigma < math.inf


@given(
    readings=st.lists(
        st.tuples(st.integers(0, NONE), st.integers(0, 2**64 - 1), st.integers(0, 255)), max_size=20
    )
)
def test_every_beacon_message_is_accepted_or_counted(readings):
    receiver = Receiver(BEACON)
    samples = [receiver.receive(radio(*reading), 1 + 0.1 * i) for i, reading in enumerate(readings)]
    assert all(sample is None or sample.time <= 1 + 0.1 * i for i, sample in enumerate(samples))
    assert samples.count(None) == sum(receiver.rejected.values())
