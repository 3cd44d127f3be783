"""RANGING_BEACON: mm, us and a sequence number (mavlink.md 1.1)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from tests.mav.ranging.ear import Ear
from tests.rig import beacon

NONE = 2**32 - 1


class BeaconEar(Ear):
    def __init__(self):
        super().__init__(RangingSettings(message="ranging_beacon", beacon_id=3, sigma=0.5))

    def beacon(self, mm=100_000, stamp=None, sequence=0, now=1.0, **rest):
        stamp = round(now * 1e6) + 500_000_000 if stamp is None else stamp
        return self.hear(beacon(mm, stamp, sequence, **{"beacon_id": 3, **rest}), now)


def test_it_counts_millimetres_and_microseconds_since_1970():
    ear = BeaconEar()
    first = ear.beacon(1_234_567, stamp=1_700_000_000_250_000, sequence=1, range_accuracy=120)
    second = ear.beacon(stamp=1_700_000_000_350_000, sequence=2, now=1.1)
    assert (first.r, first.sigma, first.stamp) == pytest.approx((1234.567, 0.120, 1_700_000_000.25))
    assert first.source == "RANGING_BEACON"
    assert (second.stamp - first.stamp, second.time - first.time) == pytest.approx((0.1, 0.1), abs=1e-6)
    assert RANGING_MESSAGES["ranging_beacon"].farthest == 4_294_967.0  # u32 millimetres of which the last means none


@pytest.mark.parametrize("unknown", [0, NONE])
def test_an_unknown_accuracy_gives_the_missions_noise(unknown):
    assert BeaconEar().beacon(range_accuracy=unknown).sigma == 0.5


@pytest.mark.parametrize(
    ("mm", "fields", "reason"),
    [
        (0, {}, "no_range"),
        (NONE, {}, "no_range"),
        (100_000, {"status": 1}, "poor_quality"),
        (100_000, {"status": 255}, "poor_quality"),
        (100_000, {"status": 0xFE}, None),
        (100_000, {"beacon_id": 4}, "other_sensor"),
    ],
)
def test_a_range_that_is_none_or_anothers_is_rejected_by_its_reason(mm, fields, reason):
    ear = BeaconEar()
    assert (ear.beacon(mm, **fields) is None) == (reason is not None)
    assert ear.rejected == ({reason: 1} if reason else {})


def test_a_repeated_sequence_is_a_repeated_measurement_whatever_its_stamp():
    ear = BeaconEar()
    taken = [ear.beacon(now=1 + 0.1 * i, sequence=sequence) is not None for i, sequence in enumerate((255, 255, 0, 1))]
    assert taken == [True, False, True, True]
    assert ear.rejected == {"repeat": 1}


@given(readings=st.lists(st.tuples(st.integers(0, NONE), st.integers(0, 2**64 - 1), st.integers(0, 255)), max_size=20))
def test_whatever_it_says_is_taken_or_counted_once(readings):
    ear = BeaconEar()
    samples = [ear.beacon(mm, stamp, sequence, 1 + 0.1 * i) for i, (mm, stamp, sequence) in enumerate(readings)]
    assert all(sample is None or sample.time <= 1 + 0.1 * i for i, sample in enumerate(samples))
    assert samples.count(None) == sum(ear.rejected.values())
