"""Which ranging messages become samples, and by which counter the others are refused (mavlink.md 1.1 to 1.5)."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.reader import RangeReader
from circnav_mav.mav.ranging.table import RANGING_MESSAGES

UINT32_MAX = 2**32 - 1
DISTANCE = RangingSettings(message="distance_sensor", sigma=0.5)
BEACON = RangingSettings(message="ranging_beacon", beacon_id=3, sigma=0.5)
NAMED = RangingSettings(message="named_value_float", name="RADIO", sigma=0.5)


class Ear:
    """A reader fed with messages that really went through pymavlink."""

    def __init__(self, settings, say, voice, height=None):
        self.reader, self.say, self.voice = RangeReader(settings), say, voice
        self.speaker = voice(1, 1)
        self.height = height

    def hear(self, message, now, speaker=None):
        return self.reader.read((speaker or self.speaker).message(message), now, height=self.height)

    def distance(self, cm=10000, stamp=None, now=1.0, speaker=None, **rest):
        stamp = round(now * 1000) + 500_000 if stamp is None else stamp
        return self.hear(self.say.distance(cm, stamp, **rest), now, speaker)

    def beacon(self, mm=100_000, stamp=None, sequence=0, now=1.0, **rest):
        stamp = round(now * 1e6) + 500_000_000 if stamp is None else stamp
        return self.hear(self.say.beacon(mm, stamp, sequence, **{"beacon_id": 3, **rest}), now)

    def named(self, value, stamp=None, now=1.0, name="RADIO"):
        stamp = round(now * 1000) + 500_000 if stamp is None else stamp
        return self.hear(mavlink.MAVLink_named_value_float_message(stamp, name.encode(), value), now)

    @property
    def rejected(self):
        return dict(self.reader.rejected)


@pytest.fixture
def ear(say, voice):
    return lambda settings=DISTANCE, height=None: Ear(settings, say, voice, height)


# --- units: where centimetres, millimetres and milliseconds end ---


def test_a_distance_sensor_counts_centimetres_and_square_centimetres(ear):
    sample = ear().distance(12345, stamp=500_000, now=2.0, covariance=100)
    assert sample.r == pytest.approx(123.45)
    assert sample.sigma == pytest.approx(0.10)
    assert sample.stamp == pytest.approx(500.0)
    assert sample.time == 2.0
    assert sample.source == "DISTANCE_SENSOR"


def test_a_ranging_beacon_counts_millimetres_and_microseconds(ear):
    sample = ear(BEACON).beacon(1_234_567, stamp=1_700_000_000_250_000, range_accuracy=120)
    assert sample.r == pytest.approx(1234.567)
    assert sample.sigma == pytest.approx(0.120)
    assert sample.stamp == pytest.approx(1_700_000_000.25)
    assert sample.source == "RANGING_BEACON"


def test_a_named_value_counts_metres(ear):
    sample = ear(NAMED).named(321.5, stamp=500_000)
    assert (sample.r, sample.sigma, sample.stamp) == (321.5, 0.5, 500.0)
    assert sample.source == "NAMED_VALUE_FLOAT"


@pytest.mark.parametrize("unknown", [0, 255])
def test_an_unknown_covariance_gives_the_missions_noise(ear, unknown):
    """255 by the definition; ArduPilot fills in 0 always."""
    assert ear().distance(covariance=unknown).sigma == 0.5


@pytest.mark.parametrize("unknown", [0, UINT32_MAX])
def test_an_unknown_accuracy_gives_the_missions_noise(ear, unknown):
    assert ear(BEACON).beacon(range_accuracy=unknown).sigma == 0.5


def test_the_farthest_ranges_are_those_of_the_fields():
    """u16 centimetres of which 65535 means none; u32 millimetres of which the last means none."""
    assert RANGING_MESSAGES["distance_sensor"].farthest == 655.34
    assert RANGING_MESSAGES["ranging_beacon"].farthest == 4_294_967.0
    assert {kind.type: kind.id for kind in RANGING_MESSAGES.values()} == {
        "DISTANCE_SENSOR": 132,
        "RANGING_BEACON": 513,
        "NAMED_VALUE_FLOAT": 251,
    }


# --- values that are no range ---


@pytest.mark.parametrize(
    ("cm", "fields", "reason"),
    [
        (0, {}, "no_range"),
        (65535, {"max_distance": 65535}, "no_range"),
        (65535, {"max_distance": 0}, "no_range"),
        (60000, {"max_distance": 60000}, "no_range"),
        (60001, {"max_distance": 60000}, "no_range"),
        (19, {"min_distance": 20}, "below_min"),
        (10000, {"signal_quality": 1}, "poor_quality"),
    ],
)
def test_a_distance_that_is_none_is_refused_by_its_reason(ear, cm, fields, reason):
    heard = ear()
    assert heard.distance(cm, **fields) is None
    assert heard.rejected == {reason: 1}


@pytest.mark.parametrize(
    ("cm", "fields"),
    [
        (1, {"min_distance": 0}),
        (20, {"min_distance": 20}),
        (59999, {"max_distance": 60000}),
        (65534, {"max_distance": 65535}),
        (65534, {"max_distance": 0}),
        (10000, {"signal_quality": 0}),
        (10000, {"signal_quality": 2}),
        (10000, {"signal_quality": 100}),
    ],
)
def test_a_distance_just_within_its_limits_is_taken(ear, cm, fields):
    heard = ear()
    assert heard.distance(cm, **fields).r == pytest.approx(cm / 100)
    assert heard.rejected == {}


@pytest.mark.parametrize(
    ("mm", "fields", "reason"),
    [
        (0, {}, "no_range"),
        (UINT32_MAX, {}, "no_range"),
        (100_000, {"status": 1}, "poor_quality"),
        (100_000, {"status": 255}, "poor_quality"),
    ],
)
def test_a_beacon_range_that_is_none_is_refused_by_its_reason(ear, mm, fields, reason):
    heard = ear(BEACON)
    assert heard.beacon(mm, **fields) is None
    assert heard.rejected == {reason: 1}


def test_other_status_bits_of_a_beacon_are_no_reason(ear):
    assert ear(BEACON).beacon(status=0xFE) is not None


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (math.nan, "not_finite"),
        (math.inf, "not_finite"),
        (-math.inf, "not_finite"),
        (0.0, "no_range"),
        (-1, "no_range"),
    ],
)
def test_a_named_value_that_is_no_range_is_refused_by_its_reason(ear, value, reason):
    heard = ear(NAMED)
    assert heard.named(value) is None
    assert heard.rejected == {reason: 1}


@pytest.mark.parametrize(("metres", "reason"), [(4.99, "below_min"), (5.0, None), (400.0, None), (400.1, "above_max")])
def test_the_missions_own_limits_hold_for_every_message(ear, metres, reason):
    heard = ear(RangingSettings(message="named_value_float", name="RADIO", min_range=5.0, max_range=400.0))
    assert (heard.named(metres) is None) == (reason is not None)
    assert heard.rejected == ({reason: 1} if reason else {})


# --- whose ranges ---


@pytest.mark.parametrize("wanted", [None, 25])
def test_a_downward_sensor_measures_height_and_is_never_believed(ear, wanted):
    heard = ear(RangingSettings(message="distance_sensor", orientation=wanted))
    assert heard.distance(orientation=25) is None


@pytest.mark.parametrize(
    ("fields", "taken"), [({"id": 2}, True), ({"id": 3}, False), ({"id": 2, "orientation": 0}, False)]
)
def test_a_distance_sensor_is_chosen_by_id_and_orientation(ear, fields, taken):
    heard = ear(RangingSettings(message="distance_sensor", sensor_id=2, orientation=24))
    assert (heard.distance(**fields) is not None) == taken
    assert heard.rejected == ({} if taken else {"other_sensor": 1})
    assert heard.reader.refused == 0, "another sensor is nobody's error"


def test_a_distance_sensor_of_id_0_can_be_chosen(ear):
    heard = ear(RangingSettings(message="distance_sensor", sensor_id=0, orientation=0))
    assert heard.distance(id=1, orientation=0) is None
    assert heard.distance(id=0, orientation=24) is None
    assert heard.distance(id=0, orientation=0) is not None


def test_a_beacon_is_chosen_by_its_id(ear):
    heard = ear(BEACON)
    assert heard.beacon(beacon_id=4) is None
    assert heard.rejected == {"other_sensor": 1}
    assert heard.beacon(beacon_id=3) is not None


def test_a_value_is_chosen_by_its_name(ear):
    heard = ear(NAMED)
    assert heard.named(100.0, name="RADIO2") is None
    assert heard.named(100.0, name="RADIO") is not None


def test_a_name_may_fill_its_ten_characters(ear):
    heard = ear(RangingSettings(message="named_value_float", name="RADIORANGE"))
    assert heard.named(100.0, name="RADIORANGE") is not None


def test_messages_of_another_kind_are_not_ranges(ear):
    assert ear(BEACON).distance() is None
    assert ear(NAMED).distance() is None
    assert ear(DISTANCE).named(100.0) is None


def test_the_first_sensor_heard_is_the_only_one_believed(ear, voice):
    heard = ear()
    heard.distance(now=1.0)
    assert heard.distance(now=1.1, speaker=voice(2, 1)) is None
    assert heard.distance(now=1.2, speaker=voice(1, 158)) is None
    assert heard.distance(now=1.3) is not None
    assert heard.rejected == {"wrong_source": 2}


def test_another_sensor_takes_over_once_the_first_has_been_silent_for_five_seconds(ear, voice):
    heard, other = ear(), voice(2, 1)
    heard.distance(now=1.0)
    assert heard.distance(now=5.9, speaker=other) is None
    assert heard.distance(now=6.1, speaker=other) is not None
    assert heard.distance(now=6.2) is None


def test_a_refused_message_of_a_stranger_does_not_make_it_our_sensor(ear, voice):
    heard = ear()
    assert heard.distance(0, now=1.0, speaker=voice(9, 9)) is None
    assert heard.distance(now=1.1) is not None


@pytest.mark.parametrize(
    ("system", "component", "taken"), [(5, None, True), (5, 7, True), (5, 8, False), (6, None, False), (None, 7, True)]
)
def test_the_missions_sender_is_the_only_one_believed(ear, voice, system, component, taken):
    heard = ear(RangingSettings(message="distance_sensor", system=system, component=component))
    assert (heard.distance(speaker=voice(5, 7)) is not None) == taken
    assert heard.rejected == ({} if taken else {"wrong_source": 1})


# --- each measurement once, in the order of the sensor's clock ---


def test_a_repeated_stamp_is_a_repeated_measurement(ear):
    heard = ear()
    assert heard.distance(10000, stamp=700_000, now=1.0) is not None
    assert heard.distance(10000, stamp=700_000, now=1.1) is None
    assert heard.distance(10100, stamp=700_000, now=1.2) is None
    assert heard.rejected == {"repeat": 2}


def test_an_equal_value_with_a_new_stamp_is_a_new_measurement(ear):
    """On a converged circle the range is constant by design."""
    heard = ear()
    assert all(heard.distance(10000, now=1 + 0.1 * i) is not None for i in range(50))


def test_a_repeated_sequence_is_a_repeated_measurement_whatever_its_stamp(ear):
    heard = ear(BEACON)
    assert heard.beacon(now=1.0, sequence=7) is not None
    assert heard.beacon(now=1.1, sequence=7) is None
    assert heard.beacon(now=1.2, sequence=8) is not None
    assert heard.rejected == {"repeat": 1}


def test_the_sequence_of_a_beacon_may_wrap(ear):
    heard = ear(BEACON)
    taken = [heard.beacon(now=1 + 0.1 * i, sequence=(250 + i) % 256) for i in range(12)]
    assert None not in taken


def test_an_older_stamp_is_never_fused(ear):
    heard = ear()
    heard.distance(stamp=700_000, now=1.0)
    heard.distance(stamp=700_200, now=1.2)
    assert heard.distance(stamp=700_100, now=1.25) is None
    assert heard.rejected == {"older": 1}
    assert heard.distance(stamp=700_300, now=1.3) is not None


@given(order=st.permutations(range(12)))
def test_whatever_the_order_of_arrival_stamps_only_rise(order, say, voice):
    heard = Ear(DISTANCE, say, voice)
    now, stamps = 1.0, []
    for i in order:
        now += 0.05
        sample = heard.distance(stamp=700_000 + 50 * i, now=now)
        if sample is not None:
            stamps.append(sample.stamp)
    assert stamps == sorted(set(stamps))
    assert len(stamps) + sum(heard.rejected.values()) == 12


def test_the_wrap_of_the_boot_time_after_49_days_is_no_jump(ear):
    heard, wrap, last = ear(), 2**32, None
    for i in range(-10, 10):
        if i == 0:
            continue  # 0 itself means "no stamp"
        sample = heard.distance(stamp=(wrap + 100 * i) % wrap, now=5 + 0.1 * i)
        assert sample is not None
        assert last is None or sample.stamp - last == pytest.approx(0.1 if i != 1 else 0.2, abs=1e-6)
        last = sample.stamp
    assert heard.rejected == {}
    assert not heard.reader.restarted


@pytest.mark.parametrize("jump_ms", [-600_000, 3_600_000, -1_500])
def test_a_jump_of_the_sensors_clock_is_believed_when_stamps_confirm_it_and_the_old_clock_is_silent(ear, jump_ms):
    """A rebooted sensor: two samples are lost, no more, and the estimator is told."""
    heard = ear()
    for i in range(5):
        heard.distance(stamp=700_000 + 100 * i, now=1 + 0.1 * i)
    assert heard.distance(stamp=700_500 + jump_ms, now=1.5) is None
    assert heard.distance(stamp=700_600 + jump_ms, now=1.6) is None
    assert not heard.reader.restarted
    sample = heard.distance(stamp=700_700 + jump_ms, now=1.7)
    assert sample is not None
    assert heard.reader.restarted
    assert sample.time == pytest.approx(1.7)
    assert heard.distance(stamp=700_800 + jump_ms, now=1.8) is not None
    assert not heard.reader.restarted
    assert heard.rejected == {"stamp_jump": 2}


def test_ranges_that_are_heard_again_are_not_believed_though_two_come_in_a_row(ear):
    """A looped route: the old clock does not fall silent for it."""
    heard = ear()
    for i in range(60):
        now = 10 + 0.1 * i
        for late in (0.05, 0.02) if i % 5 == 1 else ():
            again = 700_000 + round(1000 * (now - 5 - late))
            assert heard.distance(stamp=again, now=now - late) is None
        assert heard.distance(stamp=700_000 + round(1000 * now), now=now) is not None
    assert not heard.reader.restarted


@pytest.mark.parametrize("jump_ms", [-600_000, 3_600_000])
def test_a_single_mad_stamp_resets_nothing(ear, jump_ms):
    heard = ear()
    heard.distance(stamp=700_000, now=1.0)
    assert heard.distance(stamp=700_100 + jump_ms, now=1.1) is None
    assert heard.distance(stamp=700_200, now=1.2) is not None
    assert heard.distance(stamp=700_300 + jump_ms, now=1.3) is None, "not confirmed: there was a good one between"
    assert heard.distance(stamp=700_400, now=1.4) is not None
    assert heard.rejected == {"stamp_jump": 2}
    assert not heard.reader.restarted


def test_stamps_that_jump_about_are_never_believed(ear):
    heard = ear()
    heard.distance(stamp=700_000, now=1.0)
    for i, stamp in enumerate((10_000, 900_000, 30_000, 2_000_000, 50_000)):
        assert heard.distance(stamp=stamp, now=1.1 + 0.1 * i) is None
    assert heard.rejected == {"stamp_jump": 5}


def test_a_slow_radio_whose_clock_jumps_is_believed_again(ear):
    """What confirms a jump is that stamps and arrivals go on alike, be it by seconds."""
    heard = ear(replace(DISTANCE, rate=0.4))
    assert heard.distance(stamp=700_000, now=1.0) is not None
    assert heard.distance(stamp=100_000, now=8.5) is None
    assert heard.distance(stamp=102_500, now=11.0) is not None
    assert heard.reader.restarted


def test_ranges_of_other_senders_are_not_counted_as_refused(ear, voice):
    heard = ear()
    assert heard.distance(now=1.0) is not None
    assert heard.distance(0, now=1.1) is None
    assert heard.distance(now=1.2, speaker=voice(1, 77)) is None
    assert (heard.reader.refused, heard.reader.rejected["wrong_source"]) == (1, 1)


def test_a_jump_confirmed_by_a_repeat_is_not_confirmed(ear):
    heard = ear()
    heard.distance(stamp=700_000, now=1.0)
    assert heard.distance(stamp=100_000, now=1.1) is None
    assert heard.distance(stamp=100_000, now=1.2) is None
    assert heard.distance(stamp=100_200, now=1.3) is not None


def test_a_frozen_stamp_stays_a_repeat_for_ever(ear):
    heard = ear()
    heard.distance(stamp=700_000, now=1.0)
    assert all(heard.distance(stamp=700_000, now=1.0 + i) is None for i in range(1, 60))
    assert heard.rejected == {"repeat": 59}


def test_a_pause_of_the_sensor_is_no_jump(ear):
    heard = ear()
    heard.distance(stamp=700_000, now=1.0)
    assert heard.distance(stamp=730_000, now=31.0) is not None
    assert not heard.reader.restarted


def test_a_message_without_a_stamp_is_dated_by_its_arrival(ear):
    heard = ear()
    first, second = heard.distance(stamp=0, now=1.0), heard.distance(stamp=0, now=1.1)
    assert (first.time, second.time) == (1.0, 1.1)
    assert second.stamp - first.stamp == pytest.approx(0.1)
    assert heard.distance(stamp=0, now=1.1) is None


def test_stamps_that_the_mission_does_not_trust_are_not_used(ear):
    heard = ear(RangingSettings(message="distance_sensor", sensor_stamps=False))
    samples = [heard.distance(stamp=700_000, now=1 + 0.1 * i) for i in range(3)]
    assert [sample.stamp for sample in samples] == pytest.approx([1.0, 1.1, 1.2])


def test_epoch_stamps_are_as_good_as_boot_stamps(ear):
    heard = ear(BEACON)
    first = heard.beacon(stamp=1_700_000_000_000_000, sequence=1, now=1.0)
    second = heard.beacon(stamp=1_700_000_000_100_000, sequence=2, now=1.1)
    assert second.stamp - first.stamp == pytest.approx(0.1, abs=1e-6)
    assert second.time - first.time == pytest.approx(0.1, abs=1e-6)


def test_values_sent_again_faster_than_the_sensor_measures_count_once(ear):
    """ArduPilot stamps at sending and repeats: a 5 Hz sensor sent at 20 Hz, when the mission says so."""
    heard = ear(RangingSettings(message="distance_sensor", rate=5.0, resent=True))
    taken = [heard.distance(10000 + 300 * (i // 4), now=1 + 0.05 * i) is not None for i in range(40)]
    assert taken == [i % 4 == 0 for i in range(40)]
    assert heard.rejected == {"repeat": 30}


def test_a_constant_range_sent_again_still_counts_at_the_sensors_rate(ear):
    heard = ear(RangingSettings(message="distance_sensor", rate=5.0, resent=True))
    assert sum(heard.distance(10000, now=1 + 0.05 * i) is not None for i in range(40)) == 10


# --- age and slant ---


@pytest.mark.parametrize(("late", "taken"), [(0.49, True), (0.51, False)])
def test_a_sample_that_was_long_on_its_way_is_refused(ear, late, taken):
    """Its age is its delay beyond the least delay seen."""
    heard = ear()
    heard.distance(stamp=700_000, now=1.0)
    sample = heard.distance(stamp=700_100, now=1.1 + late)
    assert (sample is not None) == taken
    assert heard.rejected == ({} if taken else {"too_old": 1})
    if taken:
        assert sample.time == pytest.approx(1.1)


def test_a_slant_range_becomes_horizontal_when_the_height_is_known(ear):
    """3, 4, 5."""
    sample = ear(height=30.0).distance(5000)
    assert sample.r == pytest.approx(40.0)
    assert sample.sigma == pytest.approx(0.5 * 50 / 40)


def test_a_target_overhead_has_no_range(ear):
    heard = ear(height=30.0)
    assert heard.distance(3010) is None
    assert heard.rejected == {"overhead": 1}


def test_at_no_height_the_slant_is_the_range(ear):
    assert ear(height=0.0).distance(3010).r == pytest.approx(30.1)


def test_the_limits_are_those_of_the_slant_range(ear):
    heard = ear(RangingSettings(message="distance_sensor", max_range=50.0), height=30.0)
    assert heard.distance(5000, now=1.0) is not None
    assert heard.distance(5001, now=1.1) is None


# --- nothing whatever breaks it ---


@given(
    cm=st.integers(0, 65535), low=st.integers(0, 65535), high=st.integers(0, 65535), stamp=st.integers(0, UINT32_MAX),
    quality=st.integers(0, 255), covariance=st.integers(0, 255), way=st.integers(0, 255), height=st.floats(0, 700),
)  # fmt: skip
def test_whatever_a_distance_sensor_says_a_sample_is_finite_and_positive(
    cm, low, high, stamp, quality, covariance, way, height, say, voice
):
    heard = Ear(RangingSettings(message="distance_sensor"), say, voice, height)
    fields = {"min_distance": low, "max_distance": high, "signal_quality": quality, "covariance": covariance}
    sample = heard.distance(cm, stamp=stamp, orientation=way, **fields)
    if sample is None:
        assert sum(heard.rejected.values()) == (way != 25)
    else:
        assert 0 < sample.r <= 655.34
        assert 0 < sample.sigma < math.inf


@given(
    readings=st.lists(
        st.tuples(st.integers(0, UINT32_MAX), st.integers(0, 2**64 - 1), st.integers(0, 255)), max_size=20
    )
)
def test_whatever_a_beacon_says_is_taken_or_counted_once(readings, say, voice):
    heard, taken, stamps = Ear(BEACON, say, voice), 0, []
    for i, (mm, stamp, sequence) in enumerate(readings):
        sample = heard.beacon(mm, stamp=stamp, sequence=sequence, now=1 + 0.1 * i)
        if sample is not None:
            taken += 1
            if heard.reader.restarted:
                stamps.clear()
            assert sample.time <= 1 + 0.1 * i
            assert all(sample.stamp > earlier for earlier in stamps[-1:])
            stamps.append(sample.stamp)
    assert taken + sum(heard.rejected.values()) == len(readings)
