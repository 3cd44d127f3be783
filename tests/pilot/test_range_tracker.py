"""Whose ranges count, which are none, and what their delay does."""

from dataclasses import replace
from random import Random

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import RANGING, OutputMode, Phase

GUIDED, LOITER = 4, 5


# --- of others ---


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
    assert set(heard) <= {150.0, 150.01}


def test_a_radio_that_takes_the_place_of_another_before_the_flight_has_a_clock_of_its_own(make_rig, voice, say):
    rig, other = make_rig(), voice(system=77, component=192)
    rig.mode, rig.ranges = LOITER, False
    for _ in range(40):
        rig.run(0.05)
        rig.hear(say.distance(4000, 500_000 + round(rig.now * 1000)), voice=other)
    rig.run(6.0)
    rig.ranges = True
    rig.run(0.5)
    assert rig.pilot.tracker.newest.r == pytest.approx(150.0, abs=0.02)
    assert not rig.pilot.tracker.ranging.rejected


def test_nobody_stands_in_for_a_radio_that_falls_silent_in_flight(make_rig, voice, say):
    rig, other = make_rig().engage(), voice(system=77, component=192)
    rig.ranges, since = False, rig.now
    for _ in range(180):
        rig.hear(say.distance(4000, 1_000_000 + round(rig.now * 1000)), voice=other)
        rig.run(0.05)
    assert rig.pilot.phase is Phase.HOLDING
    assert rig.pilot.tracker.newest.time <= since


def test_a_dry_run_needs_no_leave_and_keeps_no_radio(make_rig, voice, say):
    rig, other = make_rig(output_mode=OutputMode.DRY_RUN).engage(), voice(system=77, component=192)
    rig.ranges = False
    for _ in range(180):
        rig.hear(say.distance(4000, 1_000_000 + round(rig.now * 1000)), voice=other)
        rig.run(0.05)
    assert rig.pilot.tracker.newest.r == pytest.approx(40.0, abs=0.02)


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


# --- ranges that are none ---


def rig_range(rig, cm, stamp_ms):
    return mavlink.MAVLink_distance_sensor_message(stamp_ms, 20, 60000, cm, 4, 0, 24, 0)


def test_a_repeated_range_is_not_a_fresh_one(rig):
    """The same stamp again and again: stale after half a second."""
    rig.engage()
    rig.ranges = False
    for _ in range(20):
        rig.run(0.05)
        rig.hear(rig_range(rig, 15000, stamp_ms=1_003_000))
    assert rig.pilot.phase is Phase.HOLDING


def test_an_outlier_is_counted_and_moves_nothing(make_rig):
    steady, disturbed = make_rig().engage(), make_rig().engage()
    steady.ranges = disturbed.ranges = False
    disturbed.now = steady.now = round(steady.now + 0.02, 6)
    disturbed.hear(rig_range(disturbed, 40000, stamp_ms=1_000_000 + round(disturbed.now * 1000)))
    steady.run(0.3)
    disturbed.run(0.3)
    assert disturbed.pilot.tracker.ranging.rejected["gated"] == 1
    assert disturbed.pilot.tracker.accepted == steady.pilot.tracker.accepted
    rates = [[m.yaw_rate for m in rig.setpoints(3.02)] for rig in (steady, disturbed)]
    assert rates[0] == pytest.approx(rates[1], abs=2e-3)


def test_a_jump_of_the_sensors_clock_starts_the_estimate_anew(rig):
    rig.engage()
    rig.ranges = False
    for i in range(30):
        rig.run(0.1)
        rig.hear(rig_range(rig, 15000, stamp_ms=5_000 + 100 * i))
    assert rig.pilot.tracker.ranging.rejected["stamp_jump"] == 2
    assert rig.pilot.phase is Phase.ENGAGED


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
    steered = [time for time, sent in rig.sent if time > since + 1.0 and getattr(sent, "vx", 0) > 0]
    assert rig.pilot.outcome is not None and rig.pilot.outcome.reason.startswith("no range for")
    assert steered and steered[-1] - since < 15.0


def test_ranges_without_an_estimate_name_the_estimator(make_rig):
    rig = make_rig(estimator="drift").run(10.0)
    assert "estimator drift has not converged" in rig.pilot.waits_for(rig.now)


# --- delay ---


def test_a_link_that_gets_slower_in_flight_than_ranges_may_be_old_is_a_lost_range(make_rig):
    """Stamps cannot show a constant delay; answers to TIMESYNC do."""
    rig = make_rig(exit="rtl").engage()
    rig.round_trip = 2.0
    rig.run(6.0)
    assert rig.pilot.session.timesync.typical == pytest.approx(2.0)
    assert rig.pilot.phase is Phase.HOLDING
    rig.run(10.0)
    assert rig.pilot.outcome.reason.startswith("no range for")


def test_a_link_that_gets_slow_within_what_ranges_may_be_old_is_no_reason_to_let_the_vehicle_go(make_rig, say):
    ranging = replace(say.mission.ranging, max_age=1.5)
    rig = make_rig(ranging=ranging, timing=replace(say.mission.timing, stale=1.5)).engage()
    rig.round_trip = 2.0
    rig.run(20.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_the_delay_of_the_vehicles_link_is_not_that_of_a_radio_with_a_link_of_its_own(make_rig, say):
    rig = make_rig(ranging_apart=True)
    rig.ranges = False
    for _ in range(400):
        rig.run(0.05)
        if rig.tick % 2 == 0:
            rig.hear(say.distance(15000, 1_000_000 + round(rig.now * 1000)), link=RANGING)
        rig.round_trip = 2.0 if rig.pilot.engaged_at is not None else 0.0
    assert rig.pilot.session.timesync.typical == pytest.approx(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


# --- a link of its own ---


def test_ranging_of_another_link_is_taken_from_there_and_from_nowhere_else(make_rig):
    rig = make_rig(ranging_apart=True)
    rig.run(3.0)
    assert rig.pilot.tracker.accepted == 0, "ranges on the vehicle's link are not the mission's"
    rig.ranges = False
    for _ in range(30):
        rig.run(0.1)
        rig.hear(rig_range(rig, 15000, 1_000_000 + round(rig.now * 1000)), link="ranging", source="radio")
    assert rig.pilot.phase is Phase.ENGAGED


def test_a_ranging_link_is_greeted_once_a_second(make_rig, say):
    rig = make_rig(ranging_apart=True)
    hellos = [message for i in range(61) for message in say.decode(rig.pilot.hello(i / 20))]
    assert [message.get_type() for message in hellos] == ["HEARTBEAT"] * 4


def test_a_vehicle_on_the_ranging_link_moves_nothing(make_rig, say):
    rig = make_rig(ranging_apart=True)
    rig.speaks = rig.ranges = False
    for _ in range(20):
        rig.run(0.1)
        rig.hear(say.heartbeat(4), link="ranging", source="radio")
    assert rig.pilot.phase is Phase.WAIT_LINK


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
