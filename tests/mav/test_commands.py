"""COMMAND_LONG: retries, acknowledgements, bounded time (MAVSDK: 0.5 s, three retries, 3 s in progress)."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.commands import Command, CommandSender

US, TARGET = (1, 191), (1, 1)
SET_MODE = Command(176, (1.0, 4.0))
ACCEPTED, IN_PROGRESS = 0, 5


def ack(number=176, result=ACCEPTED, target=(0, 0)):
    return mavlink.MAVLink_command_ack_message(number, result, 0, 0, *target)


def poll_until(sender, end, start=0.0, step=0.05):
    """(time, message) of everything that is sent."""
    sent = []
    for i in range(round((end - start) / step) + 1):
        now = round(start + i * step, 6)
        sent += [(now, message) for message in sender.poll(TARGET, now)]
    return sent


@pytest.fixture
def sender():
    return CommandSender()


@pytest.fixture
def asked(sender):
    """SET_MODE went out at 0 s."""
    sender.send(SET_MODE)
    return sender.poll(TARGET, 0.0)


def test_a_command_goes_out_with_its_parameters_and_zeros(asked):
    (message,) = asked
    assert (message.target_system, message.target_component, message.command) == (1, 1, 176)
    assert [getattr(message, f"param{i}") for i in range(1, 8)] == [1, 4, 0, 0, 0, 0, 0]
    assert message.confirmation == 0


def test_an_unanswered_command_is_repeated_three_times_counting_and_then_given_up(sender):
    sender.send(SET_MODE)
    sent = poll_until(sender, 1.95)
    assert sender.take_results() == []
    sent += poll_until(sender, 5.0, start=2.0)
    assert [(now, message.confirmation) for now, message in sent] == [(0.0, 0), (0.5, 1), (1.0, 2), (1.5, 3)]
    (result,) = sender.take_results()
    assert (result.command, result.result, result.accepted, result.said) == (SET_MODE, None, False, "no answer")
    assert sender.take_results() == []


@pytest.mark.parametrize(
    ("result", "said"),
    [(0, "accepted"), (1, "temporarily rejected"), (2, "denied"), (3, "unsupported"), (4, "failed"), (99, "result 99")],
)
def test_an_answer_ends_the_repeats_and_is_told_in_words(sender, asked, result, said):
    sender.acknowledge(ack(result=result), US, 0.1)
    assert poll_until(sender, 3.0, start=0.25) == []
    (ended,) = sender.take_results()
    assert (ended.accepted, ended.said) == (result == ACCEPTED, said)


@pytest.mark.parametrize(
    ("answer", "ours"),
    [(ack(target=target), True) for target in ((0, 0), (1, 191), (1, 0), (0, 191))]
    + [(ack(target=target), False) for target in ((255, 190), (1, 190), (2, 191), (255, 0))]
    + [(ack(number), False) for number in (400, 511)],
)
def test_only_an_answer_to_our_command_and_to_us_or_nobody_in_particular_counts(sender, asked, answer, ours):
    sender.acknowledge(answer, US, 0.1)
    assert (poll_until(sender, 0.6) == [], len(sender.take_results())) == (ours, ours)


def test_in_progress_stops_the_repeats_for_three_seconds_and_three_times_at_most(sender, asked):
    sender.acknowledge(ack(result=IN_PROGRESS), US, 0.2)
    assert poll_until(sender, 3.15, start=0.25) == sender.take_results() == []
    for now in (3.18, 6.1, 9.0):
        sender.acknowledge(ack(result=IN_PROGRESS), US, now)
    assert poll_until(sender, 9.05, start=3.2) == sender.take_results() == []
    assert poll_until(sender, 9.15, start=9.1) == []
    assert sender.take_results()[0].said == "no answer"


def test_one_command_of_a_number_is_under_way_at_a_time_and_those_of_others_do_not_wait(sender):
    first, second = Command(511, (30, 100_000)), Command(511, (74, 100_000))
    for command in (first, second, SET_MODE):
        sender.send(command)
    assert [message.param1 for message in sender.poll(TARGET, 0.0)] == [30, 1]
    sender.acknowledge(ack(511), US, 0.1)
    assert [message.param1 for message in sender.poll(TARGET, 0.1)] == [74]
    sender.acknowledge(ack(511), US, 0.2)
    assert [result.command for result in sender.take_results()] == [first, second]


def test_the_same_command_is_not_queued_twice(sender):
    for _ in range(3):
        sender.send(SET_MODE)
    sender.poll(TARGET, 0.0)
    sender.send(SET_MODE)
    sender.acknowledge(ack(), US, 0.1)
    assert poll_until(sender, 3.0, start=0.1) == []


def test_clearing_drops_what_waits_and_what_is_under_way(sender, asked):
    sender.send(Command(176, (1.0, 5.0)))
    sender.clear()
    assert poll_until(sender, 3.0) == []
