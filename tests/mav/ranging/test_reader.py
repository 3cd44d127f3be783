"""Accepted ranges: only from the right sender, each measurement once, in the order of the sensor's
clock, and recent."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.mav.ranging.ear import DISTANCE, Ear
from tests.rig import Voice

# --- senders ---


def test_a_sensor_that_steers_is_the_only_one_taken_and_another_one_after_five_seconds_of_its_silence():
    ear = Ear()
    other = Voice(2, 1)
    assert ear.distance(0, now=0.9, speaker=Voice(9, 9)) is None, (
        "a rejected message makes nobody our sensor"
    )
    assert ear.distance(now=6.0) is not None
    ear.reader.sender_stays = True
    for speaker, now in ((other, 6.1), (Voice(1, 158), 6.2), (other, 20.0)):
        assert ear.distance(now=now, speaker=speaker) is None
    assert ear.distance(now=20.1) is not None
    ear.reader.sender_stays = False
    assert ear.distance(now=20.2, speaker=other) is None
    assert ear.rejected == {"no_range": 1, "wrong_source": 4}
    assert ear.reader.refused == 1, "ranges of other senders do no harm"
    assert ear.distance(now=26.1, speaker=other) is not None


@pytest.mark.parametrize(
    ("system", "component", "taken"),
    [(5, None, True), (5, 7, True), (5, 8, False), (6, None, False), (None, 7, True)],
)
def test_the_missions_sender_is_the_only_one_taken(system, component, taken):
    ear = Ear(replace(DISTANCE, system_id=system, component_id=component))
    assert (ear.distance(speaker=Voice(5, 7)) is not None) == taken
    assert ear.rejected == ({} if taken else {"wrong_source": 1})


# --- each measurement once, in the order of the sensor's clock ---


@given(order=st.permutations([*range(12), 0, 5]))
def test_whatever_the_order_of_arrival_stamps_only_rise_and_a_repeated_one_never_counts_again(
    order,
):
    ear = Ear()
    stamps = []
    for at, i in enumerate(order):
        sample = ear.distance(10000 + at, stamp=700_000 + 50 * i, now=1.0 + 0.05 * at)
        stamps += [] if sample is None else [sample.stamp]
    assert stamps == sorted(set(stamps))
    assert ear.distance(9000, stamp=round(1000 * stamps[-1]), now=60.0) is None
    assert len(stamps) + sum(ear.rejected.values()) == 15


def test_the_wrap_of_the_boot_time_after_49_days_is_no_jump():
    ear = Ear()
    wrap = 2**32
    last = None
    for i in range(-10, 10):
        if i == 0:
            continue  # 0 means "no stamp"
        sample = ear.distance(stamp=(wrap + 100 * i) % wrap, now=5 + 0.1 * i)
        assert last is None or sample.stamp - last == pytest.approx(
            0.1 if i != 1 else 0.2, abs=1e-6
        )
        last = sample.stamp
    assert ear.rejected == {}
    assert not ear.reader.restarted


@pytest.mark.parametrize("jump_ms", [-600_000, 3_600_000, -1_500])
def test_a_jump_of_the_sensors_clock_counts_when_stamps_confirm_it_and_the_old_clock_is_silent(
    jump_ms,
):
    """A rebooted sensor: exactly two samples are lost, and the estimator is restarted."""
    ear = Ear()
    seen = []
    for i in range(9):
        sample = ear.distance(stamp=700_000 + 100 * i + (jump_ms if i >= 5 else 0), now=1 + 0.1 * i)
        seen.append((sample is not None, ear.reader.restarted))
        assert sample is None or sample.time == pytest.approx(1 + 0.1 * i)
    assert seen[5:] == [(False, False), (False, False), (True, True), (True, False)]
    assert ear.rejected == {"stamp_jump": 2}


def test_ranges_that_are_heard_again_are_rejected_though_two_come_in_a_row():
    """A looped route repeats frames, while the old clock continues."""
    ear = Ear()
    for i in range(60):
        now = 10 + 0.1 * i
        for late in (0.05, 0.02) if i % 5 == 1 else ():
            again = 700_000 + round(1000 * (now - 5 - late))
            assert ear.distance(stamp=again, now=now - late) is None
        assert ear.distance(stamp=700_000 + round(1000 * now), now=now) is not None
    assert not ear.reader.restarted


@pytest.mark.parametrize(
    "stamps",
    [
        (700_000, -100_000, 700_200, -100_300, 700_400),
        (700_000, 4_300_100, 700_200, 4_300_300, 700_400),
        (700_000, 10_000, 900_000, 30_000, 2_000_000, 50_000),
        (700_000, 100_000, 100_000, 100_200),  # a repeat confirms nothing
    ],
)
def test_stamps_that_jump_about_or_once_only_reset_nothing(stamps):
    ear = Ear()
    taken = [
        ear.distance(stamp=stamp % 2**32, now=1 + 0.1 * i) is not None
        for i, stamp in enumerate(stamps[:-1])
    ]
    assert taken == [700_000 <= stamp <= 700_400 for stamp in stamps[:-1]]
    ear.distance(stamp=stamps[-1], now=1 + 0.1 * len(taken))
    assert ear.reader.restarted == (stamps[-1] == 100_200)


def test_a_slow_radio_whose_clock_jumps_is_taken_again_and_a_pause_is_no_jump():
    """Stamps and arrivals that advance alike, even by seconds, confirm the jump."""
    ear = Ear(replace(DISTANCE, rate_hz=0.4))
    assert ear.distance(stamp=700_000, now=1.0) is not None
    assert ear.distance(stamp=730_000, now=31.0) is not None
    assert not ear.reader.restarted
    assert ear.distance(stamp=100_000, now=38.5) is None
    assert ear.distance(stamp=102_500, now=41.0) is not None
    assert ear.reader.restarted


@pytest.mark.parametrize(("whose", "stamp"), [("sensor", 0), ("arrival", 700_000)])
def test_a_message_without_a_stamp_to_use_is_dated_by_its_arrival(whose, stamp):
    ear = Ear(replace(DISTANCE, stamp=whose))
    samples = [ear.distance(stamp=stamp, now=1 + 0.1 * i) for i in range(3)]
    assert [(sample.stamp, sample.time) for sample in samples] == [
        (1 + 0.1 * i, 1 + 0.1 * i) for i in range(3)
    ]
    assert ear.distance(stamp=stamp, now=1.2) is None


@pytest.mark.parametrize("constant", [False, True])
def test_values_sent_again_faster_than_the_sensor_measures_count_once(constant):
    """ArduPilot stamps at sending and repeats: a 5 Hz sensor is sent at 20 Hz."""
    ear = Ear(replace(DISTANCE, rate_hz=5.0))
    cm = [10000 if constant else 10000 + 300 * (i // 4) for i in range(40)]
    assert [ear.distance(cm[i], now=1 + 0.05 * i) is not None for i in range(40)] == [
        i % 4 == 0 for i in range(40)
    ]
    assert ear.rejected == {"repeat": 30}


# --- age and slant ---


@pytest.mark.parametrize(("late", "taken"), [(0.49, True), (0.51, False)])
def test_a_sample_that_was_long_on_its_way_is_rejected(late, taken):
    """The age of a sample is its delay beyond the smallest delay seen."""
    ear = Ear()
    ear.distance(stamp=700_000, now=1.0)
    sample = ear.distance(stamp=700_100, now=1.1 + late)
    assert ear.rejected == ({} if taken else {"too_old": 1})
    assert sample.time == pytest.approx(1.1) if taken else sample is None


def test_a_slant_range_becomes_horizontal_when_the_height_is_known():
    """Sides 3, 4, 5. Directly overhead no range is used."""
    ear = Ear(height=30.0)
    sample = ear.distance(5000)
    assert (sample.r, sample.sigma) == pytest.approx((40.0, 0.5 * 50 / 40))
    assert ear.distance(3010, now=1.1) is None
    assert ear.rejected == {"overhead": 1}
    assert Ear(height=0.0).distance(3010).r == pytest.approx(30.1)
