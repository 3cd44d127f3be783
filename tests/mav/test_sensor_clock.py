"""A sensor's clock mapped to ours from nothing but stamps and arrivals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.mav.sensor_clock import WINDOW, SensorClock


def test_the_first_sample_is_taken_to_have_come_at_once():
    assert SensorClock().local(5000.0, 12.0) == 12.0


def test_the_least_delay_seen_is_the_offset():
    clock = SensorClock()
    assert clock.local(100.0, 10.3) == pytest.approx(10.3)
    assert clock.local(100.1, 10.2) == pytest.approx(10.2)  # 0.2 s faster on its way than the first
    assert clock.local(100.2, 10.5) == pytest.approx(10.3)
    assert clock.local(100.3, 10.4) == pytest.approx(10.4)


def test_jitter_of_the_way_is_taken_out():
    """Delays of 0 to 50 ms: after some samples the local times are as even as the stamps, within 2 ms."""
    rng, clock = np.random.default_rng(1), SensorClock()
    stamps = 5000 + 0.1 * np.arange(400)
    arrivals = stamps - 4000 + rng.uniform(0, 0.05, len(stamps))
    local = np.array([clock.local(*pair) for pair in zip(stamps, arrivals, strict=True)])
    assert np.abs(np.diff(local)[WINDOW:] - 0.1).max() < 0.003
    assert (arrivals - local)[WINDOW:].mean() == pytest.approx(0.025, abs=0.004)


@pytest.mark.parametrize("drift", [200e-6, -200e-6])
def test_a_drifting_clock_is_followed(drift):
    """200 ppm over an hour are 0.7 s; the mapping never falls behind by more than two windows' worth, 4 ms at 10 Hz."""
    clock = SensorClock()
    for i in range(36_000):
        true = 0.1 * i
        local = clock.local(5000 + true * (1 + drift), true)
        assert abs(local - true) < 2 * WINDOW * 0.1 * abs(drift) + 1e-6


@given(pairs=st.lists(st.tuples(st.floats(0, 1e6), st.floats(0, 1e6)), min_size=1, max_size=250))
def test_no_sample_is_ever_dated_after_its_arrival(pairs):
    clock = SensorClock()
    assert all(clock.local(stamp, arrival) <= arrival for stamp, arrival in pairs)


def test_a_reset_forgets_the_offset():
    clock = SensorClock()
    clock.local(5000.0, 10.0)
    clock.reset()
    assert clock.local(3.0, 11.0) == 11.0


def test_a_delay_that_stays_is_believed_after_two_windows():
    """A constant delay cannot be told from a clock difference."""
    clock = SensorClock()
    clock.local(100.0, 10.0)
    ages = []
    for i in range(1, 2 * WINDOW + 2):
        arrival = 10.3 + 0.1 * i
        ages.append(arrival - clock.local(100 + 0.1 * i, arrival))
    assert ages[0] == pytest.approx(0.3)
    assert ages[-1] == pytest.approx(0.0, abs=1e-9)
