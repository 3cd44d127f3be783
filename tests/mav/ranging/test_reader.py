"""The range reader accepts ranges only of the mission's sender, each measurement once, in the order
of the sensor's clock, and not too old."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.mav.ranging.receiver import DISTANCE, Receiver
from tests.rig import Voice

# --- senders


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


HOST = "10.0.0.7"


def test_radio_with_new_port_for_each_datagram_is_accepted():
    """An ESP8266 opens a new socket for each datagram, each with two ranges. Its clock is read as
    that of one radio."""
    receiver = Receiver()
    receiver.reader.sender_stays = True
    for i in range(60):
        for part in range(2):
            stamp = 700_000 + 100 * i + 50 * part
            sample = receiver.distance(
                10000 + 20 * i + 10 * part, stamp, now=1 + 0.1 * i, source=(HOST, 4000 + i)
            )
            assert sample is not None and not receiver.restarted
    assert receiver.identity.second_senders.recent(6.9) == []


def test_second_program_on_host_of_radio_is_second_sender():
    receiver = Receiver()
    for i in range(40):
        receiver.distance(10000 + 7 * i, now=1 + 0.1 * i, source=(HOST, 4000 + i % 2))
    assert receiver.rejected["wrong_source"] >= 19
    assert "the ranging radio" in receiver.identity.second_senders.recent(4.9)[0]


@pytest.mark.parametrize("boot", [0, -600_000])
def test_restarted_radio_is_accepted_from_new_port(boot):
    """After 3 s of silence the radio sends from a new port, with a new time since boot."""
    receiver = Receiver(reach=lambda seconds: 30.0 * seconds)
    receiver.reader.sender_stays = True

    def send(first, last, port, cm=10000, shift=0, host=HOST):
        """Return the number of accepted ranges in a time at 10 Hz."""
        times = [0.1 * n for n in range(round(10 * first), round(10 * last))]
        samples = [
            receiver.distance(
                cm + n, round(1000 * now) + 700_000 + shift, now=now, source=(host, port)
            )
            for n, now in enumerate(times)
        ]
        return sum(sample is not None for sample in samples)

    assert send(1, 5, 4000) == 40
    assert send(5, 6, 4001, shift=boot) == 0  # no silence yet
    assert send(8, 9, 4001, shift=boot, host="10.0.0.8") == 0
    assert send(9, 10, 4002, shift=boot, cm=40000) == 0  # farther than the vehicle has flown
    assert receiver.rejected == {"wrong_source": 30}
    assert send(10, 12, 4002, shift=boot) >= 19
    assert send(12, 13, 4000) == 0


# --- each measurement once, in the order of the sensor's clock


@given(order=st.permutations([*range(12), 0, 5]))
def test_reader_accepts_only_rising_stamps_in_any_arrival_order(order):
    receiver = Receiver()
    stamps = []
    for at, i in enumerate(order):
        sample = receiver.distance(10000 + at, stamp=700_000 + 50 * i, now=1.0 + 0.05 * at)
        stamps += [] if sample is None else [sample.stamp]
    assert stamps == sorted(set(stamps))
    assert receiver.distance(9000, stamp=round(1000 * stamps[-1]), now=60.0) is None
    assert len(stamps) + sum(receiver.rejected.values()) == 15


def test_reader_accepts_wrap_of_sensor_time_since_boot():
    receiver = Receiver()
    wrap = 2**32
    last = None
    for i in range(-10, 10):
        if i == 0:
            continue  # a stamp of 0 means "no stamp"
        sample = receiver.distance(stamp=(wrap + 100 * i) % wrap, now=5 + 0.1 * i)
        assert last is None or sample.stamp - last == pytest.approx(
            0.1 if i != 1 else 0.2, abs=1e-6
        )
        last = sample.stamp
    assert receiver.rejected == {}
    assert not receiver.restarted


@pytest.mark.parametrize("jump_ms", [-600_000, 3_600_000, -1_500])
def test_sensor_clock_jump_restarts_estimator_after_two_samples(jump_ms):
    """The sensor reboots. The reader rejects two samples until the new clock is confirmed, then
    restarts the estimator."""
    receiver = Receiver()
    seen = []
    for i in range(9):
        sample = receiver.distance(
            stamp=700_000 + 100 * i + (jump_ms if i >= 5 else 0), now=1 + 0.1 * i
        )
        seen.append((sample is not None, receiver.restarted))
        assert sample is None or sample.time == pytest.approx(1 + 0.1 * i)
    assert seen[5:] == [(False, False), (False, False), (True, True), (True, False)]
    assert receiver.rejected == {"stamp_jump": 2}


def test_reader_rejects_frames_repeated_by_routing_loop():
    """A routing loop repeats earlier frames, while the sensor's clock continues without a jump."""
    receiver = Receiver()
    for i in range(60):
        now = 10 + 0.1 * i
        for late in (0.05, 0.02) if i % 5 == 1 else ():
            again = 700_000 + round(1000 * (now - 5 - late))
            assert receiver.distance(stamp=again, now=now - late) is None
        assert receiver.distance(stamp=700_000 + round(1000 * now), now=now) is not None
    assert not receiver.restarted


@pytest.mark.parametrize(
    "stamps",
    [
        (700_000, -100_000, 700_200, -100_300, 700_400),
        (700_000, 4_300_100, 700_200, 4_300_300, 700_400),
        (700_000, 10_000, 900_000, 30_000, 2_000_000, 50_000),
        (700_000, 100_000, 100_000, 100_200),  # a repeated stamp does not confirm the jump
    ],
)
def test_unconfirmed_stamp_jump_does_not_restart_estimator(stamps):
    receiver = Receiver()
    accepted = [
        receiver.distance(stamp=stamp % 2**32, now=1 + 0.1 * i) is not None
        for i, stamp in enumerate(stamps[:-1])
    ]
    assert accepted == [700_000 <= stamp <= 700_400 for stamp in stamps[:-1]]
    receiver.distance(stamp=stamps[-1], now=1 + 0.1 * len(accepted))
    assert receiver.restarted == (stamps[-1] == 100_200)


def test_slow_radio_recovers_after_clock_jump():
    """The jump is confirmed by two samples whose stamps and arrivals differ by the same time, even
    if it is seconds."""
    receiver = Receiver(replace(DISTANCE, rate_hz=0.4))
    assert receiver.distance(stamp=700_000, now=1.0) is not None
    assert receiver.distance(stamp=730_000, now=31.0) is not None
    assert not receiver.restarted
    assert receiver.distance(stamp=100_000, now=38.5) is None
    assert receiver.distance(stamp=102_500, now=41.0) is not None
    assert receiver.restarted


@pytest.mark.parametrize(("whose", "stamp"), [("sensor", 0), ("arrival", 700_000)])
def test_range_without_usable_stamp_uses_arrival_time(whose, stamp):
    receiver = Receiver(replace(DISTANCE, stamp=whose))
    samples = [receiver.distance(stamp=stamp, now=1 + 0.1 * i) for i in range(3)]
    assert [(sample.stamp, sample.time) for sample in samples] == [
        (1 + 0.1 * i, 1 + 0.1 * i) for i in range(3)
    ]
    assert receiver.distance(stamp=stamp, now=1.2) is None


@pytest.mark.parametrize("component", [1, 192])
@pytest.mark.parametrize("constant", [False, True])
def test_repeated_range_is_accepted_once_per_measurement_period(constant, component):
    """ArduPilot sends the last range of a 5 Hz sensor at 20 Hz, each time with a new stamp. A radio
    prints each line four times."""
    receiver = Receiver(replace(DISTANCE, rate_hz=5.0))
    receiver.sender = Voice(1, component)
    cm = [10000 if constant else 10000 + 300 * (i // 4) for i in range(40)]
    assert [receiver.distance(cm[i], now=1 + 0.05 * i) is not None for i in range(40)] == [
        i % 4 == 0 for i in range(40)
    ]
    assert receiver.rejected == {"repeat": 30}


# --- age and slant


@pytest.mark.parametrize(("delay", "accepted"), [(0.49, True), (0.51, False)])
def test_sample_older_than_half_second_is_rejected(delay, accepted):
    """The age of a sample is its delay minus the smallest delay received so far."""
    receiver = Receiver()
    receiver.distance(stamp=700_000, now=1.0)
    sample = receiver.distance(stamp=700_100, now=1.1 + delay)
    assert receiver.rejected == ({} if accepted else {"too_old": 1})
    assert sample.time == pytest.approx(1.1) if accepted else sample is None


def test_slant_range_is_converted_to_horizontal_range():
    """A slant range of 50 m at a height of 30 m is 40 m horizontal. A slant range of 30.1 m
    (vehicle above the beacon) is rejected."""
    receiver = Receiver(height=30.0)
    sample = receiver.distance(5000)
    assert (sample.r, sample.sigma) == pytest.approx((40.0, 0.5 * 50 / 40))
    assert receiver.distance(3010, now=1.1) is None
    assert receiver.rejected == {"overhead": 1}
    assert Receiver(height=0.0).distance(3010).r == pytest.approx(30.1)
