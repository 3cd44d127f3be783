"""Replay: the same flight gives the same bytes, another mission other ones, and half a log half a flight."""

import dataclasses
import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.analysis.replay import as_ticks, differences, patient, replay
from circnav_mav.analysis.run import open_run
from circnav_mav.analysis.turns import plain_turns, recorded_turns
from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import Pilot, Voice
from tests.flight.recorded import recorded_flight

APART = ('ranging.message="ranging_beacon"', 'ranging.endpoint="sim"', "ranging.beacon_id=9",
         'sim.ranging.message="ranging_beacon"', 'sim.ranging.via="direct"', "sim.ranging.beacon_id=9")  # fmt: skip
SHORT = "limits.duration_s=20"
PLAIN = ('guidance.law="smooth"', 'guidance.estimator="kalman"')


def settings_of(folder, *overrides):
    run = open_run(folder)
    return parse_mission(run.mission_text, "mission.toml", overrides).pilot_settings(Voice(run.voice))


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """20 s of the quickstart under the paper's first law, whose estimator does not look at the commands."""
    folder = tmp_path_factory.mktemp("flown")
    flight = recorded_flight(folder, "quickstart", SHORT, *PLAIN).fly(30)
    flight.recorder.close()
    return folder


@pytest.mark.parametrize(
    ("overrides", "voice"),
    [
        ((SHORT,), Voice.FLY),
        ((SHORT, *PLAIN), Voice.FLY),
        ((SHORT, *APART), Voice.FLY),
        ((SHORT,), Voice.DRY_RUN),
        ((SHORT,), Voice.SHADOW),
    ],
    ids=["fly", "plain law", "ranging apart", "dry run", "shadow"],
)
def test_nothing_changed_gives_every_frame_byte_for_byte_at_its_time(tmp_path, overrides, voice):
    flight = recorded_flight(tmp_path, "quickstart", *overrides, voice=voice).fly(30)
    flight.recorder.close()
    done = replay(Pilot(settings_of(tmp_path)), recorded_turns(tmp_path))
    assert done.identical
    assert done.first_difference is None
    assert len(done.was_said) > 80
    assert bool(done.was_setpoints) == (voice is Voice.FLY)
    assert not [gap for gap in differences(open_run(tmp_path).ticks, as_ticks(done.ticks)) if gap.most > 1e-6]


def test_an_interrupt_is_replayed_with_its_safe_setpoints(tmp_path):
    flight = recorded_flight(tmp_path, "quickstart", SHORT)
    flight.interrupt_at = 8.0
    flight.fly(30).recorder.close()
    pilot = Pilot(settings_of(tmp_path))
    done = replay(pilot, recorded_turns(tmp_path))
    assert done.identical
    assert pilot.outcome.reason == "SIGINT"
    assert done.until < 12


def test_an_impostor_with_the_vehicles_ids_is_told_apart_by_its_source(tmp_path):
    """A heartbeat in LOITER from elsewhere moves nothing; with its source forgotten it would end the flight."""
    flight = recorded_flight(tmp_path, "quickstart", SHORT)
    loiter = mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 5, 4, 3).pack(mavlink.MAVLink(None, 1, 1))
    flight.fly(5)
    flight.noise = [bytes(loiter)]
    flight.fly(30).recorder.close()
    pilot = Pilot(settings_of(tmp_path))
    assert replay(pilot, recorded_turns(tmp_path)).identical
    assert pilot.outcome.reason == "flown to its end"


def test_another_law_commands_other_turns_from_the_same_estimates(flown):
    done = replay(Pilot(settings_of(flown, 'guidance.law="switching"')), recorded_turns(flown))
    assert not done.identical
    gaps = {gap.column: gap for gap in differences(open_run(flown).ticks, as_ticks(done.ticks))}
    assert gaps["r"].most < 1e-6
    assert gaps["turn_rate"].most > 0.05
    assert done.first_difference > 0


def test_another_radius_shows_in_the_setpoints_alone(flown):
    done = replay(Pilot(settings_of(flown, "orbit.radius_m=80")), recorded_turns(flown))
    assert len(done.setpoints) == len(done.was_setpoints)
    assert not done.identical


@pytest.mark.parametrize("kept", [0.7, 0.31, 0.001])
def test_a_log_that_was_cut_off_is_replayed_up_to_there(flown, tmp_path, kept):
    for path in flown.iterdir():
        data = path.read_bytes()
        cut = kept if path.name in ("flight.tlog", "turns.csv") else 1
        (tmp_path / path.name).write_bytes(data[: int(cut * len(data))])
    done = replay(Pilot(settings_of(tmp_path)), recorded_turns(tmp_path))
    assert done.identical
    assert done.until == pytest.approx(kept * 21, abs=3)


def test_a_plain_tlog_is_steered_by_its_ranges_and_our_own_frames_are_left_out(flown):
    settings = patient(settings_of(flown))
    pilot = Pilot(dataclasses.replace(settings, voice=Voice.DRY_RUN))
    done = replay(pilot, plain_turns(flown / "flight.tlog", 191), ticking=True)
    assert pilot.engaged_at is not None
    assert pilot.session.ignored["twin"] == pilot.session.ignored["echo"] == 0
    assert done.setpoints == []
    was = open_run(flown).ticks
    steered = as_ticks(done.ticks).numbers["r"]
    assert steered[-1] == pytest.approx(was.numbers["r"][-1], abs=1.0)
    steps = [b.time - a.time for a, b in zip(done.ticks, done.ticks[1:], strict=False)]
    assert max(steps) <= settings.timing.tick + 1e-6


def test_a_gap_in_a_plain_tlog_loses_the_vehicle_and_does_not_tick_for_hours(flown):
    turns = [turn for turn in plain_turns(flown / "flight.tlog", 191) if turn.time < 10]
    later = [dataclasses.replace(turn, time=turn.time + 1e5) for turn in turns]
    pilot = Pilot(dataclasses.replace(patient(settings_of(flown)), voice=Voice.DRY_RUN))
    done = replay(pilot, [*turns, *later], ticking=True)
    assert len(done.ticks) < 2000
    assert pilot.outcome is None
    assert not math.isclose(pilot.engaged_at, 0)


def test_stamps_that_step_back_do_not_turn_time_round(flown, tmp_path):
    data = (flown / "flight.tlog").read_bytes()
    (tmp_path / "twice.tlog").write_bytes(data + data)
    times = [turn.time for turn in plain_turns(tmp_path / "twice.tlog", 191)]
    assert times == sorted(times)
