"""What is told of a flight: why it waits, what is wrong, how much comes in."""

from dataclasses import replace

import pytest

from circnav_mav.pilot import OutputMode
from circnav_mav.runtime.status import Watch
from tests.flight.lockstep import flight

TAKEOVER = [{"at_s": 6.0, "action": "mode", "mode": "LOITER"}]
OUTAGE = [{"at_s": 6.0, "action": "mute_ranging"}]


def during(statuses, phase):
    return [status for status in statuses if status.tick.phase.value == phase]


def test_a_flight_that_goes_well_raises_no_alarm_and_tells_its_rates(statuses):
    flown = statuses(12.0)
    assert [status.alarms for status in flown if status.alarms] == []
    last = flown[-1]
    assert last.tick.phase.value == "engaged"
    assert 9 < last.rates.taken <= 11  # 10 Hz
    assert 40 < last.rates.frames < 100
    assert last.rates.setpoints > 9
    assert last.waits == ""


def test_the_time_flown_counts_from_the_moment_of_engaging(statuses):
    told = statuses(8.0)
    flown = during(told, "engaged")
    assert [status.flown for status in told if status.time < flown[0].time] == [None] * told.index(flown[0])
    engaged = flown[0].time - flown[0].flown
    assert told[0].time < engaged <= flown[0].time
    assert [status.time - status.flown for status in flown] == pytest.approx([engaged] * len(flown))


def test_why_this_law_flies_is_told_while_it_steers_and_no_longer(statuses):
    told = statuses(9.0, 'guidance.law="auto"', events=TAKEOVER)
    assert {bool(status.why) for status in during(told, "engaged")} == {True}
    assert {status.why for status in told if status.tick.law == ""} == {""}
    assert told[-1].tick.law == ""


def test_it_says_what_it_waits_for(statuses):
    assert flight("quickstart").pilot.waits_for(0.0) == "no autopilot heartbeat, 0 bytes heard"
    assert statuses(4.0, "engage.request_mode=false")[-1].waits == "mode GUIDED: the operator must enter it"
    on_ground = ("sim.start.altitude_m=0.0", "sim.start.armed=false", 'sim.start.mode="STABILIZE"')
    assert statuses(4.0, *on_ground)[-1].waits == "the vehicle is on the ground"
    silent = statuses(4.0, "sim.ranging.rate_hz=0.0")
    assert silent[-1].waits.startswith("no ranging: no usable DISTANCE_SENSOR")


def test_a_stale_range_is_an_alarm_that_names_its_age_and_the_end(statuses):
    (*_, last) = during(statuses(10.5, events=OUTAGE), "holding")
    (alarm,) = last.alarms
    assert alarm.startswith(f"RANGE STALE {last.tick.range_age:.1f} s: ")
    assert alarm.endswith("ends at 10.5 s")
    assert last.rates.taken == 0


def test_a_takeover_is_an_alarm_and_says_how_to_hand_over_again(statuses):
    waiting = during(statuses(9.0, 'engage.on_takeover="wait"', events=TAKEOVER), "yielded")
    assert waiting[-1].alarms == ("OPERATOR HAS THE VEHICLE, mode LOITER",)
    assert waiting[-1].waits == "the operator has the vehicle: enter GUIDED again to hand it back"


def test_ranges_that_are_refused_are_counted_by_reason_and_become_an_alarm(statuses):
    refused = statuses(8.0, "ranging.max_range_m=50.0")[-1]
    assert list(refused.rejected) == ["above_max"]
    assert refused.alarms[-1].startswith("MOST RANGES REJECTED: ")


def test_a_silent_vehicle_is_an_alarm(statuses):
    silent = statuses(10.0, events=[{"at_s": 6.0, "action": "mute_autopilot"}])
    assert any(alarm.startswith("LINK SILENT for ") for status in silent for alarm in status.alarms)


def test_recording_that_stopped_is_an_alarm():
    flown = flight("quickstart").fly(6.0)
    assert Watch(flown.pilot).status(flown.ticks[-1], 6.0, "disk full").alarms == ("NOT RECORDING: disk full",)


def test_a_dry_run_would_steer_without_the_mode(statuses):
    dry = statuses(6.0, output_mode=OutputMode.DRY_RUN)[-1]
    assert (dry.phase, dry.setpoints) == ("would steer", 0)
    assert statuses(6.0)[-1].phase == "engaged"


def test_a_vehicle_that_is_gone_leaves_no_range_that_counts_down(statuses):
    gone = [{"at_s": 6.0, "action": "mute_autopilot"}, {"at_s": 6.0, "action": "mute_ranging"}]
    flown = statuses(30.0, "limits.hold_s=2.0", events=gone)
    old = [status.tick for status in flown if (status.tick.range_age or 0.0) > 2.6]
    assert old
    assert {(tick.r, tick.r_dot) for tick in old} == {(None, None)}


def test_ranges_of_other_senders_are_counted_apart_and_raise_no_alarm():
    """PX4 repeats what the radio says under its own id."""
    flown = flight("px4_copter").fly(12.0)
    status = Watch(flown.pilot).status(flown.ticks[-1], 12.0)
    assert status.others > 50
    assert "wrong_source" not in status.rejected
    assert flown.ticks[-1].rejected == sum(status.rejected.values())


def test_the_target_is_told_as_seen_from_the_vehicle_and_drift_by_where_it_goes():
    """Vehicle 30 m east and 40 m south of the target, carried north: by hand."""
    flown = flight("quickstart").fly(6.0)
    tick = replace(flown.ticks[-1], x=30.0, y=-40.0, drift_x=0.0, drift_y=2.0)
    assert Watch(flown.pilot).status(tick, 6.0).target == "bearing 323 deg, drift 2.0 m/s towards 000 deg"
