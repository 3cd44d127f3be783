"""Whose vehicle it is: consent, takeover, mode requests, reboots, dry runs, and what is told of it."""

import random
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.bounds import Bounds
from circnav_mav.pilot import Ending, OutputMode
from circnav_mav.pilot.mission_state import Phase

LOITER, GUIDED = 5, 4
SET_MODE, SET_INTERVAL = 176, 511


# --- the operator takes the vehicle ---


@pytest.mark.parametrize("change", [{"mode": LOITER}, {"mode": 6}, {"armed": False}], ids=["loiter", "rtl", "disarmed"])
@pytest.mark.parametrize("end", [True, False], ids=["ends", "waits"])
def test_the_step_that_hears_of_a_takeover_sends_no_setpoint(make_rig, change, end):
    rig = make_rig(end_on_takeover=end).engage()
    for name, value in change.items():
        setattr(rig, name, value)
    since = rig.now
    rig.now = round(rig.now + 0.05, 6)
    rig.heartbeat()
    rig.range()
    rig.step()
    assert rig.setpoints(since) == []
    assert rig.pilot.phase is (Phase.ENDED if end else Phase.YIELDED)
    rig.run(10.0)
    assert rig.setpoints(since) == [], "not even the safe one: the vehicle is not ours"


@pytest.mark.parametrize("seed", range(20))
def test_a_takeover_at_any_moment_stops_the_setpoints_within_a_tick(make_rig, seed):
    draw = random.Random(seed)
    rig = make_rig(end_on_takeover=draw.random() < 0.5).engage()
    rig.run(draw.randrange(1, 60) * 0.05)
    rig.now = round(rig.now + draw.uniform(0.0, 0.049), 6)
    rig.mode = draw.choice([0, 2, 3, 5, 6, 9, 16, 17, 20, 99])
    since = rig.now - 1e-9
    rig.heartbeat()
    rig.ranges = draw.random() < 0.5
    rig.step()
    rig.run(3.0)
    assert rig.setpoints(since) == []


def test_a_takeover_ends_the_mission_and_says_so(rig):
    rig.engage()
    rig.mode = LOITER
    rig.run(1.0)
    assert rig.pilot.done
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert rig.pilot.outcome.reason == "GUIDED left for LOITER: operator or failsafe"
    rig.mode = GUIDED
    since = rig.now
    rig.run(5.0)
    assert rig.setpoints(since) == []


def test_a_mission_that_waits_flies_again_only_after_the_mode_is_entered_anew(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    rig.mode = LOITER
    rig.run(5.0)
    assert rig.pilot.phase is Phase.YIELDED
    assert rig.pilot.outcome is None
    rig.mode = GUIDED
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_arming_again_is_no_consent(make_rig):
    """Disarmed in GUIDED and armed again: the operator has to leave the mode and enter it."""
    rig = make_rig(end_on_takeover=False).engage()
    rig.armed = False
    rig.run(2.0)
    assert rig.pilot.phase is Phase.YIELDED
    rig.armed = True
    since = rig.now
    rig.run(5.0)
    assert rig.pilot.phase is Phase.YIELDED
    assert rig.setpoints(since) == []
    rig.mode = LOITER
    rig.run(1.0)
    rig.mode = GUIDED
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_a_mode_that_flaps_is_obeyed_every_time(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    for _ in range(20):
        rig.mode = LOITER
        rig.run(0.25)
        since = rig.now
        rig.run(0.25)
        assert rig.setpoints(since) == []
        rig.mode = GUIDED
        rig.run(2.0)
        assert rig.pilot.phase is Phase.ENGAGED


def test_a_takeover_while_holding_stops_the_setpoints_too(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    rig.ranges = False
    rig.run(2.0)
    assert rig.pilot.phase is Phase.HOLDING
    rig.mode = LOITER
    rig.run(0.3)
    since = rig.now
    rig.run(3.0)
    assert rig.setpoints(since) == []


def test_the_heartbeat_of_another_vehicle_in_guided_is_no_consent(rig, voice, say):
    rig.mode = LOITER
    other = voice(2, 1)
    rig.run(1.0)
    for _ in range(40):
        rig.run(0.1)
        rig.hear(say.heartbeat(GUIDED), voice=other, source="elsewhere")
        rig.hear(say.heartbeat(GUIDED), voice=other)
    assert rig.setpoints() == []


def test_a_ground_station_and_a_companion_do_not_disturb_a_flight(rig, voice, say):
    rig.engage()
    for i in range(40):
        rig.run(0.1)
        rig.hear(say.heartbeat(0, kind=6, autopilot=8, armed=False), voice=voice(255, 190))
        rig.hear(say.heartbeat(0, kind=18, autopilot=8, armed=False), voice=voice(1, 100 + i % 5))
    assert rig.pilot.phase is Phase.ENGAGED


# --- reboots ---


@pytest.mark.parametrize("end", [True, False], ids=["ends", "waits"])
def test_a_reboot_in_flight_takes_the_vehicle_out_of_our_hands(make_rig, end):
    """Even if it comes back armed in GUIDED: nobody has consented to that."""
    rig = make_rig(end_on_takeover=end).engage()
    rig.hear(mavlink.MAVLink_system_time_message(0, 900_000))
    rig.run(0.5)
    rig.hear(mavlink.MAVLink_system_time_message(0, 2_000))
    rig.hear(mavlink.MAVLink_system_time_message(0, 2_050))
    since = rig.now
    rig.run(5.0)
    assert rig.setpoints(since) == []
    if end:
        assert rig.pilot.outcome.reason == "autopilot rebooted"
    else:
        assert rig.pilot.phase is Phase.YIELDED


def test_the_wrap_of_the_boot_time_in_flight_is_no_reboot(rig):
    rig.engage()
    for ms in (2**32 - 1000, 2**32 - 500, 0, 500):
        rig.hear(mavlink.MAVLink_system_time_message(0, ms))
        rig.run(0.5)
    assert rig.pilot.phase is Phase.ENGAGED


# --- asking for the mode ---


def test_the_mode_is_never_requested_unless_the_mission_says_so(rig):
    rig.mode = LOITER
    rig.run(20.0)
    assert rig.commands(SET_MODE) == []


def test_the_mode_is_requested_once_everything_is_ready_and_believed_from_the_heartbeat(make_rig):
    rig = make_rig(request_mode=True)
    rig.mode, rig.ranges = LOITER, False
    rig.run(3.0)
    assert rig.commands(SET_MODE) == [], "there is no ranging yet"
    rig.ranges = True
    rig.run(1.0)
    first = rig.commands(SET_MODE)[0]
    assert (first.param1, first.param2) == (1, GUIDED)
    rig.acknowledge(SET_MODE)
    rig.run(1.0)
    assert rig.setpoints() == [], "an acknowledgement is no mode"
    rig.mode = GUIDED
    rig.run(1.0)
    assert rig.setpoints()


def test_a_refused_mode_ends_the_mission_with_the_vehicles_own_words(make_rig):
    rig = make_rig(request_mode=True)
    rig.mode = LOITER
    rig.run(2.0)
    rig.hear(mavlink.MAVLink_statustext_message(3, b"Mode change failed: requires position"))
    rig.acknowledge(SET_MODE, result=4)
    rig.run(0.5)
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert rig.pilot.outcome.reason == (
        'mode GUIDED refused: failed, the vehicle says "Mode change failed: requires position"'
    )
    assert rig.setpoints() == []


def test_a_mode_request_that_nobody_answers_ends_the_mission(make_rig):
    rig = make_rig(request_mode=True)
    rig.mode = LOITER
    rig.run(6.0)
    assert rig.pilot.outcome.reason == "mode GUIDED refused: no answer"
    assert [message.confirmation for message in rig.commands(SET_MODE)] == [0, 1, 2, 3]


def test_a_mode_that_is_acknowledged_but_never_entered_ends_the_mission(make_rig):
    rig = make_rig(request_mode=True)
    rig.mode = LOITER
    for _ in range(300):
        rig.run(0.05)
        if rig.pilot.session.commands._pending.get(SET_MODE):
            rig.acknowledge(SET_MODE)
    assert rig.pilot.outcome.reason == "mode GUIDED acknowledged, but the vehicle stays in LOITER"
    assert 2 <= len(rig.commands(SET_MODE)) <= 3


def test_the_operator_is_not_overruled_by_a_second_mode_request(make_rig):
    rig = make_rig(request_mode=True, end_on_takeover=False)
    rig.mode = LOITER
    rig.run(2.0)
    rig.acknowledge(SET_MODE)
    rig.mode = GUIDED
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED
    rig.mode = LOITER
    since = rig.now
    rig.run(20.0)
    assert rig.commands(SET_MODE, since) == []
    assert rig.pilot.phase is Phase.YIELDED


@pytest.mark.parametrize("end", [True, False], ids=["ends", "waits"])
def test_a_mode_request_still_under_way_is_dropped_when_the_operator_takes_over(make_rig, end):
    """Its acknowledgement was lost: a repeat would take the vehicle back."""
    rig = make_rig(request_mode=True, end_on_takeover=end)
    rig.mode = LOITER
    while not rig.commands(SET_MODE):
        rig.run(0.05)
    rig.mode = GUIDED
    rig.run(0.6)
    assert rig.pilot.phase is Phase.ENGAGED
    rig.mode = LOITER
    rig.run(0.3)
    since = rig.now
    rig.run(3.0)
    assert rig.commands(SET_MODE, since) == []


def test_a_vehicle_that_the_operator_took_is_not_taken_back_after_a_lost_link(make_rig):
    rig = make_rig(request_mode=True, end_on_takeover=False).engage()
    rig.mode = LOITER
    rig.run(2.0)
    assert rig.pilot.phase is Phase.YIELDED
    rig.speaks = False
    rig.run(4.0)
    rig.speaks = True
    since = rig.now
    rig.run(10.0)
    assert rig.commands(SET_MODE, since) == []
    assert rig.setpoints(since) == []


@pytest.mark.parametrize("request_mode", [True, False])
@pytest.mark.parametrize("end", [True, False], ids=["ends", "waits"])
def test_a_mode_changed_during_an_outage_is_the_operators(make_rig, request_mode, end):
    rig = make_rig(request_mode=request_mode, end_on_takeover=end).engage()
    rig.speaks = False
    rig.run(4.0)
    rig.speaks, rig.mode = True, LOITER
    since = rig.now
    rig.run(10.0)
    assert rig.commands(SET_MODE, since) == []
    assert rig.setpoints(since) == []
    assert rig.pilot.done == end


def test_after_a_lost_link_no_other_vehicle_is_flown(make_rig, voice, say):
    """The consent was given for the vehicle that was flown."""
    rig = make_rig().engage()
    rig.speaks = False
    since = rig.now
    for _ in range(80):
        rig.run(0.1)
        rig.hear(say.heartbeat(GUIDED), voice=voice(2, 1), source="elsewhere")
    assert [message for message in rig.setpoints(since) if message.target_system == 2] == []
    rig.speaks = True
    rig.run(1.0)
    assert rig.pilot.phase is Phase.ENGAGED


@pytest.mark.parametrize("how", ["operator has it", "link is gone"])
def test_a_mission_whose_time_runs_out_in_other_hands_is_not_completed(make_rig, say, how):
    rig = make_rig(end_on_takeover=False, timing=replace(say.mission.timing, duration=20.0)).engage()
    if how == "operator has it":
        rig.mode = LOITER
    else:
        rig.speaks = False
    rig.run(25.0)
    assert rig.pilot.outcome.ending is Ending.ABORTED


def test_streams_that_the_vehicle_denies_are_asked_for_once(rig):
    """Also when no mode is ever requested, and for the whole flight."""
    deny_commands(rig, 5.0)
    since = rig.now
    deny_commands(rig, 30.0)
    assert rig.commands(SET_INTERVAL, since) == []


def deny_commands(rig, seconds):
    for _ in range(round(seconds / 0.05)):
        rig.run(0.05)
        for number in {message.command for message in rig.of("COMMAND_LONG", rig.now - 0.01)}:
            rig.acknowledge(number, result=2)


# --- leaving with an exit action ---


def test_an_exit_action_is_asked_for_with_safe_setpoints_until_the_mode_shows(make_rig):
    rig = make_rig(exit="rtl").engage()
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(0.5)
    assert [message.param2 for message in rig.commands(SET_MODE, since)] == [6]
    assert {message.vx for message in rig.setpoints(since)} == {0.0}
    assert not rig.pilot.done
    rig.acknowledge(SET_MODE)
    rig.mode = 6
    rig.run(0.5)
    assert rig.pilot.done
    assert rig.pilot.outcome.reason == "SIGINT"


def test_an_exit_action_is_asked_for_although_the_answer_to_the_first_mode_request_was_lost(make_rig):
    rig = make_rig(request_mode=True, exit="loiter")
    rig.mode = 9
    while not rig.commands(SET_MODE):
        rig.run(0.05)
    rig.mode = GUIDED
    rig.run(5.0)
    assert rig.pilot.phase is Phase.ENGAGED
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(0.5)
    assert [message.param2 for message in rig.commands(SET_MODE, since)] == [LOITER]


def test_an_exit_action_that_is_refused_is_told_and_left_at_that(make_rig):
    rig = make_rig(exit="rtl").engage()
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(0.2)
    rig.acknowledge(SET_MODE, result=4)
    rig.run(0.5)
    assert rig.pilot.done
    assert rig.pilot.outcome.reason.startswith("SIGINT; exit action rtl refused: failed")


def test_an_exit_action_that_nobody_answers_does_not_keep_us_for_ever(make_rig):
    rig = make_rig(exit="rtl").engage()
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(13.0)
    assert rig.pilot.done


# --- a twin of ours ---


def test_another_companion_of_our_ids_is_told_and_ends_the_mission(rig, voice):
    rig.engage()
    twin = voice(1, 191)
    for _ in range(6):
        rig.run(0.5)
        rig.hear(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), voice=twin)
    assert rig.pilot.outcome.ending is Ending.ABORTED
    assert "another companion sends as 1/191" in rig.pilot.outcome.reason


def test_an_echo_of_our_own_frames_is_no_twin(rig):
    """Some routers send back what they get."""
    rig.engage()
    for _ in range(100):
        rig.run(0.05)
        rig.pilot.receive(rig.raw[-1], rig.now, rig.source)
    assert rig.pilot.phase is Phase.ENGAGED


# --- the mission's own bounds ---


@pytest.mark.parametrize(
    ("bounds", "cm", "reason"),
    [
        ({"farthest": 200.0}, 25000, "range 250.0 m is farther than 200.0 m"),
        ({"closest": 80.0}, 5000, "range 50.0 m is nearer than 80.0 m"),
        ({"farthest": 200.0}, 19000, None),
        ({"closest": 80.0}, 8500, None),
    ],
)
def test_a_range_beyond_the_missions_bounds_ends_the_flight(make_rig, bounds, cm, reason):
    rig = make_rig(bounds=Bounds(**bounds))
    rig.range_cm = cm
    rig.run(3.0)
    assert (rig.pilot.outcome and rig.pilot.outcome.reason) == reason


@pytest.mark.parametrize(("percent", "reason"), [(19, "battery 19 % is below 20 %"), (20, None), (-1, None)])
def test_an_empty_battery_ends_the_flight_and_an_unknown_one_does_not(make_rig, percent, reason):
    rig = make_rig(bounds=Bounds(battery=20.0)).engage()
    rig.hear(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 100, percent, 0, 0, 0, 0, 0, 0))
    rig.run(1.0)
    assert (rig.pilot.outcome and rig.pilot.outcome.reason) == reason


@pytest.mark.parametrize(("altitude", "reason"), [(121.0, "altitude 121.0 m is above 120.0 m"), (119.0, None)])
def test_a_height_beyond_the_missions_bounds_ends_the_flight(make_rig, altitude, reason):
    rig = make_rig(bounds=Bounds(highest=120.0)).engage()
    rig.hear(mavlink.MAVLink_vfr_hud_message(15, 15, 0, 50, altitude, 0))
    rig.run(1.0)
    assert (rig.pilot.outcome and rig.pilot.outcome.reason) == reason


# --- a dry run ---


def test_a_dry_run_computes_everything_and_commands_nothing(make_rig):
    rig = make_rig(output_mode=OutputMode.DRY_RUN, request_mode=True)
    rig.mode, rig.armed = LOITER, False
    rig.run(5.0)
    assert rig.pilot.phase is Phase.ENGAGED
    records = rig.pilot.take_records()
    assert records[-1].turn_rate is not None
    assert records[-1].yaw_rate_sent is None
    assert rig.setpoints() == []
    assert rig.commands(SET_MODE) == []
    assert rig.pilot.setpoints_sent == 0


def test_a_dry_run_that_is_interrupted_sends_no_setpoint_either(make_rig):
    rig = make_rig(output_mode=OutputMode.DRY_RUN)
    rig.run(5.0)
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    assert rig.pilot.done
    assert rig.setpoints() == []
    assert rig.pilot.last_words(rig.now) == b""


def test_a_shadow_says_nothing_but_its_heartbeat_and_the_plot_values(make_rig):
    rig = make_rig(output_mode=OutputMode.SHADOW, request_mode=True)
    rig.run(10.0)
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    assert {message.get_type() for _, message in rig.sent} == {"HEARTBEAT", "NAMED_VALUE_FLOAT"}
    assert rig.pilot.done


# --- what is told ---


def test_engaging_and_yielding_are_told_to_every_ground_station(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    assert "circnav: engaged, 100 m clockwise" in rig.texts()
    rig.mode = LOITER
    rig.run(3.0)
    assert "circnav: GUIDED left for LOITER" in rig.texts()


def test_the_end_and_its_reason_are_told_before_the_silence(rig):
    rig.engage()
    rig.run(3.0)
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.run(1.0)
    assert "circnav: ended, SIGINT" in rig.texts(since)


def test_the_four_numbers_to_plot_come_at_four_hertz_or_less(rig):
    rig.engage()
    since = rig.now
    rig.run(5.0)
    values = rig.of("NAMED_VALUE_FLOAT", since)
    assert {message.name for message in values} == {"CN_RNG", "CN_RRATE", "CN_ERR", "CN_YRATE"}
    assert 60 <= len(values) <= 80
    newest = {message.name: message.value for message in values}
    assert newest["CN_RNG"] == pytest.approx(150.0, abs=0.5)
    assert newest["CN_ERR"] == pytest.approx(50.0, abs=0.5)
    assert newest["CN_YRATE"] == pytest.approx(rig.setpoints()[-1].yaw_rate, abs=1e-3)


def test_our_heartbeat_stops_with_the_loop_that_feeds_it(rig):
    """It is sent by the healthy tick and by nothing else."""
    rig.engage()
    for _ in range(100):
        rig.now = round(rig.now + 0.05, 6)
        rig.heartbeat()
    before = len(rig.of("HEARTBEAT"))
    rig.step()
    assert len(rig.of("HEARTBEAT")) == before + 1


def test_every_frame_that_came_in_is_kept_for_the_recorder(rig, voice):
    junk_free = voice(9, 9).say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    rig.pilot.receive(junk_free + b"\x00" + junk_free, 0.0, "x")
    assert rig.pilot.take_frames() == [junk_free, junk_free]
    assert rig.pilot.take_frames() == []


def test_every_step_that_acted_leaves_one_record(rig):
    rig.engage()
    rig.pilot.take_records()
    rig.run(1.0)
    records = rig.pilot.take_records()
    assert [record.phase for record in records] == [Phase.ENGAGED] * len(records)
    assert len(records) >= 20
    assert all(record.yaw_rate_sent == pytest.approx(-record.turn_rate) for record in records if record.yaw_rate_sent)
    assert records[-1].link_age == pytest.approx(rig.now % 0.25, abs=1e-6)
    assert records[-1].mode == "GUIDED"
    assert records[-1].measured == 150.0


# --- fuzz ---


@pytest.mark.parametrize("seed", range(4))
def test_whatever_arrives_nothing_raises_and_every_setpoint_is_within_limits(make_rig, voice, seed):
    """Random bytes, flipped bits, random fields of every message that we read, random sources, while flying."""
    draw = random.Random(seed)
    rig = make_rig(end_on_takeover=False).engage()
    read = [mavlink.mavlink_map[ident] for ident in (0, 2, 22, 30, 74, 77, 111, 132, 148, 251, 253, 513)]
    for _ in range(600):
        rig.run(0.05)
        kind = draw.choice(read)
        payload = draw.randbytes(kind.unpacker.size)
        source = draw.choice([(1, 1), (1, 190), (255, 190), (draw.randrange(256), draw.randrange(256))])
        body = bytes((len(payload), 0, 0, draw.randrange(256), *source)) + kind.id.to_bytes(3, "little") + payload
        frame = bytearray(b"\xfd" + body + mavlink.x25crc(body + bytes((kind.crc_extra,))).crc.to_bytes(2, "little"))
        if draw.random() < 0.3:
            frame[draw.randrange(len(frame))] ^= 1 << draw.randrange(8)
        rig.pilot.receive(bytes(frame), rig.now, draw.choice([rig.source, "elsewhere"]))
        rig.pilot.receive(draw.randbytes(draw.randrange(60)), rig.now, rig.source)
    assert all(abs(m.yaw_rate) <= 0.35 * (1 + 1e-6) and 0 <= m.vx <= 15 for m in rig.setpoints())
    assert all(m.type_mask == 0x407 and m.coordinate_frame == 8 for m in rig.setpoints())


def test_settings_of_a_mission_are_not_shared_between_pilots(make_rig, say):
    one, two = make_rig(), make_rig(timing=replace(say.mission.timing, duration=3.0))
    one.run(8.0)
    two.run(8.0)
    assert (one.pilot.done, two.pilot.done) == (False, True)


# --- on the ground ---


@pytest.mark.parametrize("request_mode", [True, False])
@pytest.mark.parametrize("landed_state", [1, 3, 4], ids=["on ground", "taking off", "landing"])
def test_a_vehicle_that_does_not_fly_yet_is_neither_steered_nor_asked(make_rig, landed_state, request_mode):
    """An armed copter in GUIDED on the ground would fight its own take-off."""
    rig = make_rig(request_mode=request_mode)
    rig.landed_state, rig.mode = landed_state, LOITER if request_mode else GUIDED
    rig.run(4.0)
    assert (rig.setpoints(), rig.commands(SET_MODE)) == ([], [])
    rig.landed_state = 2
    rig.run(1.0)
    assert rig.commands(SET_MODE) if request_mode else rig.setpoints()


def test_a_vehicle_that_never_tells_whether_it_flies_is_given_a_moment_and_then_believed(make_rig):
    rig = make_rig()
    rig.landed_state = None
    rig.run(1.5)
    assert rig.setpoints() == []
    rig.run(0.5)
    assert rig.setpoints() != []


def test_a_stream_that_was_denied_is_named_when_the_flight_cannot_begin(make_rig):
    rig = make_rig()
    rig.ranges = False
    for _ in range(1000):
        rig.run(0.05)
        for number in list(rig.pilot.session.commands._pending):
            rig.acknowledge(number, 2)  # MAV_RESULT_DENIED
    assert rig.pilot.outcome.ending is Ending.NOTHING_HEARD
    assert "streams denied by the vehicle" in rig.pilot.outcome.reason
    assert "VFR_HUD" in rig.pilot.outcome.reason
    assert rig.setpoints() == []


def test_a_vehicle_whose_heartbeats_get_lost_stays_ours_while_it_tells_its_mode_otherwise(rig):
    """PX4 sends one heartbeat a second; at 20 % loss three in a row are lost every other minute."""
    rig.engage().speaks = False
    since = rig.now
    for _ in range(20):
        rig.run(0.5)
        rig.hear(mavlink.MAVLink_current_mode_message(0, GUIDED, GUIDED))
    assert rig.pilot.phase is Phase.ENGAGED
    assert len(rig.setpoints(since)) >= 180, "twenty a second, but for a range that comes between two ticks"
    rig.hear(mavlink.MAVLink_current_mode_message(0, LOITER, LOITER))
    since = rig.now
    rig.run(2.0)
    assert rig.setpoints(since) == []
    assert rig.pilot.outcome.reason == "GUIDED left for LOITER: operator or failsafe"


def test_a_vehicle_that_does_not_turn_as_told_teaches_the_estimator_no_motion(make_rig):
    """A copter that no longer hears us stands still: at the speed it was told, it would be somewhere else."""
    rig = make_rig().engage()
    heard = []
    rig.pilot.tracker.estimator.move = heard.append
    heading = 0.0
    for turns in (True, False):
        heard.clear()
        for _ in range(200):
            heading += 0.05 * rig.setpoints()[-1].yaw_rate if turns else 0.0
            rig.hear(mavlink.MAVLink_attitude_message(round(1000 * rig.now), 0.0, 0.0, heading, 0.0, 0.0, 0.0))
            rig.run(0.05)
        late = [own for own in heard if own.time > rig.now - 5.0]
        assert len(late) == (99 if turns else 0)


# --- what is left of a flight when the vehicle is taken, lost or started anew ---


def test_a_command_that_waits_when_the_link_is_lost_is_not_sent_to_whoever_comes_back(make_rig):
    """A mode request still unanswered: the vehicle that comes back may be in the operator's hands."""
    rig = make_rig(request_mode=True)
    rig.mode, rig.ranges = LOITER, False
    rig.run(3.0)
    rig.speaks = False
    rig.run(1.8)
    rig.ranges = True
    rig.run(1.5)
    assert rig.pilot.phase is Phase.WAIT_LINK
    assert 1 <= len(rig.commands(SET_MODE)) <= 3, "asked for, and not yet given up"
    rig.speaks, rig.ranges = True, False
    since = rig.now
    rig.run(5.0)
    assert rig.commands(SET_MODE, since) == []


def test_a_reboot_of_the_autopilot_makes_the_estimate_forget_what_came_before(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    rig.hear(mavlink.MAVLink_system_time_message(0, 900_000))
    rig.run(0.5)
    rig.ranges = False
    assert rig.pilot.take_records()[-1].r == pytest.approx(150.0, abs=0.5)
    for boot_ms in (2_000, 2_050):
        rig.hear(mavlink.MAVLink_system_time_message(0, boot_ms))
    rig.run(0.05)
    assert [record.r for record in rig.pilot.take_records()] == [None]
    assert not rig.pilot.tracker.estimator.ready


def test_a_current_mode_of_zero_is_no_mode(rig):
    """Nothing was filled in: neither another mode nor a proof that the vehicle is there."""
    rig.engage()
    for _ in range(10):
        rig.hear(mavlink.MAVLink_current_mode_message(0, 0, 0))
        rig.run(0.05)
    assert (rig.pilot.phase, rig.pilot.session.mode) == (Phase.ENGAGED, GUIDED)
    rig.speaks = False
    for _ in range(80):
        rig.hear(mavlink.MAVLink_current_mode_message(0, 0, 0))
        rig.run(0.05)
    assert rig.pilot.phase is Phase.WAIT_LINK
