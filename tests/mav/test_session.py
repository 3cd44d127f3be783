"""The link to one vehicle: its identity, other senders, reboots, clocks, and our own heartbeat."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.commands import Command
from tests.rig import Voice, attitude, boot_time, heartbeat

GCS = 6
COMPANION = 18
INVALID = 8
SET_INTERVAL = 511
REQUEST_MESSAGE = 512


class Line:
    """A session and the senders on its link."""

    def __init__(self, session):
        self.session = session
        self.vehicle = Voice(1, 1)

    def receive(self, message, now=0.0, voice=None, source="vehicle"):
        self.session.receive((voice or self.vehicle).message(message), now, source)

    def beat(self, now=0.0, voice=None, source="vehicle", **fields):
        self.receive(heartbeat(**fields), now, voice, source)

    def poll(self, now, kind=None):
        return [message for message in self.session.poll(now) if kind in (None, message.get_type())]

    def answer_all(self, began, result=0):
        """Poll and acknowledge until no command is pending, at the start and after the first
        measurement of the streams. Return the sent commands."""
        sent = []
        for now in (began, began + 0.7):
            while commands := self.poll(now, "COMMAND_LONG"):
                sent += commands
                for command in commands:
                    self.receive(mavlink.MAVLink_command_ack_message(command.command, result), now)
        return sent


@pytest.fixture
def line(make_session):
    return lambda **settings: Line(make_session(**settings))


@pytest.fixture
def here(line):
    """A session that has received its vehicle, armed in GUIDED."""
    here = line()
    here.beat()
    return here


# --- the vehicle that is flown


def test_session_selects_first_vehicle_matching_mission(line):
    here = line()
    here.beat(now=1.0, voice=Voice(42, 1), source=("10.0.0.1", 14550))
    session = here.session
    assert session.up
    assert session.peer.ids == session.vehicle_ids == (42, 1)
    assert session.encoder.system == 42
    assert session.reply_to == ("10.0.0.1", 14550)
    assert session.heartbeat_age(2.5) == 1.5


def test_other_vehicles_are_counted_without_effect(line):
    here = line()
    other = Voice(2, 1)
    camera = Voice(1, 154)
    here.beat(now=0.0, mode=5)
    for i in range(5):
        here.beat(now=0.1 * i, voice=other, mode=4, source="elsewhere")
    here.beat(now=0.6, mode=4, source="elsewhere")  # a vehicle with the same ids at another address
    here.receive(mavlink.MAVLink_statustext_message(6, b"not the autopilot"), voice=camera)
    here.receive(mavlink.MAVLink_statustext_message(6, b"forged"), source="elsewhere")
    for ms in (10_000_000, 1_000, 1_100):
        here.receive(mavlink.MAVLink_system_time_message(0, ms), voice=camera)
    session = here.session
    assert (session.peer.ids, session.vehicle.mode, session.vehicle.reboots) == ((1, 1), 5, 0)
    assert session.identity.ignored["other_vehicle"] == 6
    assert list(session.vehicle.texts) == []


def test_vehicle_with_expected_boot_time_may_change_address(line):
    here = line()
    here.beat(now=0.0, source="port 1")
    here.beat(now=1.4, source="port 2")
    assert here.session.reply_to == "port 1"
    here.receive(boot_time(100.0), now=1.45, source="port 1")
    here.beat(now=3.0, source="port 2")
    assert here.session.reply_to == "port 1"
    here.receive(boot_time(101.6), now=3.05, source="port 2")
    here.beat(now=3.1, source="port 2", mode=5)
    assert (here.session.reply_to, here.session.vehicle.mode) == ("port 2", 5)
    here.session.lose()
    here.beat(now=5.0, voice=Voice(2, 1))
    assert not here.session.up
    assert "not the vehicle received first, system 1" in here.session.identity.misfits[2, 1]
    here.beat(now=5.1, source="elsewhere")
    assert here.session.up


@pytest.mark.parametrize(
    ("fields", "movable"),
    [
        ({"kind": GCS, "autopilot": INVALID}, True),
        ({"kind": COMPANION, "autopilot": INVALID}, True),
        ({"kind": GCS, "autopilot": 3}, False),  # a ground station that claims an autopilot
    ],
)
def test_session_ignores_heartbeats_of_stations_and_companions(line, fields, movable):
    here = line()
    here.beat(voice=Voice(255, 190), **fields)
    assert not here.session.up
    here.beat(now=0.1, mode=4)
    here.beat(now=0.2, voice=Voice(1, 100), mode=5, **fields)
    assert here.session.vehicle.mode == 4
    assert here.session.identity.ignored["other_vehicle"] == (not movable)
    assert here.session.identity.misfits == {}


@pytest.mark.parametrize(
    ("voice", "fields", "reason"),
    [
        ((1, 1), {}, "system 1 is not the mission's vehicle.system_id 7"),
        ((7, 1), {"autopilot": 12}, "system 7 is px4 quadrotor, the mission is for ardupilot"),
        ((7, 1), {"kind": 1}, "system 7 is ardupilotmega fixed_wing, "),
        ((7, 1), {"autopilot": 99}, "system 7 is unknown quadrotor, "),
    ],
)
def test_vehicle_that_does_not_match_mission_is_reported(line, voice, fields, reason):
    here = line(system_id=7)
    here.beat(voice=Voice(*voice), **fields)
    assert not here.session.up
    (misfit,) = here.session.identity.misfits.values()
    assert misfit.startswith(reason)
    for system in range(10, 250):
        here.beat(voice=Voice(system, 1))
    assert len(here.session.identity.misfits) == 16
    here.beat(voice=Voice(7, 1))
    assert here.session.peer.ids == (7, 1)


def test_mavlink_1_vehicle_is_reported_with_remedy(line):
    here = line()
    here.beat(voice=Voice(1, 1, version=1), source="old port")
    assert not here.session.up
    (reason,) = here.session.identity.misfits.values()
    assert "MAVLink 1 only" in reason
    assert "SERIALn_PROTOCOL = 2" in reason
    assert here.session.reply_to == "old port"
    here.beat(source="old port")
    assert here.session.up


# --- reported state


@pytest.mark.parametrize(
    ("mode", "armed", "ours", "name"),
    [
        (4, True, True, "GUIDED"),
        (4, False, False, "GUIDED"),
        (5, True, False, "LOITER"),
        (77, True, False, "mode 77"),
    ],
)
def test_vehicle_accepts_setpoints_when_armed_in_guided(line, mode, armed, ours, name):
    here = line()
    vehicle = here.session.vehicle
    assert vehicle.mode_name == "unknown"
    here.beat(mode=mode, armed=armed)
    assert (vehicle.in_our_mode, vehicle.mode_name) == (ours, name)
    here.session.lose()
    assert (here.session.up, vehicle.in_our_mode, vehicle.mode) == (False, False, None)


def requested_streams(session):
    return {*session.adapter.firmware.streams, session.adapter.echo}


@pytest.mark.parametrize("carrier", ["SYSTEM_TIME", "ATTITUDE"])
@pytest.mark.parametrize(
    ("times", "reboots"),
    [
        # a step back of 0.9 s is a late message
        ([500_000, 500_100, 499_200, 499_300, 500_200], 0),
        # single frames that arrive late over another path, one of them twice
        ([500_000, 3_000, 500_300, 3_000, 3_000, 500_400], 0),
        ([2**32 - 200, 2**32 - 100, 0, 100], 0),  # the wrap of 32-bit milliseconds after 49.7 days
        ([500_000, 3_000, 3_100, 3_200], 1),
    ],
    ids=["late", "over another path", "wrap", "reboot"],
)
def test_boot_time_step_back_is_counted_as_reboot(here, carrier, times, reboots):
    here.answer_all(0.0)
    for ms in times:
        here.receive(boot_time(ms / 1000) if carrier == "SYSTEM_TIME" else attitude(ms))
    assert here.session.vehicle.reboots == reboots
    again = {message.param1 for message in here.answer_all(1.0) if message.command == SET_INTERVAL}
    assert again == (requested_streams(here.session) if reboots else set())


# --- own messages


def test_heartbeat_is_sent_every_second_without_vehicle(line):
    """A heartbeat of system 255 or type MAV_TYPE_GCS would prevent the failsafe for a lost ground
    station."""
    here = line()
    here.session.announcer.say("range", "range lost")
    sent = [(i / 20, message) for i in range(101) for message in here.poll(i / 20)]
    assert [now for now, _ in sent] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert {(beat.get_type(), beat.type, beat.autopilot, beat.base_mode) for _, beat in sent} == {
        ("HEARTBEAT", COMPANION, INVALID, 0)
    }


def test_every_requested_stream_is_restored_at_the_end(here):
    asked = here.answer_all(0.0)
    streams = requested_streams(here.session)
    assert {message.param1 for message in asked if message.command == SET_INTERVAL} == streams
    assert [message.param1 for message in asked if message.command == REQUEST_MESSAGE] == [148]
    assert all((message.target_system, message.target_component) == (1, 1) for message in asked)
    assert here.session.take_mode_results() == []
    farewell = here.session.farewell()
    assert {message.param1 for message in farewell} == streams
    assert all((message.command, message.param2) == (SET_INTERVAL, 0) for message in farewell)


@pytest.mark.parametrize("dropped", [False, True])
def test_mode_result_is_kept_until_read_or_dropped(here, dropped):
    here.answer_all(0.0)
    here.session.commands.send(Command(176, (1, 5)))
    here.poll(2.0)
    here.receive(mavlink.MAVLink_command_ack_message(176, 2), 2.0)
    here.poll(2.1)
    if dropped:
        here.session.drop_mode_requests()
    assert len(here.session.take_mode_results()) == (not dropped)


def test_timesync_requests_are_answered_up_to_a_limit(here):
    here.receive(mavlink.MAVLink_timesync_message(0, 123_456_789_012), now=2.0)
    # an answer addressed to another sender must not be taken for a request
    here.receive(mavlink.MAVLink_timesync_message(55, 66), now=2.0)
    replies = [message for message in here.poll(2.04, "TIMESYNC") if message.tc1]
    assert [(reply.tc1, reply.ts1) for reply in replies] == [(2_000_000_000, 123_456_789_012)]
    assert [message for message in here.poll(2.1, "TIMESYNC") if message.tc1] == []
    for i in range(1000):
        here.receive(mavlink.MAVLink_timesync_message(0, i))
    assert len([message for message in here.poll(2.2, "TIMESYNC") if message.tc1]) == 4


def test_timesync_answer_gives_the_round_trip(here):
    (question,) = here.poll(1.0, "TIMESYNC")
    here.receive(mavlink.MAVLink_timesync_message(10**12, question.ts1), 1.3)
    assert here.session.timesync.typical == pytest.approx(0.3)
