"""Requests for the guided mode before the flight and for the exit action after it, and the last
frames of a failed pilot."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Ending, Phase
from tests.rig import Rig, decode, timing

GUIDED = 4
LOITER = 5
RTL = 6
LAND = 9
SET_MODE = 176


def asked(mode: int = LOITER, **settings) -> Rig:
    """Return a rig that has just sent its first request for the guided mode."""
    rig = Rig(request_mode=True, **settings)
    while not rig.commands(SET_MODE):
        rig.run(0.05, mode=mode)
    return rig


def interrupted(exit: str = "rtl") -> tuple[Rig, float]:
    """Return a rig that flew and was interrupted, and the time of the interrupt."""
    rig = Rig(exit=exit).engage()
    rig.pilot.interrupt(rig.now, "SIGINT")
    return rig, rig.now


def modes(rig: Rig, since: float) -> list[float]:
    """Return the modes requested since a time."""
    return [message.param2 for message in rig.commands(SET_MODE, since)]


def safe(rig: Rig, since: float) -> bool:
    """True if setpoints were sent since a time, and only the safe one."""
    return {message.vx for message in rig.setpoints(since)} == {0.0}


# --- the guided mode ---


def test_the_mode_is_requested_once_everything_is_ready_and_believed_from_the_heartbeat():
    rig = Rig(request_mode=True).run(3.0, mode=LOITER, ranges=False)
    assert rig.commands(SET_MODE) == [], "there is no ranging yet"
    rig.run(1.5, ranges=True)
    first = rig.commands(SET_MODE)[0]
    assert (first.param1, first.param2) == (1, GUIDED)
    rig.acknowledge(SET_MODE)
    assert rig.run(1.0).setpoints() == [], "an acknowledgement is no mode"
    assert rig.run(1.0, mode=GUIDED).setpoints()


def test_a_refused_mode_ends_the_mission_with_the_vehicles_own_words():
    rig = asked()
    rig.hear(mavlink.MAVLink_statustext_message(3, b"Mode change failed: requires position"))
    rig.acknowledge(SET_MODE, result=4)
    assert rig.run(0.5).pilot.mission.outcome.ending is Ending.ABORTED
    assert (
        rig.pilot.mission.outcome.reason
        == 'mode GUIDED refused: failed, the vehicle reports "Mode change failed: requires'
        ' position"'
    )
    assert rig.setpoints() == []


@pytest.mark.parametrize(
    ("acknowledged", "why", "confirmations"),
    [
        (False, "refused: no answer", [0, 1, 2, 3]),
        (True, "acknowledged, but the vehicle stays in LOITER", [0, 0, 0]),
    ],
    ids=["nobody answers", "acknowledged, but never entered"],
)
def test_a_mode_that_is_asked_for_in_vain_ends_the_mission(acknowledged, why, confirmations):
    rig = asked()
    rig.run(15.0, lambda: acknowledged and rig.tick % 10 == 0 and rig.acknowledge(SET_MODE))
    assert rig.pilot.mission.outcome.reason == f"mode GUIDED {why}"
    assert [message.confirmation for message in rig.commands(SET_MODE)] == confirmations


def test_a_mode_that_was_reached_and_left_before_the_engagement_is_not_asked_for_again():
    """The ranges had stopped when the mode was reached."""
    rig = asked()
    assert rig.run(1.0, ranges=False).pilot.mission.phase is Phase.WAIT_RANGING
    since = rig.run(0.5, mode=GUIDED).now
    assert rig.run(0.5, mode=LOITER).run(10.0, ranges=True).pilot.mission.phase is Phase.READY
    assert rig.commands(SET_MODE, since) == []
    assert rig.pilot.status.waits_for(rig.now) == "mode GUIDED: the operator must enter it"


@pytest.mark.parametrize("acknowledged", [False, True])
def test_whoever_chooses_another_mode_after_our_request_is_not_overruled(acknowledged):
    rig = asked()
    if acknowledged:
        rig.acknowledge(SET_MODE)
    since = rig.run(0.3, mode=RTL).now
    assert rig.run(8.0).run(8.0, mode=LOITER).commands(SET_MODE, since) == []
    assert rig.pilot.status.waits_for(rig.now) == "mode GUIDED: the operator must enter it"
    assert rig.run(1.0, mode=GUIDED).setpoints(), "by the operator's own hand"


@pytest.mark.parametrize("shows", [GUIDED, LOITER, LAND])
@pytest.mark.parametrize("why", ["interrupted", "ranging is gone"])
def test_a_vehicle_that_entered_the_guided_mode_at_our_request_is_given_back_also_where_the_flight_never_began(
    why, shows
):
    rig = asked(exit="rtl", timing=timing(wait_ranging=1.0))
    rig.acknowledge(SET_MODE)
    since = rig.now
    if why == "interrupted":
        rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(0.7, ranges=False).run(1.8, mode=shows)
    assert set(modes(rig, since)) == ({RTL} if shows == GUIDED else set()), (
        "the exit action, where it is ours"
    )
    assert not rig.setpoints(since) or (safe(rig, since) and shows == GUIDED)
    rig.run(2.0, mode=RTL if shows == GUIDED else shows)
    assert rig.pilot.done


def test_a_command_that_waits_when_the_link_is_lost_is_not_sent_to_whoever_comes_back():
    """A mode request is still unanswered: the vehicle that returns may be in the operator's
    hands."""
    rig = Rig(request_mode=True).run(3.0, mode=LOITER, ranges=False)
    rig.run(1.8, speaks=False).run(1.5, ranges=True)
    assert rig.pilot.mission.phase is Phase.WAIT_LINK
    assert 1 <= len(rig.commands(SET_MODE)) <= 3, "asked for, and not yet given up"
    since = rig.now
    assert rig.run(5.0, speaks=True, ranges=False).commands(SET_MODE, since) == []


def test_a_request_that_nobody_has_answered_is_not_repeated_when_what_it_needs_is_gone():
    rig = asked()
    since = rig.run(0.6, ranges=False).now
    assert rig.run(5.0).commands(SET_MODE, since) == []


@pytest.mark.parametrize("exits", [False, True], ids=["the guided mode", "the exit action"])
def test_after_a_stall_no_mode_is_asked_for_until_a_heartbeat_shows_the_present_one(exits):
    rig = interrupted()[0].run(0.2) if exits else asked()
    assert rig.commands(SET_MODE)
    rig.pass_time(0.7)
    since = rig.now - 1e-9
    rig.heartbeat()
    rig.range()
    rig.step()
    assert modes(rig.run(0.95, speaks=False), since) == [], (
        "the heartbeats of PX4 are a second apart"
    )
    assert modes(rig.run(4.0, speaks=True), since), "but then it is"


# --- the exit action ---


def test_an_exit_action_is_asked_for_with_safe_setpoints_until_the_mode_shows():
    rig, since = interrupted()
    assert not rig.run(0.5).pilot.done
    assert modes(rig, since) == [RTL]
    assert safe(rig, since)
    rig.acknowledge(SET_MODE)
    assert rig.run(0.5, mode=RTL).pilot.done
    assert rig.pilot.mission.outcome.reason == "SIGINT"


def test_an_exit_action_is_asked_for_although_the_answer_to_the_first_mode_request_was_lost():
    rig = asked(LAND, exit="loiter").run(5.0, mode=GUIDED)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    assert modes(rig.run(0.5), since) == [LOITER]


def test_an_exit_action_that_is_refused_is_told_and_left_at_that():
    rig, _ = interrupted()
    rig.run(0.2).acknowledge(SET_MODE, result=4)
    assert rig.run(0.5).pilot.done
    assert rig.pilot.mission.outcome.reason.startswith("SIGINT; exit action rtl refused: failed")


def test_an_exit_action_without_an_answer_or_while_every_heartbeat_comes_with_a_stall_does_not_keep_us_for_ever():
    assert interrupted()[0].run(13.0).pilot.done
    stalled, _ = interrupted()
    for _ in range(40):
        stalled.pass_time(0.6)
        stalled.heartbeat()
        stalled.step()
    assert stalled.pilot.done


@pytest.mark.parametrize("why", ["interrupted", "time is over", "ranging is gone"])
def test_a_mission_that_ends_while_it_waits_to_go_on_still_asks_for_its_exit_action(why):
    limits = timing(duration=12.0 if why == "time is over" else 600.0, outage=10.0)
    rig = Rig(exit="rtl", timing=limits).engage()
    assert (
        rig.run(5.0, speaks=False, ranges=False).run(1.0, speaks=True).pilot.mission.phase
        is Phase.WAIT_RANGING
    )
    since = rig.now
    if why == "interrupted":
        rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(0.5 if why == "interrupted" else 12.0)
    assert modes(rig, since)[:1] == [RTL]
    assert safe(rig, since)


def test_a_mission_that_ends_while_the_operator_has_the_vehicle_asks_for_nothing():
    rig = Rig(exit="rtl", end_on_takeover=False).engage().run(2.0, mode=LOITER)
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGTERM")
    assert rig.run(2.0).pilot.done
    assert rig.commands(SET_MODE, since) == [] and rig.setpoints(since) == []


def test_an_exit_action_due_in_a_stall_waits_for_the_heartbeat_that_proves_the_mode():
    rig = Rig(exit="rtl").engage()
    rig.pass_time(1.0)
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.step()
    assert rig.setpoints(since - 1e-9) == [] and not rig.pilot.done
    rig.run(1.0)
    assert set(modes(rig, since)) == {RTL}
    assert safe(rig, since)


def test_an_exit_action_that_a_stall_cut_off_is_asked_for_again_as_soon_as_the_mode_is_known_and_not_for_ever():
    """A request that is dropped before its answer does not count as a try."""
    rig, since = interrupted("brake")
    for _ in range(7):
        assert modes(rig.run(1.0), since)
        since = rig.now
        rig.pass_time(0.6)
    assert rig.run(2.0).pilot.done
    assert rig.pilot.mission.outcome.reason == "SIGINT; exit action brake had no effect"


# --- last frames ---


def last_frames(rig: Rig) -> list:
    return decode(rig.pilot.last_frames(rig.now))


@pytest.mark.parametrize("exit", ["stop", "rtl"])
@pytest.mark.parametrize(
    "waits", [False, True], ids=["in flight", "while the mission waits to go on"]
)
def test_the_last_words_are_one_safe_setpoint_and_the_exit_action_while_it_is_ours_to_fly(
    waits, exit
):
    rig = Rig(exit=exit, end_on_takeover=False)
    assert last_frames(rig.run(0.3)) == []
    rig.engage()
    if waits:
        rig.run(5.0, speaks=False, ranges=False).run(1.0, speaks=True)
        assert rig.pilot.mission.phase is Phase.WAIT_RANGING
    safe, *commands = last_frames(rig)
    assert (safe.vx, safe.yaw_rate, safe.type_mask) == (0.0, 0.0, 0x407)
    asks = [(command.command, command.param2) for command in commands]
    assert asks == ([] if exit == "stop" else [(SET_MODE, RTL)])
    assert last_frames(rig.run(1.0, mode=LOITER)) == []


@pytest.mark.parametrize(
    "passes",
    [
        lambda rig: rig.pass_time(0.6),
        lambda rig: rig.pass_time(5.0),
        lambda rig: rig.run(2.0, speaks=False),
    ],
    ids=["short stall", "long stall", "silence"],
)
def test_the_last_words_ask_for_no_mode_when_the_vehicle_may_be_in_other_hands(passes):
    rig = Rig(exit="rtl").engage()
    passes(rig)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    (safe,) = last_frames(rig)
    assert safe.vx == 0.0
