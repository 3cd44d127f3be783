"""Attacks by unknown senders, with the vehicle's ids or with other ids, and late frames of the
vehicle itself."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.pilot.status_text import waits_for
from tests.rig import Voice, attitude, boot_time, heartbeat, scattering, vfr_hud

GUIDED = 4
LOITER = 5
OFFBOARD = 393216


@pytest.fixture
def flying(rig):
    """An engaged rig whose vehicle has reported its time since boot only once, as many autopilots
    do."""
    rig.engage().receive(boot_time(1000.0 + rig.now))
    return rig


# --- unknown senders while our vehicle is silent


def outage(rig, seconds):
    """Silence the vehicle for some seconds, then let it send again."""
    rig.run(seconds, speaks=False).now_is(speaks=True)


def test_stream_requests_never_address_system_0(make_rig):
    """System 0 addresses every vehicle behind the endpoint."""
    rig = make_rig().engage().run(70.0, speaks=False, ranges=False)
    assert rig.pilot.done
    assert {message.target_system for message in rig.of("COMMAND_LONG")} == {1}


def test_identity_ignores_heartbeat_of_system_0(make_rig):
    rig = make_rig("engage.request_mode=true")
    rig.vehicle = Voice(0, 1)
    rig.run(3.0, mode=LOITER)
    assert rig.of("COMMAND_LONG") == [] and not rig.pilot.session.up
    assert (
        rig.pilot.session.identity.misfits[0, 1]
        == "system 0 is no id of a vehicle: set its system id to 1 to 255"
    )


@pytest.mark.parametrize("source", ["vehicle", "elsewhere"])
def test_vehicle_of_another_autopilot_is_rejected_after_silence(make_rig, source):
    rig = make_rig("vehicle.autopilot=auto").engage()
    rig.run(4.0, speaks=False, ranges=False)
    since = rig.now
    for _ in range(40):
        rig.receive(heartbeat(OFFBOARD, autopilot=12), source=source)
        rig.receive(vfr_hud(100.0), source=source)
        rig.run(0.2)
    assert rig.setpoints(since) + rig.of("SET_ATTITUDE_TARGET", since) == []
    assert rig.pilot.session.reply_to == "vehicle"
    reasons = [
        *rig.pilot.session.identity.misfits.values(),
        *rig.pilot.session.identity.second_senders.recent(rig.now),
    ]
    assert (
        "not the vehicle received first" if source == "vehicle" else "has a second sender"
    ) in " ".join(reasons)


# --- other addresses: the vehicle's address is kept while messages arrive from it. After a silence,
# another address needs a proof of identity.


@pytest.mark.parametrize(("version", "system"), [(1, 1), (2, 1), (1, 2), (2, 2)])
@pytest.mark.parametrize(
    "seconds",
    [0.0, 2.0, 5.0],
    ids=["mode reported", "mode not reported for 2 s", "mode not reported for 5 s"],
)
@pytest.mark.parametrize("alive", [True, False], ids=["ranges continue", "all messages lost"])
def test_rejected_heartbeat_never_changes_reply_address(flying, version, system, seconds, alive):
    """The vehicle's first message after the silence is CURRENT_MODE, as PX4 may send it."""
    rig = flying
    stranger = Voice(system, 1, version=version)
    rig.run(seconds, speaks=False, ranges=alive)
    rig.receive(heartbeat(GUIDED), voice=stranger, source="elsewhere")
    assert rig.pilot.session.reply_to == "vehicle"
    rig.receive(mavlink.MAVLink_current_mode_message(0, GUIDED, GUIDED))
    rig.run(1.0, speaks=True, ranges=True).receive(boot_time(1000.0 + rig.now))
    since = rig.now
    rig.run(1.0)
    assert rig.pilot.session.reply_to == "vehicle"
    assert len(rig.setpoints(since)) >= 15


SIGNS_OF_LIFE = {
    "attitude": lambda rig: rig.receive(attitude(round(1000 * (1000 + rig.now)))),
    "VFR_HUD": lambda rig: rig.receive(vfr_hud(50.0)),
    "the autopilot's range": lambda rig: rig.range(),
    "a forwarded range": lambda rig: rig.range(voice=Voice(1, 192)),
}


@pytest.mark.parametrize("seconds", [1.8, 4.0], ids=["two heartbeats lost", "link lost"])
@pytest.mark.parametrize("sign", SIGNS_OF_LIFE.values(), ids=SIGNS_OF_LIFE.keys())
def test_reply_address_is_kept_while_vehicle_sends(flying, sign, seconds):
    """The other sender receives the link, so it imitates the vehicle's ids and its time since
    boot."""
    rig = flying
    twin = Voice(1, 1)
    rig.now_is(speaks=False, ranges=False)
    for i in range(round(seconds / 0.05)):
        sign(rig)
        rig.run(0.05)
        if i % 4 == 0 and i > 20:
            rig.receive(boot_time(1000.0 + rig.now), voice=twin, source="elsewhere")
            rig.receive(heartbeat(GUIDED), voice=twin, source="elsewhere")
        assert rig.pilot.session.reply_to == "vehicle"
    assert rig.pilot.session.identity.second_senders.recent(rig.now)
    rig.receive(boot_time(1000.0 + rig.now))
    rig.run(1.0, speaks=True, ranges=True)
    rig.receive(boot_time(1000.0 + rig.now))
    since = rig.now
    assert len(rig.run(1.0).setpoints(since)) >= 15


def test_reply_address_changes_before_flight_after_full_silence(rig):
    rig.run(1.0, mode=LOITER).receive(boot_time(1000.0))
    for seconds, alive, address in ((5.0, True, "vehicle"), (5.0, False, "elsewhere")):
        rig.run(seconds, speaks=False, ranges=alive).receive(heartbeat(LOITER), source="elsewhere")
        assert rig.pilot.session.reply_to == address
    rig.receive(boot_time(3.0), source="elsewhere")
    rig.receive(boot_time(3.1), source="elsewhere")
    rig.run(4.0, source="elsewhere", mode=GUIDED, speaks=True, ranges=True)
    assert rig.pilot.mission.phase is Phase.ENGAGED


@pytest.mark.parametrize("seconds", [2.0, 5.0])
@pytest.mark.parametrize(
    "offset", [5000.0, 30.0, -30.0, None], ids=["+5000", "+30", "-30", "last reported time"]
)
def test_vehicle_with_duplicate_ids_gets_no_setpoints(flying, offset, seconds):
    """The twin uses the vehicle's ids and also reports GUIDED. Only its time since boot differs."""
    rig = flying
    twin = Voice(1, 1)
    last = 1000.0 + flying.now
    rig.run(seconds, speaks=False, ranges=False)
    since = rig.now
    for i in range(100):
        if i % 5 == 0:
            rig.receive(heartbeat(GUIDED), voice=twin, source="elsewhere")
        if i % 20 == 15:
            stamp = last if offset is None else 1000.0 + rig.now + offset
            rig.receive(boot_time(stamp), voice=twin, source="elsewhere")
        rig.run(0.05)
    assert (rig.setpoints(since + 1.5), rig.pilot.session.reply_to) == ([], "vehicle")
    assert "its time since boot" in waits_for(rig.pilot, rig.now)
    rig.run(0.5, speaks=True, ranges=True).receive(boot_time(1000.0 + rig.now))
    since = rig.run(1.5).now
    rig.run(1.0)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    assert len(rig.setpoints(since)) >= 15


@pytest.mark.parametrize("source", ["vehicle", "elsewhere"])
@pytest.mark.parametrize("seconds", [2.0, 5.0])
def test_vehicle_is_confirmed_by_boot_time_after_silence(flying, source, seconds):
    rig = flying
    rig.run(seconds, speaks=False, ranges=False)
    rig.run(1.0, source=source, speaks=True, ranges=True)
    rig.receive(boot_time(1000.0 + rig.now - 0.3))
    rig.run(0.5).receive(boot_time(1000.0 + rig.now - 0.3))
    since = rig.run(1.0).now
    rig.run(1.0)
    assert (rig.pilot.mission.phase, rig.pilot.session.reply_to) == (Phase.ENGAGED, source)
    assert len(rig.setpoints(since)) >= 15
    assert rig.pilot.session.vehicle.reboots == 0


def test_heartbeat_pause_alone_does_not_stop_setpoints(flying):
    """On a lossy link only heartbeats are lost, and other messages arrive from the same address."""
    outage(flying, 2.0)
    since = flying.now
    assert len(flying.run(1.0).setpoints(since)) >= 15


@pytest.mark.parametrize("source", ["vehicle", "elsewhere"])
def test_link_is_treated_as_lost_until_identity_is_confirmed(make_rig, source):
    rig = make_rig().engage()
    rig.receive(boot_time(1000.0 + rig.now))
    rig.run(5.0, speaks=False, ranges=False)
    rig.run(0.25, source=source, speaks=True, ranges=True)
    since = rig.now
    rig.run(1.0)
    assert rig.pilot.mission.phase is Phase.WAIT_LINK
    waits = {
        "vehicle": "the vehicle's identity is not confirmed",
        "elsewhere": "its time since boot",
    }
    assert waits[source] in waits_for(rig.pilot, rig.now)
    rig.run(61.0)
    asked = [message.param1 for message in rig.commands(512, since)]
    assert (mavlink.MAVLINK_MSG_ID_SYSTEM_TIME in asked) is (source == "vehicle")
    assert rig.pilot.mission.outcome.reason == "no vehicle or no ranging for 60 s"
    assert rig.setpoints(since) == []


def test_missing_exit_action_for_unconfirmed_vehicle_is_reported(make_rig):
    """The vehicle has moved to another address, and only one message confirms its identity. Two are
    required, so the exit action is not sent."""
    rig = make_rig("exit.action=brake").engage()
    rig.receive(boot_time(1000.0 + rig.now))
    rig.run(2.0, speaks=False, ranges=False)
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.receive(boot_time(1000.0 + rig.now), source="elsewhere")
    rig.run(1.0, source="elsewhere", speaks=True)
    assert rig.pilot.session.reply_to == "elsewhere"
    assert rig.pilot.last_frames(rig.now) == b""
    rig.run(13.0)
    assert rig.pilot.mission.phase is Phase.ENDED
    assert rig.pilot.mission.outcome.reason.startswith("SIGTERM; exit action not requested")


def test_fast_simulator_keeps_its_identity_after_silence(rig):
    """The simulator's time since boot advances five times as fast as the local clock."""
    for seconds in (15.0, 1.0):
        for _ in range(round(10 * seconds)):
            rig.receive(boot_time(100.0 + 5 * rig.now))
            rig.run(0.1)
        assert rig.pilot.mission.phase is Phase.ENGAGED
        outage(rig, 20.0)


def test_ranges_of_another_autopilot_are_dropped_after_heartbeat(make_rig):
    """The ranges of system 2 are accepted until its first heartbeat shows that it is another
    autopilot."""
    rig = make_rig()
    other = Voice(2, 1)
    rig.run(4.0, lambda: rig.range(4000, voice=other), ranges=False)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    rig.receive(heartbeat(GUIDED), voice=other)
    rig.run(3.0, lambda: rig.range(4000, voice=other))
    assert rig.pilot.mission.phase is Phase.COASTING
    assert rig.pilot.tracker.newest.time < 5.0


# --- late frames


def test_reordered_heartbeat_in_guided_does_not_engage(rig):
    rig.run(4.0, mode=LOITER)
    late = rig.vehicle.pack(heartbeat(GUIDED))
    rig.run(0.5)
    for _ in range(3):
        rig.pilot.receive(late, rig.now, rig.source)
        rig.run(0.1)
    assert rig.setpoints() == []


def test_reordered_heartbeat_does_not_end_a_stall(rig):
    rig.engage()
    late = rig.vehicle.pack(heartbeat(GUIDED))
    rig.range()
    rig.speaks = False
    rig.pass_time(0.6)
    since = rig.now - 1e-9
    rig.run(0.5)
    rig.pilot.receive(late, rig.now, rig.source)
    rig.run(0.5)
    assert rig.setpoints(since) == []


def test_reordered_heartbeat_never_returns_control(make_rig):
    rig = make_rig("engage.on_takeover=wait").engage()
    guided, loiter = (rig.vehicle.pack(heartbeat(mode)) for mode in (GUIDED, LOITER))
    rig.run(0.5)
    since = rig.now
    rig.pilot.receive(loiter, rig.now, rig.source)
    rig.run(0.5, mode=LOITER)
    assert rig.pilot.mission.phase is Phase.YIELDED
    rig.pilot.receive(guided, rig.now, rig.source)
    rig.run(2.0)
    assert rig.setpoints(since) == []


def test_heartbeats_with_separate_sequence_numbers_are_accepted(rig):
    """Example: a sender that packs some messages by pymavlink's `pack`, which does not advance the
    sequence number. Its heartbeats and its other messages are then numbered separately."""
    rig.engage()
    for _ in range(160):
        rig.receive(attitude(0))
    rig.receive(attitude(0), voice=Voice(1, 1))
    rig.pass_time(0.6)
    since = rig.now
    received = rig.pilot.session.vehicle.heartbeat_at
    for _ in range(40):
        rig.receive(attitude(0), voice=Voice(1, 1))
        rig.run(0.05)
    assert rig.pilot.session.vehicle.heartbeat_at > received
    assert rig.setpoints(since)


# --- frames under our own ids


@pytest.mark.parametrize(
    ("apart", "ends"), [(0.05, True), (1.0, True), (3.0, True), (3.6, False), (12.0, False)]
)
def test_another_companion_with_our_ids_ends_the_flight(make_rig, apart, ends):
    rig = make_rig().engage()
    twin = Voice(1, 191)
    for _ in range(4):
        assert rig.pilot.mission.outcome is None
        rig.receive(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 3, 3), voice=twin)
        rig.run(apart)
    assert (rig.pilot.mission.outcome is not None) is ends
    if ends:
        assert "another companion sends with our ids 1/191" in rig.pilot.mission.outcome.reason


def test_forged_frames_with_our_ids_cause_only_warning(make_rig):
    """Any host on the network can send such frames, so they must not end the flight."""
    rig = make_rig().engage()
    twin = Voice(1, 191)
    for _ in range(20):
        rig.receive(
            mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 3, 3),
            voice=twin,
            source=("10.9.9.9", 6666),
        )
        rig.run(0.1)
    assert rig.pilot.mission.outcome is None
    (line,) = rig.pilot.session.identity.second_senders.recent(rig.now)
    assert line.startswith("circnav has a second sender: 1/191 at 10.9.9.9:6666 is rejected")
    assert "circnav: circnav: second sender rejected" in rig.texts()
    rig.run(6.0)
    assert rig.pilot.session.identity.second_senders.recent(rig.now) == []


@pytest.mark.parametrize(
    "message",
    [
        heartbeat(LOITER),
        mavlink.MAVLink_command_ack_message(511, 2),
        mavlink.MAVLink_timesync_message(1, 1),
        mavlink.MAVLink_param_value_message(b"X", 1.0, 9, 1, 0),
        attitude(1),
    ],
    ids=lambda message: message.get_type(),
)
def test_frames_with_vehicle_ids_from_other_address_are_rejected(rig, message):
    session = rig.engage().pilot.session
    message = rig.vehicle.message(message)
    assert session.receive(message, rig.now, "elsewhere") is False
    assert session.identity.second_senders.recent(rig.now)[0].startswith(
        "the vehicle has a second sender: 1/1 at elsewhere is"
    )
    assert session.receive(message, rig.now, "vehicle") is True


def test_unknown_senders_are_read_up_to_a_limit(rig):
    """Of 500 datagrams of an unknown sender, 32 are read. All datagrams of the vehicle are read."""
    rig.engage()
    received = rig.pilot.connection.counts[VEHICLE]
    junk = bytes(1000)
    before = received.bytes
    for source, read in (("elsewhere", 32), ("vehicle", 500)):
        for _ in range(500):
            rig.pilot.receive(junk, rig.now, source)
        assert received.bytes - before == 1000 * read
        before = received.bytes
    assert rig.pilot.connection.allowance.dropped == 468_000
    rig.pilot.receive(junk, rig.now + 1.0, "elsewhere")
    assert received.bytes - before == 1000


def test_accepted_address_of_radio_is_kept_in_flight(rig):
    """In flight the radio's ranges are accepted only from its own host. Only the vehicle may change
    its host."""
    radio = Voice(1, 192)
    at = ("10.0.0.7", 7)
    rig.run(6.0, lambda: rig.range(voice=radio, source=at), ranges=False)
    rig.run(4.0, lambda: rig.range(voice=radio, source=("10.0.0.8", 7)))
    assert rig.pilot.tracker.newest.time < 6.1
    assert rig.pilot.trusted == "1/1 at vehicle, ranges of 1/192 at 10.0.0.7:7"
    received = rig.pilot.connection.counts[VEHICLE]
    before = received.bytes
    for _ in range(500):
        rig.pilot.receive(bytes(1000), rig.now, ("10.0.0.7", 7))
    assert received.bytes - before == 500_000


def test_second_radio_at_other_address_is_reported_once(rig):
    """The second radio is reported only if it sends from another address, because several sensors
    on the vehicle's link are common."""
    rig.engage()
    warning = ["circnav: the ranging radio: second sender rejected"]
    for orientation, source, texts in (
        (24, "vehicle", []),
        (0, "elsewhere", []),
        (24, "elsewhere", warning),
    ):
        other = Voice(1, 193)
        for _ in range(60):
            message = scattering(15000, 1_000_000 + round(rig.now * 1000), orientation=orientation)
            rig.receive(message, voice=other, source=source)
            rig.run(0.1)
        assert [text for text in rig.texts() if "ranging radio" in text] == texts


def test_two_vehicle_senders_prevent_engagement(rig):
    for _ in range(40):
        rig.receive(heartbeat(GUIDED), source="elsewhere")
        rig.run(0.1)
    assert rig.pilot.mission.phase is Phase.READY
    assert "the vehicle has a second sender: 1/1 at vehicle is rejected" in waits_for(
        rig.pilot, rig.now
    )
    assert waits_for(rig.pilot, rig.now).endswith("select yours by link.peer, or sign")
    assert rig.setpoints() == []


# --- another program that steers and is not received here


def test_unrequested_answers_reveal_another_program(rig):
    """Our own commands may be answered twice, because an answer may arrive over two paths. Further
    answers to us reveal another program with our ids."""
    for message in rig.engage().of("COMMAND_LONG"):
        answer = rig.vehicle.pack(
            mavlink.MAVLink_command_ack_message(message.command, 0, 0, 0, 1, 191)
        )
        for _ in range(2):
            rig.pilot.receive(answer, rig.now, rig.source)
    rig.run(1.0)
    assert rig.pilot.second_controller.evidence(rig.now) == ""
    for target, shown in (
        ((255, 190), False),
        ((1, 193), False),
        ((0, 0), False),
        ((1, 191), True),
    ):
        for _ in range(2):
            rig.receive(mavlink.MAVLink_command_ack_message(511, 0, 0, 0, *target))
        assert bool(rig.pilot.second_controller.evidence(rig.now)) is shown
    rig.run(11.0)
    assert rig.pilot.second_controller.evidence(rig.now) == ""
    assert [text for text in rig.texts() if "another program" in text] == [
        "circnav: another program also steers",
        "circnav: another program no longer steers",
    ]


def test_heartbeat_of_peripheral_with_vehicle_ids_is_ignored(rig):
    """A radio or gimbal behind the vehicle's router has the default ids 1/1. The mode 0 in its
    heartbeat once looked like a takeover."""
    peripheral = Voice()
    rig.run(
        20.0,
        lambda: (
            rig.tick % 20 or rig.receive(heartbeat(0, armed=False, autopilot=8), voice=peripheral)
        ),
    )
    assert rig.pilot.mission.phase is Phase.ENGAGED and rig.pilot.session.vehicle.left_for is None
    assert rig.pilot.session.identity.ignored["no_autopilot"] == 19
