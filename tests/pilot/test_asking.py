"""When a mode is asked for, and when not: after the operator, after a stall, on the ground."""

import pytest

from circnav_mav.pilot.mission_state import Phase

GUIDED, LOITER = 4, 5
SET_MODE = 176


def ask(rig):
    """Up to the first request."""
    rig.mode = LOITER
    while not rig.commands(SET_MODE):
        rig.run(0.05)
    return rig


def test_a_mode_that_the_operator_left_again_before_the_flight_began_is_not_asked_for_a_second_time(make_rig):
    """It was reached, but the ranges were gone by then."""
    rig = ask(make_rig(request_mode=True))
    rig.ranges = False
    rig.run(1.0)
    rig.acknowledge(SET_MODE)
    rig.mode = GUIDED
    rig.run(1.0)
    rig.mode, since = LOITER, rig.now
    rig.run(1.0)
    rig.ranges = True
    rig.run(20.0)
    assert rig.commands(SET_MODE, since) == []
    assert rig.setpoints() == []
    rig.mode = GUIDED
    rig.run(1.0)
    assert rig.pilot.phase is Phase.ENGAGED, "his to enter"


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


def test_a_vehicle_that_does_not_know_yet_whether_it_flies_is_given_the_same_moment_as_one_that_does_not_say(rig):
    """PX4 says so until its land detector runs."""
    rig.landed_state = 0  # MAV_LANDED_STATE_UNDEFINED
    rig.run(1.5)
    assert rig.setpoints() == []
    rig.run(0.5)
    assert rig.setpoints() != []


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
