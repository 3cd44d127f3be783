"""Asking for the guided mode before the flight and for the exit action after it, and a failed pilot's last words."""

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Ending, Phase

GUIDED, LOITER, RTL = 4, 5, 6
SET_MODE = 176


def ask(rig):
    """Up to the first request."""
    rig.mode = LOITER
    while not rig.commands(SET_MODE):
        rig.run(0.05)
    return rig


# --- the guided mode ---


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


def test_a_mode_that_was_reached_and_left_before_the_engagement_is_not_asked_for_again(make_rig):
    """The ranges had gone when it was reached."""
    rig = ask(make_rig(request_mode=True))
    rig.ranges = False
    rig.run(1.0)
    assert rig.pilot.phase is Phase.WAIT_RANGING
    rig.mode = GUIDED
    rig.run(0.5)
    rig.mode, since = LOITER, rig.now
    rig.run(0.5)
    rig.ranges = True
    rig.run(10.0)
    assert rig.pilot.phase is Phase.READY
    assert rig.commands(SET_MODE, since) == []
    assert rig.pilot.waits_for(rig.now) == "mode GUIDED: the operator must enter it"


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


# --- the exit action ---


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


@pytest.mark.parametrize("why", ["interrupted", "time is over", "ranging is gone"])
def test_a_mission_that_ends_while_it_waits_to_go_on_still_asks_for_its_exit_action(make_rig, say, why):
    timing = replace(say.mission.timing, duration=20.0 if why == "time is over" else 600.0, outage=12.0)
    rig = make_rig(exit="rtl", timing=timing).engage()
    rig.speaks = rig.ranges = False
    rig.run(5.0)
    rig.speaks = True
    rig.run(1.0)
    assert rig.pilot.phase is Phase.WAIT_RANGING
    since = rig.now
    if why == "interrupted":
        rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(25.0 if why != "interrupted" else 0.5)
    assert [message.param2 for message in rig.commands(SET_MODE, since)][:1] == [RTL]
    assert rig.setpoints(since) != [] and {message.vx for message in rig.setpoints(since)} == {0.0}


def test_a_mission_that_ends_while_the_operator_has_the_vehicle_asks_for_nothing(make_rig):
    rig = make_rig(exit="rtl", end_on_takeover=False).engage()
    rig.mode = LOITER
    rig.run(2.0)
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(2.0)
    assert rig.pilot.done
    assert rig.commands(SET_MODE, since) == [] and rig.setpoints(since) == []


def test_an_exit_action_due_in_a_stall_waits_for_the_heartbeat_that_proves_the_mode(make_rig):
    rig = make_rig(exit="rtl").engage()
    rig.pass_time(1.0)
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.step()
    assert rig.setpoints(since - 1e-9) == [] and not rig.pilot.done
    rig.run(1.0)
    assert {message.param2 for message in rig.commands(SET_MODE, since)} == {RTL}
    assert {message.vx for message in rig.setpoints(since)} == {0.0}


def test_leaving_ends_although_every_heartbeat_comes_with_a_stall(make_rig):
    rig = make_rig(exit="rtl").engage()
    rig.pilot.interrupt(rig.now, "SIGTERM")
    for _ in range(40):
        rig.pass_time(0.6)
        rig.heartbeat()
        rig.step()
    assert rig.pilot.done


# --- last words ---


def test_the_last_words_are_one_safe_setpoint_and_only_while_it_is_ours_to_fly(rig, say):
    rig.run(0.3)
    assert rig.pilot.last_words(rig.now) == b""
    rig.engage()
    (message,) = say.decode(rig.pilot.last_words(rig.now))
    assert (message.vx, message.yaw_rate, message.type_mask) == (0.0, 0.0, 0x407)


def test_the_last_words_ask_for_the_exit_action(make_rig, say):
    rig = make_rig(exit="rtl").engage()
    safe, command = say.decode(rig.pilot.last_words(rig.now))
    assert (safe.vx, safe.yaw_rate) == (0.0, 0.0)
    assert (command.command, command.param2) == (SET_MODE, RTL)
    rig.mode = LOITER
    rig.run(1.0)
    assert rig.pilot.last_words(rig.now) == b""


@pytest.mark.parametrize("seconds", [0.6, 5.0])
def test_the_last_words_ask_for_no_mode_when_the_vehicle_may_be_in_other_hands(make_rig, say, seconds):
    rig = make_rig(exit="rtl").engage()
    rig.pass_time(seconds)
    (safe,) = say.decode(rig.pilot.last_words(rig.now))
    assert safe.vx == 0.0


def test_the_last_words_ask_for_no_mode_of_a_vehicle_that_is_silent(make_rig, say):
    rig = make_rig(exit="rtl").engage()
    rig.speaks = False
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED
    (safe,) = say.decode(rig.pilot.last_words(rig.now))
    assert safe.vx == 0.0


def test_the_last_words_are_said_also_where_the_mission_waits_to_go_on(make_rig, say):
    rig = make_rig(exit="rtl").engage()
    rig.speaks = rig.ranges = False
    rig.run(5.0)
    rig.speaks = True
    rig.run(1.0)
    assert rig.pilot.phase is Phase.WAIT_RANGING
    assert [message.get_type() for message in say.decode(rig.pilot.last_words(rig.now))][1:] == ["COMMAND_LONG"]


# --- after a stall, and on the ground ---


def test_a_request_that_nobody_has_answered_is_not_repeated_when_what_it_needs_is_gone(make_rig):
    rig = ask(make_rig(request_mode=True))
    rig.ranges = False
    rig.run(0.6)
    since = rig.now
    rig.run(5.0)
    assert rig.commands(SET_MODE, since) == []


def test_after_a_stall_no_mode_is_asked_for_until_a_heartbeat_shows_the_present_one(make_rig):
    rig = ask(make_rig(request_mode=True))
    rig.pass_time(0.7)
    since = rig.now - 1e-9
    rig.speaks = False  # the heartbeats of PX4 are a second apart
    rig.heartbeat()
    rig.range()
    rig.step()
    rig.run(0.95)
    assert rig.commands(SET_MODE, since) == []


def test_after_a_stall_the_exit_action_is_not_repeated_until_a_heartbeat_shows_the_mode(make_rig):
    rig = make_rig(exit="rtl").engage()
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(0.2)
    assert rig.commands(SET_MODE)
    rig.pass_time(0.7)
    since = rig.now - 1e-9
    rig.speaks = False
    rig.heartbeat()
    rig.step()
    rig.run(0.95)
    assert rig.commands(SET_MODE, since) == []
    rig.speaks = True
    rig.run(4.0)
    assert rig.commands(SET_MODE, since), "but then it is"


@pytest.mark.parametrize("landed_state", [None, 0])
def test_a_disarmed_aircraft_is_on_the_ground_whatever_it_does_not_say(make_rig, landed_state):
    rig = make_rig(request_mode=True)
    rig.mode, rig.armed, rig.landed_state = LOITER, False, landed_state
    rig.run(6.0)
    assert rig.commands(SET_MODE) == []
    assert rig.pilot.waits_for(rig.now) == "the vehicle is not armed"


def test_an_exit_action_that_a_stall_cut_off_is_asked_for_again_as_soon_as_the_mode_is_known(make_rig):
    """What was dropped before its answer was no try."""
    rig = make_rig(exit="brake").engage()
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(0.1)
    first = rig.now
    assert rig.commands(SET_MODE)
    rig.pass_time(0.6)
    rig.run(1.0)
    assert rig.commands(SET_MODE, first)
