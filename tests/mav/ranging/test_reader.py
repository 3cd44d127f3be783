"""Accepted ranges: only from the right sender, each measurement once, in the order of the sensor's
clock, and recent."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.mav.ranging.receiver import DISTANCE, Receiver
from tests.rig import Voice

# --- senders ---


def test_reader_changes_sensor_after_five_seconds_of_silence():
    receiver = Receiver()
    other = Voice(2, 1)
    assert receiver.distance(0, now=0.9, sender=Voice(9, 9)) is None
    assert receiver.distance(now=6.0) is not None
    receiver.reader.sender_stays = True
    for sender, now in ((other, 6.1), (Voice(1, 158), 6.2), (other, 20.0)):
        assert receiver.distance(now=now, sender=sender) is None
    assert receiver.distance(now=20.1) is not None
    receiver.reader.sender_stays = False
    assert receiver.distance(now=20.2, sender=other) is None
    assert receiver.rejected == {"no_range": 1, "wrong_source": 4}
    assert receiver.reader.refused == 1
    assert receiver.distance(now=26.1, sender=other) is not None


@pytest.mark.parametrize(
    ("system", "component", "accepted"),
    [(5, None, True), (5, 7, True), (5, 8, False), (6, None, False), (None, 7, True)],
)
def test_reader_accepts_only_the_sender_of_the_mission(system, component, accepted):
    receiver = Receiver(replace(DISTANCE, system_id=system, component_id=component))
    assert (receiver.distance(sender=Voice(5, 7)) is not None) == accepted
    assert receiver.rejected == ({} if accepted else {"wrong_source": 1})


# --- each measurement once, in the order of the sensor's clock ---


@given(order=st.permutations([*range(12), 0, 5]))
def test_accepted_stamps_only_rise_in_any_arrival_order(order):
    receiver = Receiver()
    stamps = []
    for at, i in enumerate(order):
        sample = receiver.distance(10000 + at, stamp=700_000 + 50 * i, now=1.0 + 0.05 * at)
        stamps += [] if sample is None else [sample.stamp]
    assert stamps == sorted(set(stamps))
    assert receiver.distance(9000, stamp=round(1000 * stamps[-1]), now=60.0) is None
    assert len(stamps) + sum(receiver.rejected.values()) == 15


def test_boot_time_wrap_is_no_jump():
    receiver = Receiver()
    wrap = 2**32
    last = None
    for i in range(-10, 10):
        if i == 0:
            continue  # 0 means "no stamp"
        sample = receiver.distance(stamp=(wrap + 100 * i) % wrap, now=5 + 0.1 * i)
        assert last is None or sample.stamp - last == pytest.approx(
            0.1 if i != 1 else 0.2, abs=1e-6
        )
        last = sample.stamp
    assert receiver.rejected == {}
    assert not receiver.reader.restarted


@pytest.mark.parametrize("jump_ms", [-600_000, 3_600_000, -1_500])
def test_sensor_clock_jump_costs_two_samples(jump_ms):
    """A rebooted sensor: exactly two samples are lost, and the estimator is restarted."""
    receiver = Receiver()
    seen = []
    for i in range(9):
        sample = receiver.distance(
            stamp=700_000 + 100 * i + (jump_ms if i >= 5 else 0), now=1 + 0.1 * i
        )
        seen.append((sample is not None, receiver.reader.restarted))
        assert sample is None or sample.time == pytest.approx(1 + 0.1 * i)
    assert seen[5:] == [(False, False), (False, False), (True, True), (True, False)]
    assert receiver.rejected == {"stamp_jump": 2}


def test_frames_of_a_looped_route_are_rejected():
    """A looped route repeats frames, while the old clock continues."""
    receiver = Receiver()
    for i in range(60):
        now = 10 + 0.1 * i
        for late in (0.05, 0.02) if i % 5 == 1 else ():
            again = 700_000 + round(1000 * (now - 5 - late))
            assert receiver.distance(stamp=again, now=now - late) is None
        assert receiver.distance(stamp=700_000 + round(1000 * now), now=now) is not None
    assert not receiver.reader.restarted


@pytest.mark.parametrize(
    "stamps",
    [
        (700_000, -100_000, 700_200, -100_300, 700_400),
        (700_000, 4_300_100, 700_200, 4_300_300, 700_400),
        (700_000, 10_000, 900_000, 30_000, 2_000_000, 50_000),
        (700_000, 100_000, 100_000, 100_200),  # a repeat confirms nothing
    ],
)
def test_unconfirmed_stamp_jumps_reset_nothing(stamps):
    receiver = Receiver()
    accepted = [
        receiver.distance(stamp=stamp % 2**32, now=1 + 0.1 * i) is not None
        for i, stamp in enumerate(stamps[:-1])
    ]
    assert accepted == [700_000 <= stamp <= 700_400 for stamp in stamps[:-1]]
    receiver.distance(stamp=stamps[-1], now=1 + 0.1 * len(accepted))
    assert receiver.reader.restarted == (stamps[-1] == 100_200)


def test_slow_radio_recovers_after_clock_jump():
    """Stamps and arrivals that advance alike, even by seconds, confirm the jump."""
    receiver = Receiver(replace(DISTANCE, rate_hz=0.4))
    assert receiver.distance(stamp=700_000, now=1.0) is not None
    assert receiver.distance(stamp=730_000, now=31.0) is not None
    assert not receiver.reader.restarted
    assert receiver.distance(stamp=100_000, now=38.5) is None
    assert receiver.distance(stamp=102_500, now=41.0) is not None
    assert receiver.reader.restarted


@pytest.mark.parametrize(("whose", "stamp"), [("sensor", 0), ("arrival", 700_000)])
def test_range_without_usable_stamp_uses_arrival_time(whose, stamp):
    receiver = Receiver(replace(DISTANCE, stamp=whose))
    samples = [receiver.distance(stamp=stamp, now=1 + 0.1 * i) for i in range(3)]
    assert [(sample.stamp, sample.time) for sample in samples] == [
        (1 + 0.1 * i, 1 + 0.1 * i) for i in range(3)
    ]
    assert receiver.distance(stamp=stamp, now=1.2) is None


@pytest.mark.parametrize("constant", [False, True])
def test_repeated_values_count_once_per_measurement(constant):
    """ArduPilot stamps at sending and repeats: a 5 Hz sensor is sent at 20 Hz."""
    receiver = Receiver(replace(DISTANCE, rate_hz=5.0))
    cm = [10000 if constant else 10000 + 300 * (i // 4) for i in range(40)]
    assert [receiver.distance(cm[i], now=1 + 0.05 * i) is not None for i in range(40)] == [
        i % 4 == 0 for i in range(40)
    ]
    assert receiver.rejected == {"repeat": 30}


# --- age and slant ---


@pytest.mark.parametrize(("delay", "accepted"), [(0.49, True), (0.51, False)])
def test_delayed_sample_is_rejected(delay, accepted):
    """The age of a sample is its delay beyond the smallest delay seen."""
    receiver = Receiver()
    receiver.distance(stamp=700_000, now=1.0)
    sample = receiver.distance(stamp=700_100, now=1.1 + delay)
    assert receiver.rejected == ({} if accepted else {"too_old": 1})
    assert sample.time == pytest.approx(1.1) if accepted else sample is None


def test_slant_range_becomes_horizontal_with_known_height():
    """Sides 3, 4, 5. Directly overhead no range is used."""
    receiver = Receiver(height=30.0)
    sample = receiver.distance(5000)
    assert (sample.r, sample.sigma) == pytest.approx((40.0, 0.5 * 50 / 40))
    assert receiver.distance(3010, now=1.1) is None
    assert receiver.rejected == {"overhead": 1}
    assert Receiver(height=0.0).distance(3010).r == pytest.approx(30.1)
