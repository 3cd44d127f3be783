"""COMMAND_LONG: retries, acknowledgements and time limits, as in MAVSDK (0.5 s, three retries, 3 s
after IN_PROGRESS). Telemetry rates: requested, measured, requested again."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.commands import Command, CommandResult, CommandSender, StreamRequests
from tests.rig import Voice

US = (1, 191)
TARGET = (1, 1)
SET_MODE = 176
SET_INTERVAL = 511
GUIDED = Command(SET_MODE, (1.0, 4.0))
ACCEPTED = 0
DENIED = 2
IN_PROGRESS = 5


VEHICLE = Voice()


def ack(number=SET_MODE, result=ACCEPTED, target=(0, 0)):
    return VEHICLE.message(mavlink.MAVLink_command_ack_message(number, result, 0, 0, *target))


def poll_until(sender, end, start=0.0, step=0.05):
    """Return (time, message) of every message sent until a time, s."""
    times = [round(start + i * step, 6) for i in range(round((end - start) / step) + 1)]
    return [(now, message) for now in times for message in sender.poll(TARGET, now)]


@pytest.fixture
def sender():
    """A sender with a request for GUIDED in its queue."""
    sender = CommandSender()
    sender.send(GUIDED)
    return sender


def test_unanswered_command_is_repeated_three_times(sender):
    sent = poll_until(sender, 1.95)
    assert sender.take_results() == []
    sent += poll_until(sender, 5.0, start=2.0)
    assert [(now, message.confirmation) for now, message in sent] == [
        (0.0, 0),
        (0.5, 1),
        (1.0, 2),
        (1.5, 3),
    ]
    for _, message in sent:
        assert (message.target_system, message.target_component, message.command) == (
            1,
            1,
            SET_MODE,
        )
        assert [getattr(message, f"param{i}") for i in range(1, 8)] == [1, 4, 0, 0, 0, 0, 0]
    (result,) = sender.take_results()
    assert (result.command, result.result, result.accepted, result.answer) == (
        GUIDED,
        None,
        False,
        "no answer",
    )
    assert not result.refused
    assert sender.take_results() == []


@pytest.mark.parametrize(
    ("result", "answer"),
    [
        (0, "accepted"),
        (1, "temporarily rejected"),
        (2, "denied"),
        (3, "unsupported"),
        (4, "failed"),
        (99, "result 99"),
    ],
)
def test_answer_ends_repeated_command(sender, result, answer):
    sender.poll(TARGET, 0.0)
    sender.acknowledge(ack(result=result), US, 0.1)
    assert poll_until(sender, 3.0, start=0.25) == []
    (ended,) = sender.take_results()
    assert (ended.accepted, ended.refused, ended.answer) == (
        result == ACCEPTED,
        result != ACCEPTED,
        answer,
    )


@pytest.mark.parametrize(
    ("answer", "ours"),
    [(ack(target=target), True) for target in ((0, 0), (1, 191), (1, 0), (0, 191))]
    + [(ack(target=target), False) for target in ((255, 190), (1, 190), (2, 191), (255, 0))]
    + [(ack(number), False) for number in (400, 511)],
)
def test_answer_is_matched_by_command_and_target(sender, answer, ours):
    sender.poll(TARGET, 0.0)
    sender.acknowledge(answer, US, 0.1)
    assert (poll_until(sender, 0.6) == [], len(sender.take_results())) == (ours, ours)


def test_in_progress_answer_extends_waiting_up_to_three_times(sender):
    sender.poll(TARGET, 0.0)
    sender.acknowledge(ack(result=IN_PROGRESS), US, 0.2)
    assert poll_until(sender, 3.15, start=0.25) == sender.take_results() == []
    for now in (3.18, 6.1, 9.0):
        sender.acknowledge(ack(result=IN_PROGRESS), US, now)
    assert poll_until(sender, 9.05, start=3.2) == sender.take_results() == []
    assert poll_until(sender, 9.15, start=9.1) == []
    assert sender.take_results()[0].answer == "no answer"


def test_commands_with_same_number_are_sent_one_by_one():
    sender = CommandSender()
    first = Command(SET_INTERVAL, (30, 1e5))
    second = Command(SET_INTERVAL, (74, 1e5))
    for command in (first, second, GUIDED):
        sender.send(command)
    assert [message.param1 for message in sender.poll(TARGET, 0.0)] == [30, 1]
    sender.acknowledge(ack(SET_INTERVAL), US, 0.1)
    assert [message.param1 for message in sender.poll(TARGET, 0.1)] == [74]
    sender.acknowledge(ack(SET_INTERVAL), US, 0.2)
    assert [result.command for result in sender.take_results()] == [first, second]


@pytest.mark.parametrize(
    ("trip", "doubled"), [(0.55, False), (1.95, False), (0.1, True), (0.95, True)]
)
def test_late_and_doubled_answers_match_their_commands(trip, doubled):
    """Ten streams are requested, and the vehicle denies one. doubled: each answer arrives twice,
    over two routers."""
    sender = CommandSender()
    answers = []
    results = []
    for stream in range(10):
        sender.send(Command(SET_INTERVAL, (stream, 1e5)))
    for now in (round(0.05 * tick, 6) for tick in range(1200)):
        for answer in [answer for at, answer in answers if at == now]:
            sender.acknowledge(answer, US, now)
        for message in sender.poll(TARGET, now):
            answer = ack(SET_INTERVAL, 2 if message.param1 == 3 else ACCEPTED)
            answers += [
                (round(now + trip + later, 6), answer)
                for later in ((0.0, 0.05) if doubled else (0.0,))
            ]
        results += sender.take_results()
    assert [(one.command.params[0], one.refused) for one in results] == [
        (stream, stream == 3) for stream in range(10)
    ]


def test_identical_command_is_queued_only_once(sender):
    sender.send(GUIDED)
    sender.poll(TARGET, 0.0)
    sender.send(GUIDED)
    sender.acknowledge(ack(), US, 0.1)
    assert poll_until(sender, 3.0, start=0.1) == []


def test_dropped_command_is_removed_while_queued_or_pending(sender):
    stream = Command(SET_INTERVAL, (30, 1e5))
    for _ in range(2):
        sender.send(stream)
        sender.send(Command(SET_MODE, (1.0, 5.0)))
        assert sender.drop(SET_MODE)
        assert not sender.drop(SET_MODE)
        assert [message.command for message in sender.poll(TARGET, 0.0)] in ([SET_INTERVAL], [])
        sender.send(GUIDED)
        sender.poll(TARGET, 0.0)
    sender.clear()
    assert poll_until(sender, 3.0) == []


# --- streams

ATTITUDE = 30
TIME = 2


@pytest.fixture
def streams():
    return StreamRequests({ATTITUDE: 10.0, TIME: 1.0})


def receive_messages(streams, seconds, attitude=10.0):
    for message_id, rate in ((ATTITUDE, attitude), (TIME, 1.0), (1000, 5.0)):
        for _ in range(round(seconds * rate)):
            streams.received(message_id)


def requested(commands):
    assert all(command.number == SET_INTERVAL for command in commands)
    return [command.params for command in commands]


@pytest.mark.parametrize(("rate", "again"), [(4.9, True), (5.1, False), (0.0, True)])
def test_stream_below_half_its_rate_is_requested_again(streams, rate, again):
    """Another client may lower the rate of a stream: gh:ArduPilot/ardupilot#19761."""
    assert requested(streams.poll(0.0)) == [(ATTITUDE, 100_000)]
    assert requested(streams.poll(0.6)) == [(TIME, 1_000_000)]
    receive_messages(streams, 3.0)
    assert streams.poll(3.5) == streams.poll(3.6) == []
    receive_messages(streams, 100, attitude=rate)
    assert requested(streams.poll(103.6)) == ([(ATTITUDE, 100_000)] if again else [])
    assert requested(streams.give_back()) == [(ATTITUDE, 0), (TIME, 0)]


def test_stream_kept_fast_by_ground_station_is_not_requested(streams):
    """MAVProxy sets all streams to 4 Hz every 15 s, and prints each acknowledgment of another
    request."""
    assert requested(streams.poll(0.0)) == [(ATTITUDE, 100_000)]
    streams.received(TIME)
    assert streams.poll(0.6) == []
    receive_messages(streams, 3.0)
    assert streams.poll(3.6) == []
    assert requested(streams.give_back()) == [(ATTITUDE, 0)]


def test_denied_stream_is_requested_again_after_restart(streams):
    streams.denied(CommandResult(streams.poll(0.0)[0], DENIED))
    assert streams.refused == ["ATTITUDE"]
    for check in range(1, 5):
        assert requested(streams.poll(3.0 * check)) == [(TIME, 1_000_000)]
    receive_messages(streams, 100.0)
    streams.restart()
    assert len(streams.poll(13.0)) == 1
    assert [len(streams.poll(now)) for now in (13.7, 16.8)] == [1, 2]


def test_optional_stream_is_requested_again_only_after_first_message():
    streams = StreamRequests({ATTITUDE: 10.0, TIME: 1.0}, maybe={TIME})
    asked = [[one.params[0] for one in streams.poll(now)] for now in (0.0, 10.0, 20.0)]
    assert asked == [[ATTITUDE], [TIME], [ATTITUDE]]
    streams.received(TIME)
    assert [[one.params[0] for one in streams.poll(now)] for now in (30.0, 40.0)] == 2 * [
        [ATTITUDE, TIME]
    ]
