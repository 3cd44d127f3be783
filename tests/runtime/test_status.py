"""What is told of a flight: why it waits, what is wrong, how much comes in."""

import re
from dataclasses import replace

import pytest

from circnav_mav.pilot import OutputMode
from circnav_mav.runtime.status import Watch
from tests.flight.lockstep import flight


def during(statuses, phase):
    return [status for status in statuses if status.tick.phase.value == phase]


def test_a_flight_that_goes_well_raises_no_alarm_and_tells_its_rates(statuses):
    flown = statuses(12.0)
    assert [status.alarms for status in flown if status.alarms] == []
    last = flown[-1]
    assert (last.tick.phase.value, last.phase, last.waits) == ("engaged", "engaged", "")
    assert 9 < last.rates.taken <= 11  # 10 Hz
    assert 40 < last.rates.frames < 100
    assert last.rates.setpoints > 9


def test_the_time_flown_counts_from_the_moment_of_engaging(statuses):
    told = statuses(12.0)
    flown = during(told, "engaged")
    assert [status.flown for status in told if status.time < flown[0].time] == [None] * told.index(flown[0])
    engaged = flown[0].time - flown[0].flown
    assert told[0].time < engaged <= flown[0].time
    assert [status.time - status.flown for status in flown] == pytest.approx([engaged] * len(flown))


def test_why_this_law_flies_is_told_while_it_steers_and_no_longer(statuses):
    told = statuses(9.0, 'guidance.law="auto"', event="takeover")
    assert {bool(status.why) for status in during(told, "engaged")} == {True}
    assert {status.why for status in told if status.tick.law == ""} == {""}
    assert told[-1].tick.law == ""


def test_before_anything_is_heard_it_says_so():
    assert flight("quickstart").pilot.waits_for(0.0) == "no autopilot heartbeat, 0 bytes heard"


GROUND = ("sim.start.altitude_m=0.0", "sim.start.armed=false", 'sim.start.mode="STABILIZE"')
BACK = "the operator has the vehicle: enter GUIDED again to hand it back"


@pytest.mark.parametrize(
    ("seconds", "overrides", "event", "waits", "alarms"),
    [
        (4.0, ["engage.request_mode=false"], None, "mode GUIDED: the operator must enter it", ""),
        (4.0, GROUND, None, "the vehicle is on the ground", ""),
        (4.0, ["sim.ranging.rate_hz=0.0"], None, "no ranging: no usable DISTANCE_SENSOR", ""),
        (10.2, [], "outage", "", r"RANGE STALE 4\.\d s: holding the circle's turn rate, ends at 10\.5 s"),
        (9.0, ['engage.on_takeover="wait"'], "takeover", BACK, "OPERATOR HAS THE VEHICLE, mode LOITER"),
        (8.0, ["ranging.max_range_m=50.0"], None, "no ranging: ", "MOST RANGES REJECTED: .* per second"),
        (9.0, [], "silence", "", r"LINK SILENT for [23]\.\d s; .*"),
    ],
    ids=["mode", "ground", "ranging", "outage", "takeover", "rejected", "silent"],
)
def test_it_says_what_it_waits_for_and_what_is_wrong(statuses, seconds, overrides, event, waits, alarms):
    last = statuses(seconds, *overrides, event=event)[-1]
    assert last.waits.startswith(waits)
    assert re.fullmatch(alarms, "; ".join(last.alarms))


def test_ranges_that_are_refused_are_counted_by_reason_and_those_of_an_outage_not_at_all(statuses):
    assert list(statuses(8.0, "ranging.max_range_m=50.0")[-1].rejected) == ["above_max"]
    assert statuses(10.2, event="outage")[-1].rates.taken == 0


def test_a_dry_run_would_steer_without_the_mode(statuses):
    dry = statuses(6.0, output_mode=OutputMode.DRY_RUN)[-1]
    assert (dry.phase, dry.setpoints) == ("would steer", 0)


def test_a_vehicle_that_is_gone_leaves_no_range_that_counts_down(statuses):
    flown = statuses(30.0, "limits.hold_s=2.0", event="gone")
    old = [status.tick for status in flown if (status.tick.range_age or 0.0) > 2.6]
    assert old
    assert {(tick.r, tick.r_dot) for tick in old} == {(None, None)}


def test_ranges_of_other_senders_are_counted_apart_and_raise_no_alarm():
    """PX4 repeats what the radio says under its own id."""
    flown = flight("px4_copter").fly(8.0)
    status = Watch(flown.pilot).status(flown.ticks[-1], 8.0)
    assert status.others > 30
    assert "wrong_source" not in status.rejected
    assert flown.ticks[-1].rejected == sum(status.rejected.values())


def test_the_target_is_told_as_seen_from_the_vehicle_and_drift_by_where_it_goes_and_a_recording_that_stopped():
    """Vehicle 30 m east and 40 m south of the target, carried north: by hand."""
    flown = flight("quickstart").fly(6.0)
    tick = replace(flown.ticks[-1], x=30.0, y=-40.0, drift_x=0.0, drift_y=2.0)
    status = Watch(flown.pilot).status(tick, 6.0, "disk full")
    assert status.target == "bearing 323 deg, drift 2.0 m/s towards 000 deg"
    assert status.alarms == ("NOT RECORDING: disk full",)
