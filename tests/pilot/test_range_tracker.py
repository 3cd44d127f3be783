"""Whose ranges count, which are none, and what their delay does."""

from dataclasses import replace
from random import Random

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import RANGING, OutputMode, Phase
from tests.rig import MISSION, Rig, Voice, beacon, decode, distance, heartbeat, scattering, timing

GUIDED, LOITER = 4, 5


def ranging(**changes):
    """The ranging of the bench's mission, with changes."""
    return replace(MISSION.ranging, **changes)


# --- of others ---


def test_a_radio_of_the_missions_component_on_another_vehicle_is_not_ours():
    rig, heard = Rig(ranging=ranging(component_id=192)), []
    ours, theirs, their_vehicle = Voice(1, 192), Voice(2, 192), Voice(2, 1)
    rig.run(0.5, ranges=False)

    def both_radios():
        rig.hear(heartbeat(GUIDED), voice=their_vehicle)
        rig.range(4000, voice=theirs)
        rig.range(15000, voice=ours)
        heard.append(rig.pilot.tracker.newest)

    rig.run(5.0, both_radios)
    assert {sample.r for sample in heard if sample and sample.time > 2.0} <= {150.0, 150.01}
    assert heard[-1].time > rig.now - 0.2


def test_a_radio_that_takes_the_place_of_another_before_the_flight_has_a_clock_of_its_own(rig):
    other = Voice(system=77, component=192)
    for _ in range(40):
        rig.run(0.05, mode=LOITER, ranges=False)
        rig.hear(scattering(4000, 500_000 + round(rig.now * 1000)), voice=other)
    rig.run(6.0).run(0.5, ranges=True)
    assert rig.pilot.tracker.newest.r == pytest.approx(150.0, abs=0.02)
    assert not rig.pilot.tracker.ranging.rejected


@pytest.mark.parametrize("output_mode", [OutputMode.FLY, OutputMode.DRY_RUN])
def test_nobody_stands_in_for_a_radio_that_falls_silent_in_flight(output_mode):
    """In a dry run, which keeps no radio, somebody may."""
    rig, other = Rig(output_mode=output_mode).engage(), Voice(system=77, component=192)
    since = rig.now
    rig.run(9.0, lambda: rig.range(4000, voice=other), ranges=False)
    newest = rig.pilot.tracker.newest
    if output_mode is OutputMode.FLY:
        assert rig.pilot.mission.phase is Phase.HOLDING and newest.time <= since
    else:
        assert newest.r == pytest.approx(40.0, abs=0.02)


GENERIC, INVALID, ARDUPILOT = 0, 8, 3
"""Members of MAV_AUTOPILOT."""


@pytest.mark.parametrize(
    ("radio", "speaker", "autopilot", "begins"),
    [
        (192, 192, INVALID, 0.0),
        (192, 192, ARDUPILOT, 0.0),
        (1, 1, GENERIC, 0.0),
        (1, 1, INVALID, 0.0),
        (192, 1, ARDUPILOT, 5.0),
    ],
    ids=["invalid", "autopilot", "generic as 1", "invalid as 1", "a vehicle of the same system, in flight"],
)
def test_a_heartbeat_of_our_radios_system_does_not_take_its_ranges_from_us(rig, radio, speaker, autopilot, begins):
    radio, speaker = Voice(42, radio), Voice(42, speaker)
    rig.run(0.5, ranges=False)

    def speaks():
        if rig.now > begins and rig.tick % 5 == 0:
            rig.hear(heartbeat(kind=2 if begins else 0, autopilot=autopilot), voice=speaker)
        if rig.tick % 2:
            rig.range(voice=radio)

    assert rig.run(15.0 if begins else 5.0, speaks).pilot.mission.phase is Phase.ENGAGED


# --- ranges that are none ---


def test_an_outlier_is_counted_and_moves_nothing():
    steady, disturbed = Rig().engage(), Rig().engage()
    disturbed.now = steady.now = round(steady.now + 0.02, 6)
    disturbed.range(40000)
    for rig in (steady, disturbed):
        rig.run(0.3, ranges=False)
    assert disturbed.pilot.tracker.ranging.rejected["gated"] == 1
    assert disturbed.pilot.tracker.accepted == steady.pilot.tracker.accepted
    rates = [[m.yaw_rate for m in rig.setpoints(3.02)] for rig in (steady, disturbed)]
    assert rates[0] == pytest.approx(rates[1], abs=2e-3)


def test_a_jump_of_the_sensors_clock_starts_the_estimate_anew(rig):
    rig.engage()
    for i in range(30):
        rig.run(0.1, ranges=False).hear(distance(15000, 5_000 + 100 * i))
    assert rig.pilot.tracker.ranging.rejected["stamp_jump"] == 2
    assert rig.pilot.mission.phase is Phase.ENGAGED


@pytest.mark.parametrize("accuracy_mm", [80_000, 4_294_967_294])
def test_a_range_that_says_it_may_be_anywhere_is_not_taken(accuracy_mm):
    rig = Rig(ranging=ranging(message="ranging_beacon", max_sigma=50.0), ranging_apart=True)
    for i in range(100):
        message = beacon(150_000, 1_000_000 + i * 100_000, i, range_accuracy=accuracy_mm)
        rig.run(0.1).hear(message, link=RANGING)
    assert rig.pilot.tracker.accepted == 0
    assert rig.pilot.tracker.ranging.rejected["too_noisy"] == 100


@pytest.mark.parametrize(
    ("round_trip", "believed"), [(0.0, pytest.approx(2.7, abs=0.15)), (None, pytest.approx(2.7, abs=0.15)), (2.0, None)]
)
def test_ranges_that_stay_late_are_of_a_clock_that_stood_still_unless_the_answers_are_as_late(round_trip, believed):
    """Silent for 2 s, and as late from then on. A vehicle that never answered TIMESYNC tells nothing."""
    rig = Rig().run(15.0, round_trip=0.0 if round_trip is not None else None)
    since = rig.now
    rig.run(2.0, round_trip=round_trip, ranges=False)
    behind = None
    for _ in range(120):
        rig.run(0.05)
        if rig.tick % 2 == 0:
            rig.hear(scattering(15000, 1_000_000 + round((rig.now - 2.0) * 1000)))
        if behind is None and rig.pilot.tracker.newest.time > since + 0.1:
            behind = rig.now - since
    assert behind == believed
    assert rig.pilot.tracker.ranging.rejected["clock"] >= 4
    assert bool(rig.pilot.tracker.ranging.rejected["too_old"] > 10) == (believed is None)


def test_ranges_that_scatter_over_half_the_radius_are_lost_ranges():
    """The measured scatter is no standard deviation to fly by."""
    draw, rig = Random(3), Rig(ranging=ranging(max_sigma=50.0), exit="rtl").engage()
    since = rig.now
    rig.run(30.0, lambda: rig.tick % 2 or rig.range(draw.randrange(3000, 60000)), ranges=False)
    steered = [time for time, sent in rig.sent if time > since + 1.0 and getattr(sent, "vx", 0) > 0]
    assert rig.pilot.mission.outcome is not None and rig.pilot.mission.outcome.reason.startswith("no range for")
    assert steered and steered[-1] - since < 15.0


def test_ranges_without_an_estimate_name_the_estimator():
    rig = Rig(estimator="drift").run(10.0)
    assert "estimator drift has not converged" in rig.pilot.status.waits_for(rig.now)


# --- delay ---


@pytest.mark.parametrize(("stale", "phase"), [(0.5, Phase.HOLDING), (1.5, Phase.ENGAGED)])
def test_a_link_that_gets_slower_in_flight_than_ranges_may_be_old_is_a_lost_range(stale, phase):
    """Stamps cannot show a constant delay; answers to TIMESYNC do."""
    rig = Rig(ranging=ranging(max_age=stale), timing=timing(stale=stale)).engage().run(8.0, round_trip=2.0)
    assert rig.pilot.session.timesync.typical == pytest.approx(2.0)
    assert rig.pilot.mission.phase is phase
    ended = rig.run(8.0).pilot.mission.outcome
    assert bool(ended and ended.reason.startswith("no range for")) is (phase is Phase.HOLDING)


def test_the_delay_of_the_vehicles_link_is_not_that_of_a_radio_with_a_link_of_its_own():
    rig = Rig(ranging_apart=True)

    def by_radio():
        if rig.tick % 2 == 0:
            rig.range(link=RANGING)

    assert rig.run(3.0, by_radio, ranges=False).pilot.mission.phase is Phase.ENGAGED
    rig.run(15.0, by_radio, round_trip=2.0)
    assert rig.pilot.session.timesync.typical == pytest.approx(2.0)
    assert rig.pilot.mission.phase is Phase.ENGAGED


# --- a link of its own ---


def test_ranging_of_another_link_is_taken_from_there_and_from_nowhere_else():
    rig = Rig(ranging_apart=True).run(3.0)
    assert rig.pilot.tracker.accepted == 0, "ranges on the vehicle's link are not the mission's"
    rig.run(3.0, lambda: rig.tick % 2 or rig.range(link=RANGING, source="radio"), ranges=False)
    assert rig.pilot.mission.phase is Phase.ENGAGED


def test_a_ranging_link_is_greeted_once_a_second():
    rig = Rig(ranging_apart=True)
    hellos = [message for i in range(61) for message in decode(rig.pilot.hello(i / 20))]
    assert [message.get_type() for message in hellos] == ["HEARTBEAT"] * 4


def test_a_vehicle_on_the_ranging_link_moves_nothing():
    rig = Rig(ranging_apart=True)
    rig.run(2.0, lambda: rig.hear(heartbeat(GUIDED), link=RANGING, source="radio"), speaks=False, ranges=False)
    assert rig.pilot.mission.phase is Phase.WAIT_LINK


def test_a_reboot_of_the_autopilot_makes_the_estimate_forget_what_came_before():
    rig = Rig(end_on_takeover=False).engage()
    rig.hear(mavlink.MAVLink_system_time_message(0, 900_000))
    rig.run(0.5).now_is(ranges=False)
    assert rig.pilot.take_records()[-1].r == pytest.approx(150.0, abs=0.5)
    for boot_ms in (2_000, 2_050):
        rig.hear(mavlink.MAVLink_system_time_message(0, boot_ms))
    assert [record.r for record in rig.run(0.05).pilot.take_records()] == [None]
    assert not rig.pilot.tracker.estimator.ready
