"""Whose the vehicle is: between two steps, on the ground, blind, after an outage, beside other vehicles."""

from dataclasses import replace
from random import Random

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import RANGING, OutputMode
from circnav_mav.pilot.mission_state import Phase

GUIDED, LOITER, LAND, RTL = 4, 5, 9, 6
ON_GROUND, IN_AIR = 1, 2
SET_MODE = 176
SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"
PX4_OFFBOARD, PX4_LOITER, PX4_MANUAL, PX4_ALTCTL = 6 << 16, 4 << 16 | 3 << 24, 1 << 16, 2 << 16


# --- a takeover that has come and gone before the next step ---


@pytest.mark.parametrize("end", [True, False])
@pytest.mark.parametrize("how", ["mode", "arming", "mode told by CURRENT_MODE"])
def test_a_takeover_that_came_and_went_between_two_steps_counts(make_rig, say, how, end):
    rig = make_rig(end_on_takeover=end).engage()
    since = rig.now
    rig.pass_time(0.05)
    if how == "mode told by CURRENT_MODE":
        rig.hear(mavlink.MAVLink_current_mode_message(0, LOITER, 0))
    else:
        rig.hear(say.heartbeat(*((LOITER,) if how == "mode" else (GUIDED,)), armed=how == "mode"))
    rig.hear(say.heartbeat(GUIDED))
    rig.range()
    rig.step()
    assert rig.setpoints(since) == []
    assert rig.pilot.phase is (Phase.ENDED if end else Phase.YIELDED)
    if end:
        assert rig.pilot.outcome.reason.startswith("vehicle disarmed" if how == "arming" else "GUIDED left for LOITER")


def test_a_mode_that_was_left_and_entered_again_between_two_steps_hands_the_vehicle_over(make_rig, say):
    rig = make_rig(end_on_takeover=False).engage()
    rig.hear(say.heartbeat(LOITER))
    rig.hear(say.heartbeat(GUIDED))
    since = rig.now
    rig.run(1.4)
    assert rig.setpoints(since) == []
    rig.run(0.6)
    assert rig.pilot.phase is Phase.ENGAGED


def test_a_switch_that_passes_through_the_guided_mode_gives_nothing_back(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    rig.mode = LOITER
    rig.run(1.0)
    since = rig.now
    rig.mode = GUIDED
    rig.run(1.25)
    rig.mode = LOITER
    rig.run(1.0)
    assert rig.setpoints(since) == []


def test_a_silence_in_the_guided_mode_gives_nothing_back(make_rig):
    """The switch may have gone on in it."""
    rig = make_rig(end_on_takeover=False).engage()
    rig.mode = LOITER
    rig.run(1.0)
    since = rig.now
    rig.mode = GUIDED
    rig.run(1.0)
    rig.speaks = False
    rig.run(2.5)
    rig.speaks, rig.mode = True, LOITER
    rig.run(1.0)
    assert rig.setpoints(since) == []
    rig.mode = GUIDED
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_what_was_given_back_and_cannot_be_steered_yet_may_be_taken_again(make_rig):
    """Given back on the ground; then a switch passes through the guided mode in the air."""
    rig = make_rig(end_on_takeover=False).engage()
    rig.mode, rig.landed_state = LAND, ON_GROUND
    rig.run(3.0)
    rig.mode = GUIDED
    rig.run(3.0)
    assert rig.pilot.waits_for(rig.now) == "the vehicle is on the ground"
    rig.mode, rig.landed_state = LOITER, IN_AIR
    rig.run(3.0)
    since = rig.now
    rig.mode = GUIDED
    rig.run(1.0)
    rig.mode = LOITER
    rig.run(1.0)
    assert rig.setpoints(since) == []
    rig.mode = GUIDED
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


@pytest.mark.parametrize("offset", [20, 60, 100, 150, 200, 250])
def test_a_second_way_of_the_same_vehicle_whose_words_come_late_gives_nothing_back(make_rig, voice, say, offset):
    """A heartbeat a second by each way, with counters of their own; the second way takes 1.2 s."""
    rig, late = make_rig(end_on_takeover=False), voice(1, 1)
    for _ in range(offset):
        late.say(say.heartbeat(GUIDED))
    rig.engage()
    rig.speaks, left = False, rig.now + 3.0
    for step in range(200):
        if step % 20 == 0:
            rig.hear(say.heartbeat(LOITER if rig.now >= left else GUIDED))
        if step % 20 == 4:
            rig.hear(say.heartbeat(LOITER if rig.now - 1.2 >= left else GUIDED), voice=late)
        rig.run(0.05)
    assert rig.setpoints(left + 0.05) == []
    assert rig.pilot.phase is Phase.YIELDED


def test_a_vehicle_that_was_disarmed_for_a_moment_is_not_ours_again(make_rig, say):
    rig = make_rig(end_on_takeover=False).engage()
    rig.hear(say.heartbeat(GUIDED, armed=False))
    rig.hear(say.heartbeat(GUIDED))
    since = rig.now
    rig.run(5.0)
    assert rig.pilot.phase is Phase.YIELDED
    assert rig.setpoints(since) == []


# --- on the ground, and blind ---


def test_a_vehicle_that_has_landed_meanwhile_is_not_engaged_again_before_it_flies(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    rig.mode = LAND
    rig.run(5.0)
    rig.landed_state, rig.armed = ON_GROUND, False
    rig.run(5.0)
    since = rig.now
    rig.mode, rig.armed = GUIDED, True
    rig.run(5.0)
    assert rig.setpoints(since) == []
    assert rig.pilot.waits_for(rig.now) == "the vehicle is on the ground"
    rig.landed_state = IN_AIR
    rig.run(2.0)
    assert rig.setpoints(since) != []


def test_after_a_lost_link_a_vehicle_that_does_not_say_whether_it_flies_is_flown_on_at_once(make_rig):
    rig = make_rig().engage()
    rig.speaks = False
    rig.run(5.0)
    assert rig.pilot.phase is Phase.WAIT_LINK
    rig.speaks, rig.landed_state = True, None
    rig.run(1.0)
    assert rig.pilot.phase is Phase.ENGAGED


def px4(make_rig, kind, mode, **changes):
    rig = make_rig(autopilot="px4", kind=kind, request_mode=False, **changes)
    rig.mode = mode
    beat = 1 if kind.startswith("plane") else 2

    def heartbeat():
        state = 128 | 1 if rig.armed else 1
        rig.hear(mavlink.MAVLink_heartbeat_message(beat, 12, state, rig.mode, 4, 3))
        rig.hear(mavlink.MAVLink_extended_sys_state_message(0, rig.landed_state))
        rig.hear(mavlink.MAVLink_vfr_hud_message(15.0, 15.0, 0, 50, 100.0, 0.0))

    rig.heartbeat = heartbeat
    return rig


KINDS = [
    ("copter", "SET_POSITION_TARGET_LOCAL_NED"),
    ("plane", "MANUAL_CONTROL"),
    ("plane attitude", "SET_ATTITUDE_TARGET"),
]


@pytest.mark.parametrize(("kind", "message"), KINDS)
def test_nothing_is_streamed_to_a_px4_on_the_ground(make_rig, kind, message):
    rig = px4(make_rig, kind, PX4_LOITER)
    rig.landed_state = ON_GROUND
    rig.run(5.0)
    assert rig.of(message) == []
    rig.landed_state = IN_AIR
    rig.run(5.0)
    assert rig.of(message) != []


@pytest.mark.parametrize("mode", [PX4_MANUAL, 3 << 16, 7 << 16, 11 << 16])
def test_no_stick_is_streamed_to_a_px4_plane_that_its_pilot_flies_by_stick(make_rig, mode):
    rig = px4(make_rig, "plane", mode)
    rig.run(5.0)
    assert rig.pilot.phase is Phase.READY
    assert rig.of("MANUAL_CONTROL") == []


def test_a_vehicle_that_stopped_telling_what_it_must_is_not_engaged(make_rig):
    rig = px4(make_rig, "copter", PX4_LOITER)
    rig.run(5.0)
    assert rig.pilot.phase is Phase.READY
    tell = rig.heartbeat

    def silent_about_height():
        rig.hear(mavlink.MAVLink_heartbeat_message(2, 12, 129, rig.mode, 4, 3))

    rig.heartbeat = silent_about_height
    rig.run(5.0)
    rig.mode = PX4_OFFBOARD
    rig.run(5.0)
    assert rig.pilot.phase is Phase.READY
    assert "no altitude in VFR_HUD" in rig.pilot.waits_for(rig.now)
    rig.heartbeat = tell
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


# --- the exit action ---


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


def test_the_last_words_ask_for_the_exit_action(make_rig, say):
    rig = make_rig(exit="rtl").engage()
    safe, command = say.decode(rig.pilot.last_words(rig.now))
    assert (safe.vx, safe.yaw_rate) == (0.0, 0.0)
    assert (command.command, command.param2) == (SET_MODE, RTL)
    rig.mode = LOITER
    rig.run(1.0)
    assert rig.pilot.last_words(rig.now) == b""


def test_an_outage_before_a_takeover_does_not_end_the_mission_that_waits(make_rig):
    rig = make_rig(end_on_takeover=False).engage()
    rig.speaks = False
    rig.run(5.0)
    rig.speaks, rig.mode = True, LOITER
    rig.run(100.0)
    assert rig.pilot.outcome is None and rig.pilot.phase is Phase.YIELDED


# --- beside others ---


def test_ranges_of_another_vehicle_steer_nobody(make_rig, voice, say):
    rig, other = make_rig().run(0.5), voice(system=2)
    for _ in range(200):
        rig.hear(say.heartbeat(GUIDED), voice=other)
        rig.hear(say.distance(4000, 1_000_000 + round(rig.now * 1000)), voice=other)
        rig.run(0.05)
    assert rig.pilot.tracker.newest.r == pytest.approx(150.0)
    assert rig.pilot.tracker.ranging.rejected["wrong_source"] >= 150


def test_a_radio_of_the_missions_component_on_another_vehicle_is_not_ours(make_rig, voice, say):
    ranging = replace(say.mission.ranging, component=192)
    rig, ours, theirs = make_rig(ranging=ranging), voice(1, 192), voice(2, 192)
    rig.ranges, heard = False, []
    rig.run(0.5)
    for _ in range(200):
        rig.hear(say.heartbeat(GUIDED), voice=voice(2, 1))
        rig.hear(say.distance(4000, 1_000_000 + round(rig.now * 1000)), voice=theirs)
        rig.hear(say.distance(15000, 1_000_000 + round(rig.now * 1000)), voice=ours)
        rig.run(0.05)
        heard += [rig.pilot.tracker.newest.r] if rig.pilot.tracker.newest and rig.now > 2.0 else []
    assert set(heard) == {150.0}


def test_a_radio_that_takes_the_place_of_another_before_the_flight_has_a_clock_of_its_own(make_rig, voice, say):
    rig, other = make_rig(), voice(system=77, component=192)
    rig.mode, rig.ranges = LOITER, False
    for _ in range(40):
        rig.run(0.05)
        rig.hear(say.distance(4000, 500_000 + round(rig.now * 1000)), voice=other)
    rig.run(6.0)
    rig.ranges = True
    rig.run(0.5)
    assert rig.pilot.tracker.newest.r == pytest.approx(150.0)
    assert not rig.pilot.tracker.ranging.rejected


def test_nobody_stands_in_for_a_radio_that_falls_silent_in_flight(make_rig, voice, say):
    rig, other = make_rig().engage(), voice(system=77, component=192)
    rig.ranges, since = False, rig.now
    for _ in range(180):
        rig.hear(say.distance(4000, 1_000_000 + round(rig.now * 1000)), voice=other)
        rig.run(0.05)
    assert rig.pilot.phase is Phase.HOLDING
    assert rig.pilot.tracker.newest.time <= since


def test_our_own_hello_heard_back_is_no_other_companion(make_rig):
    rig = make_rig(ranging_apart=True)
    for _ in range(400):
        rig.run(0.05)
        hello = rig.pilot.hello(rig.now)
        if hello:
            rig.pilot.receive(hello, rig.now, rig.source)
    assert rig.pilot.session.ignored["twin"] == 0
    assert rig.pilot.session.ignored["echo"] >= 15


def test_a_dry_run_needs_no_leave_and_keeps_no_radio(make_rig, voice, say):
    rig, other = make_rig(output_mode=OutputMode.DRY_RUN).engage(), voice(system=77, component=192)
    rig.ranges = False
    for _ in range(180):
        rig.hear(say.distance(4000, 1_000_000 + round(rig.now * 1000)), voice=other)
        rig.run(0.05)
    assert rig.pilot.tracker.newest.r == pytest.approx(40.0)


# --- ranges that are none ---


@pytest.mark.parametrize("accuracy_mm", [80_000, 4_294_967_294])
def test_a_range_that_says_it_may_be_anywhere_is_not_taken(make_rig, say, accuracy_mm):
    ranging = replace(say.mission.ranging, message="ranging_beacon", max_sigma=50.0)
    rig = make_rig(ranging=ranging, ranging_apart=True)
    for i in range(100):
        rig.run(0.1)
        rig.hear(say.beacon(150_000, 1_000_000 + i * 100_000, i, range_accuracy=accuracy_mm), link=RANGING)
    assert rig.pilot.tracker.accepted == 0
    assert rig.pilot.tracker.ranging.rejected["too_noisy"] == 100


@pytest.mark.parametrize(
    ("round_trip", "believed"), [(0.0, pytest.approx(2.7, abs=0.15)), (None, pytest.approx(2.7, abs=0.15)), (2.0, None)]
)
def test_ranges_that_stay_late_are_of_a_clock_that_stood_still_unless_the_answers_are_as_late(
    make_rig, say, round_trip, believed
):
    """Silent for 2 s, and as late from then on. A vehicle that never answered TIMESYNC tells nothing."""
    rig = make_rig()
    rig.round_trip = 0.0 if round_trip is not None else None
    rig.run(15.0)
    rig.round_trip = round_trip
    rig.ranges, since = False, rig.now
    rig.run(2.0)
    behind = None
    for _ in range(120):
        rig.run(0.05)
        if rig.tick % 2 == 0:
            rig.hear(say.distance(15000, 1_000_000 + round((rig.now - 2.0) * 1000)))
        if behind is None and rig.pilot.tracker.newest.time > since + 0.1:
            behind = rig.now - since
    assert behind == believed
    assert rig.pilot.tracker.ranging.rejected["clock"] >= 4
    assert bool(rig.pilot.tracker.ranging.rejected["too_old"] > 10) == (believed is None)


def test_ranges_that_scatter_over_half_the_radius_are_lost_ranges(make_rig, say):
    """The measured scatter is no standard deviation to fly by."""
    rng = Random(3)
    rig = make_rig(ranging=replace(say.mission.ranging, max_sigma=50.0), exit="rtl").engage()
    rig.ranges, since = False, rig.now
    for _ in range(600):
        rig.run(0.05)
        if rig.tick % 2 == 0:
            rig.range(cm=rng.randrange(3000, 60000))
    steered = [time for time, _ in rig.sent if time > since + 1.0 and _.get_type() == SETPOINT and _.vx > 0]
    assert rig.pilot.outcome is not None and rig.pilot.outcome.reason.startswith("no range for")
    assert steered and steered[-1] - since < 15.0


def test_ranges_without_an_estimate_name_the_estimator(make_rig):
    rig = make_rig(estimator="drift").run(10.0)
    assert "estimator drift has not converged" in rig.pilot.waits_for(rig.now)


# --- who is a vehicle ---


def radio_heartbeat(autopilot):
    return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GENERIC, autopilot, 0, 0, 4, 3)


@pytest.mark.parametrize(
    ("component", "autopilot"),
    [
        (192, mavlink.MAV_AUTOPILOT_INVALID),
        (192, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
        (1, mavlink.MAV_AUTOPILOT_GENERIC),
        (1, mavlink.MAV_AUTOPILOT_INVALID),
    ],
)
def test_a_radio_that_has_a_system_and_a_heartbeat_of_its_own_is_no_vehicle(make_rig, voice, say, component, autopilot):
    rig, radio = make_rig(), voice(42, component)
    rig.ranges = False
    rig.run(0.5)
    for i in range(200):
        if i % 20 == 0:
            rig.hear(radio_heartbeat(autopilot), voice=radio)
        if i % 2:
            rig.hear(say.distance(15000, 1_000_000 + round(rig.now * 1000)), voice=radio)
        rig.run(0.05)
    assert rig.pilot.phase is Phase.ENGAGED


def test_a_vehicle_with_the_system_of_our_radio_does_not_take_it_from_us_in_flight(make_rig, voice, say):
    rig, radio, other = make_rig(), voice(42, 192), voice(42, 1)
    rig.ranges = False
    rig.run(0.5)
    for i in range(600):
        if i > 200 and i % 5 == 0:
            rig.hear(say.heartbeat(GUIDED), voice=other)
        if i % 2:
            rig.hear(say.distance(15000, 1_000_000 + round(rig.now * 1000)), voice=radio)
        rig.run(0.05)
    assert rig.pilot.phase is Phase.ENGAGED


def test_after_a_takeover_another_radio_may_take_the_place_of_ours(make_rig, voice, say):
    rig, other = make_rig(end_on_takeover=False).engage(), voice(system=77, component=192)
    rig.mode, rig.ranges = LOITER, False
    rig.run(6.0)
    rig.mode = GUIDED
    for i in range(100):
        if i % 2:
            rig.hear(say.distance(15000, 1_000_000 + round(rig.now * 1000)), voice=other)
        rig.run(0.05)
    assert rig.pilot.phase is Phase.ENGAGED


# --- stalls, outages and crashes ---


def test_what_is_read_in_the_turns_after_a_stall_may_be_from_before(make_rig, say):
    """A backlog takes several turns to read: the takeover may come last."""
    rig = make_rig().engage()
    rig.pass_time(6.0)
    since = rig.now
    rig.hear(say.heartbeat(GUIDED))
    rig.step()
    for _ in range(3):  # the next turns, milliseconds later
        rig.now += 0.002
        rig.hear(say.heartbeat(GUIDED))
        rig.range()
        rig.step()
    rig.now += 0.002
    rig.mode = LOITER
    rig.heartbeat()
    rig.run(0.2)
    assert rig.setpoints(since - 1e-9) == []
    assert rig.pilot.outcome.reason.startswith("GUIDED left for LOITER")


def test_leaving_ends_although_every_heartbeat_comes_with_a_stall(make_rig):
    rig = make_rig(exit="rtl").engage()
    rig.pilot.interrupt(rig.now, "SIGTERM")
    for _ in range(40):
        rig.pass_time(0.6)
        rig.heartbeat()
        rig.step()
    assert rig.pilot.done


@pytest.mark.parametrize("how", ["mode", "arming"])
def test_a_takeover_that_came_and_went_in_an_outage_counts(make_rig, say, how):
    rig = make_rig().engage()
    rig.speaks = rig.ranges = False
    rig.run(5.0)
    assert rig.pilot.phase is Phase.WAIT_LINK
    since = rig.now
    rig.hear(say.heartbeat(*((LOITER,) if how == "mode" else (GUIDED,)), armed=how == "mode"))
    rig.hear(say.heartbeat(GUIDED))
    rig.speaks = rig.ranges = True
    rig.run(5.0)
    assert rig.setpoints(since) == []
    assert rig.pilot.outcome.reason.startswith("vehicle disarmed" if how == "arming" else "GUIDED left for LOITER")


@pytest.mark.parametrize("end", [True, False])
def test_a_takeover_that_came_and_went_before_the_vehicle_was_known_again_counts(make_rig, say, end):
    """After an outage the mode is told first, and the time since boot, which proves the vehicle, a little later."""
    rig = make_rig(end_on_takeover=end)
    rig.run(1.0)
    rig.hear(mavlink.MAVLink_attitude_message(round(rig.now * 1000), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    rig.engage()
    rig.speaks = rig.ranges = False
    rig.run(5.0)
    rig.ranges, since = True, rig.now
    for mode in (LOITER, GUIDED, GUIDED):
        assert rig.pilot.phase is Phase.WAIT_LINK
        rig.hear(say.heartbeat(mode))
        rig.run(0.25)
        if rig.pilot.done:
            break
    rig.hear(mavlink.MAVLink_attitude_message(round(rig.now * 1000), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    rig.run(0.5)
    assert rig.setpoints(since) == []
    assert (rig.pilot.outcome is not None) is end
    if end:
        assert rig.pilot.outcome.reason.startswith("GUIDED left for LOITER")


@pytest.mark.parametrize("seconds", [0.6, 5.0])
def test_the_last_words_ask_for_no_mode_when_the_vehicle_may_be_in_other_hands(make_rig, say, seconds):
    rig = make_rig(exit="rtl").engage()
    rig.pass_time(seconds)
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


@pytest.mark.parametrize(("kind", "message"), KINDS)
def test_a_px4_that_stopped_telling_what_it_must_is_streamed_nothing(make_rig, kind, message):
    rig = px4(make_rig, kind, PX4_LOITER)
    rig.run(5.0)
    assert rig.of(message) != []
    rig.heartbeat = lambda: rig.hear(
        mavlink.MAVLink_heartbeat_message(1 if "plane" in kind else 2, 12, 129, rig.mode, 4, 3)
    )
    rig.run(3.0)
    since = rig.now
    rig.mode = PX4_ALTCTL if kind == "plane" else PX4_OFFBOARD
    rig.run(3.0)
    assert rig.of(message, since) == []


def test_an_airspeed_that_cannot_be_is_told_once_and_only_of_a_vehicle_that_we_steer(make_rig):
    rig = px4(make_rig, "plane", PX4_LOITER)
    tell = rig.heartbeat

    def lies():
        tell()
        rig.hear(mavlink.MAVLink_vfr_hud_message(2.0, 15.0, 0, 50, 100.0, 0.0))
        rig.hear(mavlink.MAVLink_attitude_message(round(rig.now * 1000), 0.0, 0.0, 0.1 * rig.now, 0.0, 0.0, 0.1))

    rig.heartbeat = lies
    rig.run(10.0)
    assert [text for text in rig.texts() if "airspeed" in text] == []
    rig.mode = PX4_ALTCTL
    rig.run(10.0)
    assert rig.pilot.phase is Phase.ENGAGED
    assert [text for text in rig.texts() if "airspeed" in text] == ["circnav: airspeed 2.0 m/s implausible, ignored"]
