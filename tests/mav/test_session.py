"""The link to one vehicle: who it is, who it is not, reboots, clocks, our own heartbeat."""

from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import all as mavlink

GCS, COMPANION = 6, 18
INVALID = 8
SET_INTERVAL, REQUEST_MESSAGE = 511, 512


class Line:
    """A session and the voices on its line."""

    def __init__(self, session, voice, say):
        self.session, self.voice, self.say = session, voice, say
        self.vehicle = voice(1, 1)

    def hear(self, message, now=0.0, voice=None, source="vehicle"):
        self.session.receive((voice or self.vehicle).message(message), now, source)

    def beat(self, now=0.0, voice=None, source="vehicle", **fields):
        self.hear(self.say.heartbeat(**fields), now, voice, source)

    def poll(self, now, kind=None):
        return [message for message in self.session.poll(now) if kind in (None, message.get_type())]


@pytest.fixture
def line(make_session, voice, say):
    return lambda **settings: Line(make_session(**settings), voice, say)


# --- whom we fly ---


def test_the_first_vehicle_that_fits_is_pinned_and_answered_where_it_spoke(line):
    here = line()
    here.beat(now=1.0, mode=5, source=("10.0.0.1", 14550))
    session = here.session
    assert session.up
    assert session.peer.ids == (1, 1)
    assert session.reply_to == ("10.0.0.1", 14550)
    assert (session.mode, session.mode_name, session.told.armed) == (5, "LOITER", True)
    assert session.heartbeat_age(2.5) == 1.5


def test_we_take_on_the_system_id_of_the_vehicle(line, voice):
    here = line()
    here.beat(voice=voice(42, 1))
    assert here.session.encoder.system == 42
    assert here.session.vehicle_ids == (42, 1)


def test_a_second_vehicle_is_ignored_and_counted(line, voice):
    here = line()
    here.beat(now=0.0, mode=5)
    other = voice(2, 1)
    for i in range(5):
        here.beat(now=0.1 * i, voice=other, mode=4, source="elsewhere")
    assert here.session.peer.ids == (1, 1)
    assert here.session.mode == 5
    assert here.session.ignored["other_vehicle"] == 5


def test_a_second_vehicle_of_the_same_ids_on_another_address_is_ignored(line):
    here = line()
    here.beat(now=0.0, mode=5)
    here.beat(now=0.1, mode=4, source="elsewhere")
    assert here.session.mode == 5
    assert here.session.ignored["other_vehicle"] == 1


def test_our_vehicle_may_come_back_from_another_address_once_it_was_silent(line):
    here = line()
    here.beat(now=0.0, source="port 1")
    here.beat(now=1.4, source="port 2")
    assert here.session.reply_to == "port 1"
    here.beat(now=1.6, source="port 2", mode=5)
    assert here.session.reply_to == "port 2"
    assert here.session.mode == 5


@pytest.mark.parametrize(
    ("fields", "who"),
    [
        ({"kind": GCS, "autopilot": INVALID}, "a ground station"),
        ({"kind": COMPANION, "autopilot": INVALID}, "a companion"),
    ],
)
def test_heartbeats_that_are_no_vehicles_pin_nothing_and_move_nothing(line, voice, fields, who):
    here = line()
    here.beat(voice=voice(255, 190), **fields)
    assert not here.session.up
    here.beat(now=0.1, mode=4)
    here.beat(now=0.2, voice=voice(1, 100), mode=5, **fields)
    assert here.session.mode == 4, who
    assert here.session.ignored["other_vehicle"] == 0
    assert here.session.misfits == {}


def test_a_ground_station_that_claims_an_autopilot_is_still_none(line, voice):
    here = line()
    here.beat(voice=voice(255, 190), kind=GCS, autopilot=3)
    assert not here.session.up
    assert here.session.misfits == {}


def test_the_wrong_system_id_is_told_and_not_pinned(line, voice):
    here = line(system_id=7)
    here.beat(voice=voice(1, 1))
    assert not here.session.up
    assert here.session.misfits == {(1, 1): "system 1 is not the mission's vehicle.system_id 7"}
    here.beat(voice=voice(7, 1))
    assert here.session.peer.ids == (7, 1)


@pytest.mark.parametrize(
    ("fields", "words"), [({"autopilot": 12}, "px4 quadrotor"), ({"kind": 1}, "ardupilotmega fixed_wing")]
)
def test_a_vehicle_of_another_kind_is_told_and_not_pinned(line, fields, words):
    here = line()
    here.beat(**fields)
    assert not here.session.up
    (reason,) = here.session.misfits.values()
    assert reason.startswith(f"system 1 is {words}, the mission is for ardupilot copter")


def test_a_peer_that_speaks_mavlink_1_only_is_told_what_to_set_and_sent_our_mavlink_2(line, voice):
    here = line()
    here.beat(voice=voice(1, 1, version=1), source="old port")
    assert not here.session.up
    (reason,) = here.session.misfits.values()
    assert "MAVLink 1 only" in reason
    assert "SERIALn_PROTOCOL = 2" in reason
    assert here.session.reply_to == "old port", "our MAVLink 2 heartbeat makes many autopilots switch over"
    here.beat(source="old port")
    assert here.session.up


def test_a_flood_of_misfits_is_remembered_in_part(line, voice):
    here = line(system_id=255)
    for system in range(1, 251):
        here.beat(voice=voice(system, 1))
    assert len(here.session.misfits) == 16


def test_our_own_ids_from_outside_are_a_twin_and_counted(line, voice):
    here = line()
    here.beat()
    here.hear(mavlink.MAVLink_heartbeat_message(COMPANION, INVALID, 0, 0, 4, 3), voice=voice(1, 191))
    assert here.session.ignored["twin"] == 1
    assert here.session.peer.ids == (1, 1)


def test_messages_of_strangers_move_nothing(line, voice):
    here = line()
    here.beat()
    stranger = voice(1, 154)
    here.hear(mavlink.MAVLink_statustext_message(6, b"not the autopilot"), voice=stranger)
    here.hear(mavlink.MAVLink_statustext_message(6, b"forged"), source="elsewhere")
    here.hear(mavlink.MAVLink_system_time_message(0, 10_000_000), voice=stranger)
    here.hear(mavlink.MAVLink_system_time_message(0, 1_000), voice=stranger)
    assert list(here.session.texts) == []
    assert here.session.reboots == 0


def test_a_vehicle_that_is_let_go_is_no_longer_ours(line):
    here = line()
    here.beat(mode=4)
    assert here.session.in_our_mode
    here.session.lose()
    assert not here.session.up
    assert not here.session.in_our_mode
    assert here.session.mode is None


# --- its mode ---


@pytest.mark.parametrize(
    ("fields", "ours"),
    [({"mode": 4}, True), ({"mode": 4, "armed": False}, False), ({"mode": 5}, False), ({"mode": 20}, False)],
)
def test_the_vehicle_is_ours_when_armed_in_guided_by_its_own_heartbeat(line, fields, ours):
    here = line()
    here.beat(**fields)
    assert here.session.in_our_mode == ours


@pytest.mark.parametrize(("mode", "name"), [(4, "GUIDED"), (5, "LOITER"), (6, "RTL"), (77, "mode 77")])
def test_modes_have_names_for_people(line, mode, name):
    here = line()
    assert here.session.mode_name == "unknown"
    here.beat(mode=mode)
    assert here.session.mode_name == name


# --- reboots ---


@pytest.mark.parametrize("carrier", ["SYSTEM_TIME", "ATTITUDE"])
def test_a_boot_time_that_steps_back_is_a_reboot(line, carrier):
    def boot(ms):
        if carrier == "SYSTEM_TIME":
            return mavlink.MAVLink_system_time_message(0, ms)
        return mavlink.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0)

    here = line()
    here.beat()
    for ms in (500_000, 500_100, 499_200, 500_200):
        here.hear(boot(ms))
    assert here.session.reboots == 0, "0.9 s back is a message that came late"
    for ms in (3_000, 500_300, 3_000, 3_000, 500_400):
        here.hear(boot(ms))
    assert here.session.reboots == 0, "single frames that came late by another way, one of them twice"
    here.hear(boot(3_000))
    here.hear(boot(3_100))
    assert here.session.reboots == 1
    here.hear(boot(3_200))
    assert here.session.reboots == 1


def test_the_vehicle_heard_first_is_the_only_one_that_may_come_back(line, voice):
    here = line()
    here.beat()
    here.session.lose()
    here.beat(voice=voice(2, 1))
    assert not here.session.up
    assert "not the vehicle heard first, system 1" in here.session.misfits[2, 1]
    here.beat(source="elsewhere")
    assert here.session.up


def test_the_wrap_of_the_boot_time_is_no_reboot(line):
    here = line()
    here.beat()
    for ms in (2**32 - 200, 2**32 - 100, 0, 100):
        here.hear(mavlink.MAVLink_system_time_message(0, ms))
    assert here.session.reboots == 0


def test_a_rebooted_vehicle_is_asked_for_its_streams_again(line):
    here = line()
    here.beat()
    here.hear(mavlink.MAVLink_system_time_message(0, 500_000))
    answer_all(here, 0.0)
    here.hear(mavlink.MAVLink_system_time_message(0, 1_000))
    here.hear(mavlink.MAVLink_system_time_message(0, 1_050))
    again = answer_all(here, 1.0)
    assert set(here.session.streams.rates) <= {message.param1 for message in again if message.command == SET_INTERVAL}


# --- what we say ---


def answer_all(here, now):
    """Poll and acknowledge until nothing is under way; the commands that were sent."""
    sent = []
    while commands := here.poll(now, "COMMAND_LONG"):
        sent += commands
        for command in commands:
            here.hear(mavlink.MAVLink_command_ack_message(command.command, 0), now)
    return sent


def test_our_heartbeat_goes_out_once_a_second_even_before_a_vehicle_is_heard(line):
    here = line()
    beats = [now for i in range(101) if here.poll(now := i / 20, "HEARTBEAT")]
    assert beats == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_our_heartbeat_is_that_of_an_onboard_controller_and_never_of_a_ground_station(line):
    """System 255 or MAV_TYPE_GCS would feed the operator's GCS failsafe."""
    here = line()
    here.beat()
    (beat,) = here.poll(0.0, "HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.base_mode) == (COMPANION, INVALID, 0)


def test_a_new_vehicle_is_asked_for_its_streams_and_its_version(line):
    here = line()
    here.beat()
    asked = answer_all(here, 0.0)
    assert {message.param1 for message in asked if message.command == SET_INTERVAL} == set(here.session.streams.rates)
    assert [message.param1 for message in asked if message.command == REQUEST_MESSAGE] == [148]
    assert all((message.target_system, message.target_component) == (1, 1) for message in asked)


def timesync(line, now):
    """Our answers to the vehicle's questions, and our own questions."""
    messages = line.poll(now, "TIMESYNC")
    return [one for one in messages if one.tc1], [one for one in messages if not one.tc1]


def test_a_timesync_request_is_answered_with_our_clock_and_theirs_mirrored(line):
    here = line()
    here.beat()
    here.hear(mavlink.MAVLink_timesync_message(0, 123_456_789_012))
    (reply,), _ = timesync(here, 2.5)
    assert reply.ts1 == 123_456_789_012
    assert reply.tc1 > 0
    assert timesync(here, 2.6)[0] == []


def test_a_timesync_reply_says_the_time_at_which_the_request_was_heard(line):
    here = line()
    here.beat()
    here.hear(mavlink.MAVLink_timesync_message(0, 1), now=2.0)
    (reply,), _ = timesync(here, 2.04)
    assert reply.tc1 == 2_000_000_000


def test_a_timesync_answer_is_not_a_request(line):
    here = line()
    here.beat()
    here.hear(mavlink.MAVLink_timesync_message(55, 66))
    assert timesync(here, 0.0)[0] == []


def test_a_flood_of_timesync_requests_is_answered_in_part(line):
    here = line()
    here.beat()
    for i in range(1000):
        here.hear(mavlink.MAVLink_timesync_message(0, i))
    assert len(timesync(here, 0.0)[0]) == 4


def ask_and_answer(line, since, trips):
    """Poll at 20 Hz; every question is answered after the next of the trips, a None never."""
    due, trips = [], list(trips)
    for i in range(400):
        now = since + i / 20
        for at, stamp in due:
            if abs(at - now) < 0.01:
                line.hear(mavlink.MAVLink_timesync_message(10**12, stamp), now)
        _, asked = timesync(line, now)
        for question in asked:
            trip = trips.pop(0) if trips else None
            if trip is not None:
                due.append((now + trip, question.ts1))


def test_the_round_trip_is_the_median_of_the_newest_five(line):
    here = line()
    here.beat()
    assert here.session.round_trip.typical is None
    ask_and_answer(here, 5.0, [2.0, 2.0, 0.1, 0.2, 0.3, None, 0.25, 0.2])
    assert here.session.round_trip.typical == pytest.approx(0.3)


def test_an_answer_to_somebody_elses_question_and_a_second_one_to_ours_are_no_round_trips(line):
    here = line()
    here.beat()
    _, (question,) = timesync(here, 1.0)
    here.hear(mavlink.MAVLink_timesync_message(10**12, question.ts1 + 1), 1.1)
    here.hear(mavlink.MAVLink_timesync_message(10**12, question.ts1), 1.3)
    here.hear(mavlink.MAVLink_timesync_message(10**12, question.ts1), 3.0)
    assert list(here.session.round_trip.trips) == [pytest.approx(0.3)]


def test_an_answer_that_is_minutes_late_is_no_round_trip(line):
    here = line()
    here.beat()
    _, (question,) = timesync(here, 1.0)
    here.hear(mavlink.MAVLink_timesync_message(10**12, question.ts1), 200.0)
    assert here.session.round_trip.worst is None


def test_a_question_that_should_have_been_answered_is_asked_again_at_once(line):
    here = line()
    here.beat()
    ask_and_answer(here, 5.0, [0.1] * 60)
    _, (question,) = timesync(here, 26.0)
    asked = [now / 20 for now in range(26 * 20 + 1, 28 * 20) if timesync(here, now / 20)[1]]
    assert asked == pytest.approx([26.25 + i / 4 for i in range(7)])
    here.hear(mavlink.MAVLink_timesync_message(10**12, question.ts1), 28.0)
    assert here.session.round_trip.worst == pytest.approx(2.0)


def test_who_never_answers_is_not_asked_in_haste_for_ever(line):
    here = line()
    here.beat()
    ask_and_answer(here, 5.0, [0.1] * 60)
    asked = [now / 20 for now in range(26 * 20, 60 * 20) if timesync(here, now / 20)[1]]
    assert len([time for time in asked if time < 29.0]) > 10
    assert [b - a for a, b in pairwise(time for time in asked if time > 30.0)] == pytest.approx([1.0] * 29, abs=0.06)


def test_how_much_slower_a_link_has_become_is_told_by_the_quickest_answer_since_and_asked_for_at_once(line):
    here = line()
    here.beat()
    slower = here.session.round_trip.slower
    assert slower(5.0, 5.0) == 0.0, "nothing has ever been answered"
    ask_and_answer(here, 5.0, [0.2] * 60)
    assert timesync(here, 26.0)[1]
    assert slower(26.1, 26.6) == float("inf")
    _, (question,) = timesync(here, 26.6)
    here.hear(mavlink.MAVLink_timesync_message(10**12, question.ts1), 27.3)
    assert slower(26.1, 27.3) == pytest.approx(0.5)
    assert slower(27.4, 37.2) == float("inf")
    assert slower(27.4, 37.5) == 0.0, "who answers nothing any more tells nothing"


def test_a_link_that_is_slow_but_answers_is_not_asked_more_often(line):
    here = line()
    here.beat()
    ask_and_answer(here, 5.0, [0.8] * 20)
    assert timesync(here, 26.0)[1]
    assert not any(timesync(here, 26.0 + i / 20)[1] for i in range(1, 16))


def test_a_vehicle_is_asked_the_time_twice_a_second_and_later_once(line):
    here = line()
    here.beat()
    asked = []
    for i in range(400):
        _, questions = timesync(here, i / 20)
        asked += [i / 20] * len(questions)
        for question in questions:
            here.hear(mavlink.MAVLink_timesync_message(10**12, question.ts1), i / 20)
    assert asked[:5] == pytest.approx([0, 0.5, 1, 1.5, 2])
    assert 14 <= len([time for time in asked if time > 5]) <= 16


def test_without_a_vehicle_nothing_but_heartbeats_is_said(line):
    here = line()
    here.session.announcer.say("range", "range lost")
    assert [message.get_type() for i in range(100) for message in here.poll(i / 20)] == ["HEARTBEAT"] * 5


def test_the_vehicles_own_texts_are_kept_the_newest_eight(line):
    here = line()
    here.beat()
    for i in range(20):
        here.hear(mavlink.MAVLink_statustext_message(3, f"text {i}".encode()))
    assert list(here.session.texts) == [f"text {i}" for i in range(12, 20)]


def test_the_firmware_is_read_from_the_version(line):
    here = line()
    here.beat()
    version = 4 << 24 | 6 << 16 | 3 << 8
    here.hear(mavlink.MAVLink_autopilot_version_message(0, version, 0, 0, 0, *([bytes(8)] * 3), 0, 0, 0))
    assert here.session.firmware == "4.6.3"


def test_farewell_gives_every_stream_back_in_one_go(line):
    here = line()
    here.beat()
    farewell = here.session.farewell()
    assert {message.param1 for message in farewell} == set(here.session.streams.rates)
    assert all((message.command, message.param2) == (SET_INTERVAL, 0) for message in farewell)


def test_answers_to_the_sessions_own_commands_are_not_the_pilots_business(line):
    here = line()
    here.beat()
    answer_all(here, 0.0)
    here.poll(0.1)
    assert here.session.take_mode_results() == []


def test_a_refused_stream_is_not_asked_for_again(line):
    here = line()
    here.beat()
    while commands := here.poll(0.0, "COMMAND_LONG"):
        for command in commands:
            here.hear(mavlink.MAVLink_command_ack_message(command.command, 2))  # MAV_RESULT_DENIED
    assert here.poll(3.1, "COMMAND_LONG") == []
