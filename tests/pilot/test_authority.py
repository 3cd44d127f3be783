"""Conditions for setpoints and mode requests: none on the ground, over a slow link, after a stall
or in a dry run."""

import re

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Ending, Outcome, OutputMode, Phase
from circnav_mav.pilot.status_text import waits_for
from tests.rig import MISSION, Rig, attitude, heartbeat, vfr_hud

GUIDED = 4
LOITER = 5
SET_MODE = 176
SET_INTERVAL = 511
IN_AIR = 2


def commanded(rig: Rig, since: float = -1.0) -> list:
    """Return the setpoints and mode requests sent since a time."""
    return rig.setpoints(since) + rig.commands(SET_MODE, since)


# --- before the engagement

SLOW = "link too slow: round trip {} s (at most 0.6 s, 1.2 times limits.stale_s)"
ON_GROUND = "the vehicle is on the ground, takes off or lands"
NOT_ARMED = "the vehicle is not armed"
FLIES = {"armed": True, "landed_state": IN_AIR}
MEASURING = "measuring the round-trip time of the link (TIMESYNC)"


@pytest.mark.parametrize("mode", [LOITER, 20, 0])
def test_no_command_in_other_mode_without_request_mode(rig, mode):
    assert rig.run(5.0, mode=mode).pilot.mission.phase is Phase.READY
    assert commanded(rig) == []
    assert waits_for(rig.pilot, rig.now) == "mode GUIDED: the operator must enter it"


@pytest.mark.parametrize(
    ("state", "seconds", "reason", "then"),
    [
        # a disarmed aircraft is on the ground, even if it reports no landed state
        ({"armed": False}, 5.0, NOT_ARMED, {"armed": True}),
        ({"armed": False, "landed_state": None}, 6.0, NOT_ARMED, FLIES),
        ({"armed": False, "landed_state": 0}, 6.0, NOT_ARMED, FLIES),
        # MAV_LANDED_STATE on ground, taking off and landing: setpoints would disturb the take-off
        # of a copter in GUIDED
        ({"landed_state": 1}, 4.0, ON_GROUND, {"landed_state": IN_AIR}),
        ({"landed_state": 3}, 4.0, ON_GROUND, {"landed_state": IN_AIR}),
        ({"landed_state": 4}, 4.0, ON_GROUND, {"landed_state": IN_AIR}),
        ({"round_trip": None}, 9.0, MEASURING, {}),
        # a very slow link is reported as slow, not as a link without answers
        ({"round_trip": 0.8}, 10.0, SLOW.format("0.80"), {"round_trip": 0.1}),
        ({"round_trip": 9.0}, 25.0, SLOW.format("9.00"), {"round_trip": 0.1}),
    ],
    ids=str,
)
@pytest.mark.parametrize(
    "request_mode", [False, True], ids=["operator enters mode", "circnav requests mode"]
)
def test_no_command_until_every_engagement_condition_is_met(
    state, seconds, reason, then, request_mode
):
    rig = Rig(f"engage.request_mode={str(request_mode).lower()}").run(
        seconds, mode=LOITER if request_mode else GUIDED, **state
    )
    assert (rig.pilot.mission.phase, commanded(rig)) == (Phase.READY, [])
    assert waits_for(rig.pilot, rig.now) == reason
    assert commanded(rig.run(25.0 if seconds == 25.0 else 5.0, **then))


class Plane(Rig):
    """A pilot that flies a plane."""

    def __init__(self) -> None:
        super().__init__(text=MISSION.replace('"copter"', '"plane"'))

    def heartbeat(self) -> None:
        self.receive(heartbeat(15, armed=self.armed, kind=1))
        self.receive(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))
        self.receive(attitude(round(1000 * self.now)))


@pytest.mark.parametrize(("airspeed", "phase"), [(9.0, Phase.READY), (12.0, Phase.ENGAGED)])
def test_plane_below_seven_tenths_of_its_speed_is_not_engaged(airspeed, phase):
    rig = Plane()
    rig.run(5.0, lambda: rig.receive(vfr_hud(100.0, airspeed)))
    assert rig.pilot.mission.phase is phase


def test_vehicle_without_landed_state_resumes_after_lost_link(rig):
    assert rig.engage().run(5.0, speaks=False).pilot.mission.phase is Phase.WAIT_LINK
    assert rig.run(1.0, speaks=True, landed_state=None).pilot.mission.phase is Phase.ENGAGED


def test_denied_streams_are_requested_once_and_named():
    rig = Rig("link.wait_s=20.0")

    def denies():
        for number in {message.command for message in rig.of("COMMAND_LONG", rig.now - 0.01)}:
            rig.acknowledge(number, result=2)

    since = rig.run(5.0, denies, ranges=False).now
    assert rig.run(15.0, denies).commands(SET_INTERVAL, since) == []
    rig.run(3.0)
    assert rig.pilot.mission.outcome.ending is Ending.NOTHING_RECEIVED
    assert "streams denied by the vehicle" in rig.pilot.mission.outcome.reason
    assert "VFR_HUD" in rig.pilot.mission.outcome.reason
    assert rig.setpoints() == []


# --- after a stall


def test_no_setpoint_after_stall_until_new_heartbeat(rig):
    """The loop stopped for 2 s. Frames from the buffers do not prove the present mode, because the
    operator may have taken over meanwhile."""
    rig.engage().pass_time(2.0)
    rig.heartbeat()
    rig.range()
    before = rig.now - 0.01
    rig.step()
    assert rig.setpoints(before) == []
    assert rig.pilot.tracker.ranging.rejected["stalled"] == 1
    assert rig.run(0.5, speaks=False).setpoints(before) == []
    rig.heartbeat()
    assert rig.run(0.1).setpoints(before)


@pytest.mark.parametrize(("seconds", "stalled"), [(0.15, 1), (0.3, 0)])
def test_range_shortly_after_stall_is_rejected(seconds, stalled):
    """Reading the buffers takes some steps."""
    rig = Rig().engage()
    rig.pass_time(1.0)
    rig.step()
    rig.run(seconds, ranges=False)
    rig.range()
    assert rig.pilot.tracker.ranging.rejected["stalled"] == stalled


def test_loop_gap_below_half_second_is_no_stall(rig):
    rig.engage().pass_time(0.45)
    before = rig.now - 0.01
    rig.range()
    rig.step()
    assert rig.setpoints(before)


# --- a dry run, and an end before the flight


def test_dry_run_computes_setpoints_without_sending():
    rig = Rig(
        "engage.request_mode=true", "limits.duration_s=4.0", output_mode=OutputMode.DRY_RUN
    ).run(4.0, mode=LOITER, armed=False)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    newest = rig.pilot.take_records()[-1]
    assert newest.turn_rate is not None and newest.yaw_rate_sent is None
    rig.run(3.0)
    assert rig.pilot.mission.outcome == Outcome(Ending.COMPLETED, "dry run to its end")
    assert commanded(rig) == [] and rig.pilot.setpoints_sent == 0


def test_shadow_mode_sends_only_heartbeat_and_plot_values():
    rig = Rig("engage.request_mode=true", output_mode=OutputMode.SHADOW).run(10.0)
    rig.pilot.interrupt(rig.now, "SIGINT")
    assert rig.run(1.0).pilot.done
    assert {message.get_type() for _, message in rig.sent} == {"HEARTBEAT", "NAMED_VALUE_FLOAT"}


@pytest.mark.parametrize(
    ("output_mode", "mode"),
    [(OutputMode.DRY_RUN, GUIDED), (OutputMode.FLY, LOITER)],
    ids=["in a dry run", "before the flight"],
)
def test_interrupt_before_engagement_sends_no_setpoint(output_mode, mode):
    rig = Rig(output_mode=output_mode).run(5.0, mode=mode)
    rig.pilot.interrupt(rig.now, "SIGINT")
    assert rig.run(1.0).pilot.done
    assert rig.setpoints() == [] and rig.pilot.last_frames(rig.now) == b""


# --- the mission's own bounds, and another companion


@pytest.mark.parametrize(
    "apart", [False, True], ids=["frames echoed by router", "first frame echoed on ranging link"]
)
def test_echo_of_own_frames_is_not_another_companion(apart):
    rig = Rig(*(["ranging.endpoint=udpin:127.0.0.1:14560"] if apart else []))

    def echo():
        rig.pilot.receive(
            rig.pilot.hello(rig.now) if apart else rig.raw[-1] if rig.raw else b"",
            rig.now,
            rig.source,
        )

    rig.run(20.0, echo)
    assert rig.pilot.session.identity.ignored["twin"] == 0
    assert rig.pilot.session.identity.ignored["echo"] >= 15
    assert rig.pilot.mission.phase is (Phase.WAIT_RANGING if apart else Phase.ENGAGED)


def battery(percent):
    return mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 100, percent, 0, 0, 0, 0, 0, 0)


def reported(rig, *messages):
    return lambda: [rig.receive(message) for message in messages if message is not None]


@pytest.mark.parametrize(
    ("bound", "inside", "beyond", "message", "reason"),
    [
        ("max_range_m=200.0", 19000, 21000, None, "range 2.* m is farther than 200.0 m"),
        ("min_range_m=80.0", 8500, 7500, None, "range 7.* m is nearer than 80.0 m"),
        ("min_battery_percent=20.0", 15000, 15000, battery(19), "battery 19 % is below 20 %"),
        ("max_altitude_m=120.0", 15000, 15000, vfr_hud(121.0), "altitude 121.0 m is above 120.0 m"),
    ],
)
def test_exceeded_bound_prevents_engagement_and_ends_flight(bound, inside, beyond, message, reason):
    rig = Rig(f"bounds.{bound}", "engage.request_mode=true")
    good = (battery(20), vfr_hud(119.0))
    rig.run(5.0, reported(rig, *good, message), range_cm=beyond, mode=LOITER)
    assert rig.commands(mavlink.MAV_CMD_DO_SET_MODE) == rig.setpoints() == []
    assert re.fullmatch(rf"\[bounds\]: {reason}", waits_for(rig.pilot, rig.now))
    rig.run(5.0, reported(rig, *good), range_cm=inside, mode=GUIDED)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    rig.run(3.0, reported(rig, *good, message), range_cm=beyond)
    assert re.fullmatch(reason, rig.pilot.mission.outcome.reason)


@pytest.mark.parametrize(
    ("bound", "told", "unknown", "needs"),
    [
        ("min_battery_percent=20.0", battery(50), battery(-1), "no battery in SYS_STATUS"),
        ("min_battery_percent=20.0", battery(50), None, "no battery in SYS_STATUS"),
        ("min_altitude_m=20.0", vfr_hud(100.0), None, "no altitude above sea level"),
    ],
)
def test_bound_needs_reported_value_before_and_during_engagement(bound, told, unknown, needs):
    rig = Rig(f"bounds.{bound}")
    assert rig.run(3.0, lambda: unknown and rig.receive(unknown)).setpoints() == []
    assert waits_for(rig.pilot, rig.now).startswith(f"{needs}: bounds.min_")
    assert rig.run(2.0, lambda: rig.receive(told)).setpoints()
    assert f"circnav: {needs}" not in rig.texts()
    assert f"circnav: {needs}" in rig.run(6.0, lambda: unknown and rig.receive(unknown)).texts()
    assert rig.pilot.mission.phase is Phase.ENGAGED
    assert rig.pilot.conditions.alarms["bound_not_watched"].startswith(
        f"BOUND NOT CHECKED: {needs}"
    )
    assert "circnav: bounds checked again" in rig.run(1.0, lambda: rig.receive(told)).texts()
