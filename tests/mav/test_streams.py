"""Telemetry rates: asked for, measured, asked for again."""

import pytest

from circnav_mav.mav.commands import StreamRequests

ATTITUDE, TIME = 30, 2
INTERVAL = 511


@pytest.fixture
def streams():
    return StreamRequests({ATTITUDE: 10.0, TIME: 1.0})


def hear(streams, seconds, *, attitude=10.0, time=1.0):
    for _ in range(round(seconds * attitude)):
        streams.heard(ATTITUDE)
    for _ in range(round(seconds * time)):
        streams.heard(TIME)


def asked(commands):
    assert all(command.number == INTERVAL for command in commands)
    return [command.params for command in commands]


def test_every_stream_is_asked_for_at_once_in_microseconds(streams):
    assert asked(streams.poll(0.0)) == [(ATTITUDE, 100_000), (TIME, 1_000_000)]
    assert streams.rates == {ATTITUDE: None, TIME: None}


@pytest.mark.parametrize(("rate", "again"), [(4.9, True), (5.1, False), (0.0, True)])
def test_streams_are_measured_and_one_that_falls_below_half_its_rate_later_is_asked_for_again(streams, rate, again):
    """Other clients reset rates: gh:ArduPilot/ardupilot#19761."""
    streams.poll(0.0)
    hear(streams, 3.0)
    assert streams.poll(2.9) == streams.poll(3.0) == []
    assert streams.rates == pytest.approx({ATTITUDE: 10.0, TIME: 1.0})
    hear(streams, 100, attitude=rate)
    assert asked(streams.poll(103.0)) == ([(ATTITUDE, 100_000)] if again else [])
    assert streams.rates[ATTITUDE] == pytest.approx(rate)


def test_a_denied_stream_is_not_asked_for_again_before_a_restart(streams):
    streams.denied(streams.poll(0.0)[0])
    for check in range(1, 5):
        assert asked(streams.poll(3.0 * check)) == [(TIME, 1_000_000)]
    streams.restart()
    assert len(streams.poll(13.0)) == 2


def test_messages_heard_before_a_restart_do_not_count_after_it_and_others_never(streams):
    streams.poll(0.0)
    hear(streams, 100.0)
    streams.heard(1000)
    streams.restart()
    streams.poll(1.0)
    assert streams.rates == {ATTITUDE: None, TIME: None}
    assert len(streams.poll(4.0)) == 2


def test_rates_are_given_back_with_an_interval_of_zero(streams):
    assert asked(streams.give_back()) == [(ATTITUDE, 0), (TIME, 0)]
