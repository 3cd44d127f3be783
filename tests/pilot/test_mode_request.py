"""Requests for the guided mode before the flight and for the exit action after it, and the last
frames of a failed pilot."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Ending, Phase
from circnav_mav.pilot.status_text import waits_for
from tests.rig import Rig, decode

GUIDED = 4
LOITER = 5
RTL = 6
LAND = 9
POSHOLD = 16
SET_MODE = 176


def asked(*overrides: str, mode: int = LOITER) -> Rig:
    """Return a rig that has just sent its first request for the guided mode."""
    rig = Rig("engage.request_mode=true", *overrides)
    while not rig.commands(SET_MODE):
        rig.run(0.05, mode=mode)
    return rig


def interrupted(exit: str = "rtl") -> tuple[Rig, float]:
    """Return a rig that flew and was interrupted, and the time of the interrupt."""
    rig = Rig(f"exit.action={exit}").engage()
    rig.pilot.interrupt(rig.now, "SIGINT")
    return rig, rig.now


def modes(rig: Rig, since: float) -> list[float]:
    """Return the modes requested since a time."""
    return [message.param2 for message in rig.commands(SET_MODE, since)]


def safe(rig: Rig, since: float) -> bool:
    """Return True if setpoints were sent since a time, and all of them were safe setpoints."""
    return {message.vx for message in rig.setpoints(since)} == {0.0}


# --- the guided mode


def test_mode_is_requested_when_ready_and_confirmed_by_heartbeat():
    rig = Rig("engage.request_mode=true").run(3.0, mode=LOITER, ranges=False)
    assert rig.commands(SET_MODE) == [], "no mode request without ranging"
    rig.run(1.5, ranges=True)
    first = rig.commands(SET_MODE)[0]
    assert (first.param1, first.param2) == (1, GUIDED)
    rig.acknowledge(SET_MODE)
    assert rig.run(1.0).setpoints() == [], "no setpoint before the heartbeat reports the mode"
    assert rig.run(1.0, mode=GUIDED).setpoints()


def test_rejected_mode_request_ends_mission_with_text_of_vehicle():
    rig = asked()
    rig.receive(mavlink.MAVLink_statustext_message(3, b"Mode change failed: requires position"))
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
    ids=["no answer", "acknowledged"],
)
def test_ineffective_mode_request_ends_mission(acknowledged, why, confirmations):
    rig = asked()
    rig.run(15.0, lambda: acknowledged and rig.tick % 10 == 0 and rig.acknowledge(SET_MODE))
    assert rig.pilot.mission.outcome.reason == f"mode GUIDED {why}"
    assert [message.confirmation for message in rig.commands(SET_MODE)] == confirmations


def test_mode_left_before_engagement_is_not_requested_again():
    """The ranges stop before the vehicle reports the guided mode."""
    rig = asked()
    assert rig.run(1.0, ranges=False).pilot.mission.phase is Phase.WAIT_RANGING
    since = rig.run(0.5, mode=GUIDED).now
    assert rig.run(0.5, mode=LOITER).run(10.0, ranges=True).pilot.mission.phase is Phase.READY
    assert rig.commands(SET_MODE, since) == []
    assert waits_for(rig.pilot, rig.now) == "mode GUIDED: the operator must enter it"


@pytest.mark.parametrize("acknowledged", [False, True])
def test_mode_change_of_operator_after_request_is_not_reversed(acknowledged):
    rig = asked()
    if acknowledged:
        rig.acknowledge(SET_MODE)
    since = rig.run(0.3, mode=RTL).now
    assert rig.run(8.0).run(8.0, mode=LOITER).commands(SET_MODE, since) == []
    assert waits_for(rig.pilot, rig.now) == "mode GUIDED: the operator must enter it"
    assert rig.run(1.0, mode=GUIDED).setpoints(), (
        "setpoints after the operator has entered the mode"
    )


@pytest.mark.parametrize("shows", [GUIDED, LOITER, LAND])
@pytest.mark.parametrize("why", ["interrupted", "ranging lost"])
def test_exit_action_is_requested_if_guided_begins_after_end(why, shows):
    rig = asked("exit.action=rtl", "link.wait_s=1.0")
    rig.acknowledge(SET_MODE)
    since = rig.now
    if why == "interrupted":
        rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(0.7, ranges=False).run(1.8, mode=shows)
    assert set(modes(rig, since)) == ({RTL} if shows == GUIDED else set()), (
        "the exit action is requested only in the guided mode"
    )
    assert not rig.setpoints(since) or (safe(rig, since) and shows == GUIDED)
    rig.run(2.0, mode=RTL if shows == GUIDED else shows)
    assert rig.pilot.done


def test_pending_mode_request_is_dropped_with_lost_link():
    """The mode request is unanswered. After the outage the operator may control the vehicle."""
    rig = Rig("engage.request_mode=true").run(3.0, mode=LOITER, ranges=False)
    rig.run(1.8, speaks=False).run(1.5, ranges=True)
    assert rig.pilot.mission.phase is Phase.WAIT_LINK
    assert 1 <= len(rig.commands(SET_MODE)) <= 3, "the mode is requested before the outage"
    since = rig.now
    assert rig.run(5.0, speaks=True, ranges=False).commands(SET_MODE, since) == []


def test_unanswered_mode_request_is_not_repeated_without_ranging():
    rig = asked()
    since = rig.run(0.6, ranges=False).now
    assert rig.run(5.0).commands(SET_MODE, since) == []


@pytest.mark.parametrize("exits", [False, True], ids=["guided mode", "exit action"])
def test_no_mode_request_after_stall_until_heartbeat(exits):
    rig = interrupted()[0].run(0.2) if exits else asked()
    assert rig.commands(SET_MODE)
    rig.pass_time(0.7)
    since = rig.now - 1e-9
    rig.heartbeat()
    rig.range()
    rig.step()
    assert modes(rig.run(0.95, speaks=False), since) == [], "no request before the heartbeat"
    assert modes(rig.run(4.0, speaks=True), since), "request after the heartbeat"


# --- the exit action


def test_exit_action_sends_safe_setpoints_until_mode_change():
    rig, since = interrupted()
    assert not rig.run(0.5).pilot.done
    assert modes(rig, since) == [RTL]
    assert safe(rig, since)
    rig.acknowledge(SET_MODE)
    assert rig.run(0.5, mode=RTL).pilot.done
    assert rig.pilot.mission.outcome.reason == "SIGINT"
    assert rig.pilot.exit_action.result(rig.pilot.session) == "rtl: the vehicle is in RTL"


def test_exit_action_is_requested_despite_unanswered_mode_request():
    rig = asked("exit.action=loiter", mode=POSHOLD).run(5.0, mode=GUIDED)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGINT")
    assert modes(rig.run(0.5), since) == [LOITER]


def test_rejected_exit_action_is_replaced_by_landing():
    """A copter that has just lost its position refuses RTL and LOITER."""
    rig, since = interrupted()
    rig.run(0.2).acknowledge(SET_MODE, result=4)
    assert not rig.run(0.5).pilot.done
    assert modes(rig, since) == [RTL, LAND]
    assert safe(rig, since)
    assert rig.run(0.5, mode=LAND).pilot.done
    assert rig.pilot.mission.outcome.reason == "SIGINT"


def test_rejected_landing_is_reported_and_not_repeated():
    rig, _ = interrupted("land")
    rig.run(0.2).acknowledge(SET_MODE, result=4)
    assert rig.run(0.5).pilot.done
    assert rig.pilot.mission.outcome.reason.startswith("SIGINT; exit action land refused: failed")


def test_mode_request_ends_with_first_report_of_mode():
    """Its acknowledgment is lost. A repeat would replace a mode that the operator enters next."""
    rig = asked()
    since = rig.now
    assert rig.run(0.3, mode=GUIDED).pilot.mission.phase is Phase.ENGAGED
    assert modes(rig.run(5.0), since) == []


def test_mode_request_is_repeated_only_after_old_mode_report():
    rig = asked()
    since = rig.now
    assert modes(rig.run(2.0, speaks=False), since) == []
    rig.run(0.3, speaks=True)
    assert modes(rig, since) == [GUIDED]


def test_exit_action_times_out_without_answer_or_during_stalls():
    assert interrupted()[0].run(13.0).pilot.done
    stalled, _ = interrupted()
    for _ in range(40):
        stalled.pass_time(0.6)
        stalled.heartbeat()
        stalled.step()
    assert stalled.pilot.done


@pytest.mark.parametrize("why", ["interrupted", "timeout", "ranging lost"])
def test_mission_end_during_outage_requests_exit_action(why):
    duration = 12.0 if why == "timeout" else 600.0
    rig = Rig("exit.action=rtl", f"limits.duration_s={duration}").engage()
    assert (
        rig.run(5.0, speaks=False, ranges=False).run(1.0, speaks=True).pilot.mission.phase
        is Phase.WAIT_RANGING
    )
    since = rig.now
    if why == "interrupted":
        rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.run(0.5 if why == "interrupted" else 62.0)
    assert modes(rig, since)[:1] == [RTL]
    assert safe(rig, since)


def test_mission_end_after_takeover_requests_nothing():
    rig = Rig("exit.action=rtl", "engage.on_takeover=wait").engage().run(2.0, mode=LOITER)
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGTERM")
    assert rig.run(2.0).pilot.done
    assert rig.commands(SET_MODE, since) == [] and rig.setpoints(since) == []


def test_exit_action_after_stall_waits_for_heartbeat():
    rig = Rig("exit.action=rtl").engage()
    rig.pass_time(1.0)
    since = rig.now
    rig.pilot.interrupt(rig.now, "SIGTERM")
    rig.step()
    assert rig.setpoints(since - 1e-9) == [] and not rig.pilot.done
    rig.run(1.0)
    assert set(modes(rig, since)) == {RTL}
    assert safe(rig, since)


def test_exit_action_interrupted_by_stalls_is_repeated_until_timeout():
    """A stall drops the pending request. It is sent again, and the dropped request is not
    counted."""
    rig, since = interrupted("brake")
    for _ in range(7):
        assert modes(rig.run(1.0), since)
        since = rig.now
        rig.pass_time(0.6)
    assert rig.run(2.0).pilot.done
    assert rig.pilot.mission.outcome.reason == "SIGINT; exit action brake had no effect"


# --- last frames


def last_frames(rig: Rig) -> list:
    return decode(rig.pilot.last_frames(rig.now))


@pytest.mark.parametrize("exit", ["stop", "rtl"])
@pytest.mark.parametrize("waits", [False, True], ids=["in flight", "during outage"])
def test_last_frames_are_safe_setpoint_and_exit_action(waits, exit):
    rig = Rig(f"exit.action={exit}", "engage.on_takeover=wait")
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
    ids=["short stall", "long stall", "no heartbeats"],
)
def test_last_frames_request_no_mode_without_confirmed_control(passes):
    rig = Rig("exit.action=rtl").engage()
    passes(rig)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    (safe,) = last_frames(rig)
    assert safe.vx == 0.0
