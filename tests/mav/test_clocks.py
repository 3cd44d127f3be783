"""A remote clock mapped to the local clock by stamps and arrival times, including clock resets and
the clock's rate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.mav.clocks import BOOT_WRAP, ClockSpeed, Order, StampFilter, UtcClock

WINDOW = 100
"""Length of the window in which the filter takes the smallest delay, in samples: 10 s of a 10 Hz
radio."""


def test_stamp_filter_uses_smallest_delay_as_clock_offset():
    """A constant delay cannot be distinguished from a clock offset."""
    clock = StampFilter(lambda since, now: 0.3)
    assert clock.local(100.0, 10.3) == pytest.approx(10.3)
    # the delay is 0.2 s smaller than for the first sample
    assert clock.local(100.1, 10.2) == pytest.approx(10.2)
    assert clock.local(100.2, 10.5) == pytest.approx(10.3)
    assert clock.local(100.3, 10.4) == pytest.approx(10.4)
    ages = [
        10.8 + i / 10 - clock.local(100.4 + i / 10, 10.8 + i / 10) for i in range(2 * WINDOW + 1)
    ]
    assert (ages[0], ages[-1]) == pytest.approx((0.3, 0.0), abs=1e-9)


def test_stamp_filter_removes_jitter():
    """With delays of 0 to 50 ms, the intervals of the filtered times soon equal those of the stamps
    within 2 ms."""
    rng = np.random.default_rng(1)
    clock = StampFilter()
    stamps = 5000 + 0.1 * np.arange(400)
    arrivals = stamps - 4000 + rng.uniform(0, 0.05, len(stamps))
    local = np.array([clock.local(*pair) for pair in zip(stamps, arrivals, strict=True)])
    assert np.abs(np.diff(local)[WINDOW:] - 0.1).max() < 0.003
    assert (arrivals - local)[WINDOW:].mean() == pytest.approx(0.025, abs=0.004)


@pytest.mark.parametrize("drift", [200e-6, -200e-6])
def test_stamp_filter_follows_clock_drift(drift):
    """A clock drift of 200 ppm is 0.7 s in an hour. The error of the mapping is at most the drift
    in two windows, 4 ms at 10 Hz."""
    clock = StampFilter()
    for i in range(36_000):
        true = 0.1 * i
        local = clock.local(5000 + true * (1 + drift), true)
        assert abs(local - true) < 2 * WINDOW * 0.1 * abs(drift) + 1e-6


@given(pairs=st.lists(st.tuples(st.floats(0, 1e6), st.floats(0, 1e6)), min_size=1, max_size=250))
def test_stamp_filter_dates_no_sample_after_its_arrival(pairs):
    clock = StampFilter()
    assert all(clock.local(stamp, arrival) <= arrival for stamp, arrival in pairs)


# --- stamps in order


def test_stamp_counter_continues_through_32_bit_wrap():
    """10 s of 32-bit millisecond stamps before and after the wrap at 49.7 days. One stamp arrives
    after a later one."""
    clock = StampFilter(wrap=BOOT_WRAP)
    assert abs(BOOT_WRAP - 49.71 * 86400) < 300
    assert clock.unwrapped(5.0) == 5.0
    clock.take(BOOT_WRAP - 10.0, 100.0)
    assert clock.unwrapped(3.0) == pytest.approx(BOOT_WRAP + 3.0)
    assert clock.order(BOOT_WRAP + 3.0, 113.0) is Order.NEWER
    clock.take(BOOT_WRAP + 3.0, 113.0)
    assert clock.unwrapped(BOOT_WRAP - 1.0) == pytest.approx(BOOT_WRAP - 1.0)


@pytest.mark.parametrize(
    ("stamps", "steady", "proven"),
    [
        ([(3.0, 1.0)], 1.0, False),
        ([(3.0, 1.0), (3.1, 1.1)], 1.0, True),
        ([(3.0, 1.0), (3.0, 1.1)], 1.0, False),  # the same frame again
        ([(3.0, 1.0), (9.0, 1.1)], 1.0, False),  # the stamps advance more slowly than the arrivals
        ([(3.0, 1.0), (9.0, 1.1)], np.inf, True),
        ([(3.0, 1.0), None, (3.1, 1.1)], 1.0, False),  # one stamp of the old clock between them
    ],
)
def test_clock_restart_is_confirmed_by_two_consistent_stamps(stamps, steady, proven):
    clock = StampFilter()
    clock.take(700.0, 0.9)
    for stamp in stamps:
        if stamp is None:
            clock.take(700.1, 1.05)
        else:
            order = clock.order(*stamp, steady=steady)
        assert clock.doubted == (stamp is not None and order is Order.JUMPED)
    assert order is (Order.RESTARTED if proven else Order.JUMPED)


def test_stamp_order_depends_on_difference_to_last_stamp():
    clock = StampFilter()
    assert clock.order(50.0, 0.0) is Order.NEWER
    clock.local(50.0, 0.0)
    clock.take(50.0, 0.0)
    orders = {
        stamp: clock.order(stamp, 0.1, most_ahead=2.0)
        for stamp in (50.1, 50.0, 49.5, 52.0, 52.2, 48.9)
    }
    assert orders == {50.1: Order.NEWER, 50.0: Order.REPEATED, 49.5: Order.OLDER, 52.0: Order.NEWER,
                      52.2: Order.JUMPED, 48.9: Order.JUMPED}  # fmt: skip


# --- a remote clock that stops


def ages(lag, *, slower=lambda since, now: 0.0, jitter=0.0, seconds=8.0):
    """Return (arrival time, estimated age) of samples at 10 Hz, s. lag(t): delay of a sample with
    stamp t, from 4 s on, without jitter, s."""
    rng = np.random.default_rng(7)
    clock = StampFilter(slower)
    shown = []
    received = 0.0
    for i in range(round(10 * seconds)):
        stamp = i / 10
        received = max(
            received, stamp + rng.uniform(0.0, jitter) + (lag(stamp) if stamp >= 4.0 else 0.0)
        )
        shown.append((received, received - clock.local(stamp + 900.0, received)))
    return shown


@pytest.mark.parametrize("jitter", [0.0, 0.02])
@pytest.mark.parametrize("pause", [0.2, 0.5, 1.0, 3.0, 60.0])
def test_stamp_filter_follows_clock_pause_within_a_second(pause, jitter):
    shown = ages(lambda stamp: pause, jitter=jitter)
    assert shown[40][1] == pytest.approx(pause, abs=0.03)
    assert max(age for time, age in shown if time >= 4.0 + pause + 0.9) < 0.05


def test_stamp_filter_follows_repeated_clock_pauses():
    shown = ages(lambda stamp: 0.4 * int(stamp - 3.0), seconds=12.0)
    assert max(age for time, age in shown) < 0.45


@pytest.mark.parametrize("jitter", [0.0, 0.02])
@pytest.mark.parametrize("spare", [0.1, 0.5, 3.0])
def test_samples_of_draining_queue_keep_their_true_age(spare, jitter):
    """After an outage of 2 s the link has a queue, which drains slowly for lack of spare capacity.
    The estimated age must not be below the waiting time."""
    wait = lambda stamp: max(2.0 - spare / (1 + spare) * (stamp - 4.0), 0.0)  # noqa: E731
    for (time, age), stamp in zip(
        ages(wait, jitter=jitter, seconds=19.9), np.arange(199) / 10, strict=True
    ):
        assert stamp < 4.0 or age >= wait(stamp) - 0.05, time


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_samples_during_increasing_congestion_keep_their_true_age(jitter):
    shown = ages(lambda stamp: 0.1 * (stamp - 4.0), jitter=jitter, seconds=13.0)
    assert all(age > 0.1 * (time - 4.0) / 1.1 - 0.25 for time, age in shown[40:])


def test_link_delay_step_is_confirmed_by_round_trip():
    asked = []
    slower = lambda since, now: asked.append((since, now)) or 1.0  # noqa: E731
    shown = ages(lambda stamp: 1.0, slower=slower)
    assert {round(age, 6) for time, age in shown if time > 5.0} == {1.0}
    assert all(since >= 5.0 and now - since >= 0.45 for since, now in asked)


def test_lag_not_explained_by_round_trip_is_clock_offset():
    """While Timesync has no answer, for 1 s, the whole lag is assumed to be link delay. Then a
    round trip that is longer by 0.2 s explains only 0.2 s of the lag."""
    slower = lambda since, now: float("inf") if now < 6.0 else 0.2  # noqa: E731
    shown = ages(lambda stamp: 1.0, slower=slower)
    assert [round(age, 6) for time, age in shown if 5.0 < time < 5.95] == [1.0] * 9
    assert {round(age, 6) for time, age in shown if time > 6.05} == {0.2}


COMPUTER_PAUSED = [0.4] * 3 + [0.96, 0.88, 0.96, 1.09, 1.17, 1.26, 1.28, 1.28, 1.09] + [1.01] * 23
"""Lags, s, of a simulator that stopped twice for 0.5 s within 1.3 s and answered slowly meanwhile.
The lag explained by slow answers is assigned to the clock when the answers are quick again."""
COMPUTER_BUSY = [
    0.57, 0.6, 0.66, 0.56, 0.64, 0.67, 0.57, 0.67, 0.69, 0.79, 0.91, 0.96, 1.18, 1.27, 1.17,
    1.18, 1.08, 1.16, 1.06, 0.96, 0.88, 0.78, 0.69, 0.67, 0.68, 0.97, 0.88, 0.81, 0.78, 0.79,
    0.78, 0.78, 0.85, 0.81, 0.79, 0.78, 0.83, 0.86, 1.05, 0.96, 0.87, *[0.83] * 10,
]  # fmt: skip
"""Lags, s, of a simulator that lost 0.83 s in many small stalls while the link stalled too."""


@pytest.mark.parametrize(
    ("lags", "slower"),
    [
        (COMPUTER_PAUSED, lambda since, now: 0.4 if now < 11.5 else 0.02),
        (COMPUTER_BUSY, lambda since, now: 0.29 if since < 14.0 else 0.005),
    ],
    ids=["paused", "busy"],
)
def test_clock_step_during_slow_timesync_answers_is_followed(lags, slower):
    """lags: recorded in flights at intervals of 0.1 s, from 10 s on. The last lag remains."""
    clock = StampFilter(slower)
    shown = []
    for i in range(200):
        lag = 0.0 if i < 100 else lags[min(i - 100, len(lags) - 1)]
        shown.append(0.1 * i - clock.local(5000.0 + 0.1 * i - lag, 0.1 * i))
    assert max(shown[100 + len(lags) :]) < 0.1


def test_clock_step_without_timesync_answer_is_marked_unconfirmed():
    clock = StampFilter(lambda since, now: float("inf"))
    doubts = []
    for i in range(30):
        clock.local(i / 10, i / 10 + (i >= 20))
        doubts.append(clock.doubted)
    assert doubts == [False] * 21 + [True] * 9


# --- rate of the clock


def found(times):
    """Return the clock speed found after each pair (time since boot, local time), s."""
    clock = ClockSpeed()
    return [clock.received(boot, now) or clock.found for boot, now in times]


def test_utc_offset_follows_least_delayed_stamp_and_clock_change():
    clock = UtcClock()
    clock.received(3.0, 1.0)  # no UTC yet
    assert clock.offset is None
    for now, delay in enumerate((0.2, 0.02, 0.3)):
        clock.received(1.8e9 + now, now + delay)
    assert clock.offset == pytest.approx(1.8e9 - 0.02)
    clock.received(1.8e9 - 3600.0, 4.0)
    assert clock.offset == pytest.approx(1.8e9 - 3604.0)


@pytest.mark.parametrize("speed", [0.0, 0.5, 8.0])
def test_clock_speed_needs_three_agreeing_windows(speed):
    seen = found([(100 + speed * 0.1 * n, 0.1 * n) for n in range(120)])
    assert seen[88] is None
    assert seen[91] == pytest.approx(speed, abs=0.01)


@pytest.mark.parametrize(
    "arrival",
    [
        lambda t: max(t, 6.0) if 4.0 < t < 6.0 else t,
        lambda t: t + (1.0 if t > 5.0 else 0.0),
        lambda t: t + min(max(0.15 * (t - 5.0), 0.0), 1.05),
    ],
    ids=[
        "messages of 2 s arrive at once",
        "link delay grows by 1 s",
        "radio buffer fills for 7 s",
    ],
)
def test_message_delays_do_not_change_clock_speed(arrival):
    assert set(found([(0.1 * n, arrival(0.1 * n)) for n in range(200)])) == {None}


def test_clock_speed_measurement_restarts_after_reboot():
    fast = [(8 * 0.1 * n, 0.1 * n) for n in range(100)]
    seen = found([*fast, *((0.1 * n, 10.0 + 0.1 * n) for n in range(100))])
    assert seen[99] == pytest.approx(8.0, rel=0.01)
    assert seen[-1] is None
