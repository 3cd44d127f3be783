"""Round-trip time measured by TIMESYNC: accepted answers, and the times of the requests."""

from itertools import pairwise

import pytest

from circnav_mav.mav.clocks import Timesync


def ask_and_answer(timesync, since, trips):
    """Poll at 20 Hz for 20 s. Each request is answered after the next round-trip time in `trips`
    (s); None: no answer."""
    due = []
    trips = list(trips)
    for i in range(400):
        now = since + i / 20
        for at, stamp in due:
            if abs(at - now) < 0.01:
                timesync.received(stamp, now)
        for question in timesync.poll(now):
            trip = trips.pop(0) if trips else None
            due += [] if trip is None else [(now + trip, question.ts1)]
    return timesync


def asked(timesync, since, until):
    """Return the times (s) of its requests when polled at 20 Hz without answers."""
    return [i / 20 for i in range(round(since * 20), round(until * 20)) if timesync.poll(i / 20)]


@pytest.fixture
def quick():
    """A Timesync with answers within 0.1 s until 25 s."""
    return ask_and_answer(Timesync(), 5.0, [0.1] * 60)


def test_round_trip_time_is_median_of_newest_five():
    timesync = Timesync()
    assert (timesync.typical, timesync.worst, timesync.one_way) == (None, None, 0.0)
    ask_and_answer(timesync, 5.0, [2.0, 2.0, 0.1, 0.2, 0.3, None, 0.25, 0.2])
    assert timesync.typical == pytest.approx(0.3)
    assert timesync.one_way == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("answers", "trips"),
    [
        # answers to another sender's request, to our request, and to our request again
        ([(1, 1.1), (0, 1.3), (0, 3.0)], [0.3]),
        ([(0, 200.0)], []),  # an answer minutes late
    ],
)
def test_timesync_accepts_only_first_answer_to_own_request(answers, trips):
    timesync = Timesync()
    (question,) = timesync.poll(1.0)
    for other, now in answers:
        timesync.received(question.ts1 + other, now)
    assert list(timesync.trips) == pytest.approx(trips)


def test_overdue_timesync_request_is_repeated_at_once(quick):
    (question,) = quick.poll(26.0)
    assert asked(quick, 26.05, 28.0) == pytest.approx([26.25 + i / 4 for i in range(7)])
    quick.received(question.ts1, 28.0)
    assert quick.worst == pytest.approx(2.0)


def test_timesync_requests_silent_vehicle_once_per_second(quick):
    times = asked(quick, 26.0, 60.0)
    assert len([time for time in times if time < 29.0]) > 10
    assert [b - a for a, b in pairwise(time for time in times if time > 30.0)] == pytest.approx(
        [1.0] * 29, abs=0.06
    )


def test_slow_link_gets_no_additional_timesync_requests():
    slow = ask_and_answer(Timesync(), 5.0, [0.8] * 20)
    assert asked(slow, 26.0, 26.8) == [26.0]


def test_timesync_requests_twice_per_second_at_start():
    timesync = Timesync()
    times = []
    for i in range(120):
        for question in timesync.poll(i / 20):
            times.append(i / 20)
            timesync.received(question.ts1, i / 20)
    assert times == pytest.approx([0, 0.5, 1, 1.5, 2, 2.5, 3.5, 4.5, 5.5])


def test_link_slowdown_is_measured_by_quickest_timesync_answer():
    timesync = Timesync()
    assert timesync.slower(5.0, 5.0) == 0.0
    ask_and_answer(timesync, 5.0, [0.2] * 60)
    assert timesync.poll(26.0)
    assert timesync.slower(26.1, 26.6) == float("inf")
    (question,) = timesync.poll(26.6)
    timesync.received(question.ts1, 27.3)
    assert timesync.slower(26.1, 27.3) == pytest.approx(0.5)
    assert timesync.slower(27.4, 37.2) == float("inf")
    assert timesync.slower(27.4, 37.5) == 0.0


def test_measuring_link_slowdown_sends_timesync_request_at_once():
    timesync = Timesync()
    for i in range(120):
        for question in timesync.poll(i / 20):
            timesync.received(question.ts1, i / 20)
    assert timesync.delay_increase(5.9, 5.95) == float("inf") and timesync.poll(5.95) == []
    assert timesync.slower(5.9, 5.95) == float("inf") and timesync.poll(5.95)
