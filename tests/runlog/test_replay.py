"""Replay: the same mission gives the same bytes, another mission gives other commands, and a
truncated log gives a part of the flight."""

import dataclasses
import math
import re
import struct
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import OutputMode, Pilot
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runlog.loop_steps import check_tlog, recorded_steps, tlog_steps
from circnav_mav.runlog.replay import as_ticks, differences, replay, without_timeouts
from circnav_mav.runlog.run_folder import RunError, open_run
from circnav_mav.runlog.tlog import read_tlog
from tests.flight.recorded import recorded_flight

APART = (
    'ranging.message="ranging_beacon"',
    'ranging.endpoint="sim"',
    "ranging.beacon_id=9",
    'sim.ranging.message="ranging_beacon"',
    'sim.ranging.via="direct"',
    "sim.ranging.beacon_id=9",
)
SHORT = "limits.duration_s=6"
PLAIN = ('guidance.law="smooth"', 'guidance.estimator="kalman"')


def settings_of(folder, *overrides):
    run = open_run(folder)
    return parse_mission(run.mission_text, "mission.toml", overrides)


def replayed(folder, *overrides):
    """Return the pilot of a replay, and the result of the replay."""
    output_mode = OutputMode(open_run(folder).output_mode)
    pilot = Pilot(settings_of(folder, *overrides), output_mode=output_mode)
    return pilot, replay(pilot, recorded_steps(folder))


def gaps(folder, done):
    """Return the largest difference of each column of the ticks."""
    return {
        gap.column: gap.largest for gap in differences(open_run(folder).ticks, as_ticks(done.ticks))
    }


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """20 s of the quickstart under the paper's first law. The estimator of this law does not use
    the commands."""
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart", "limits.duration_s=20", *PLAIN).fly(30).recorder.close()
    return folder


# --- replay of recorded steps


@pytest.mark.parametrize(
    ("overrides", "output"),
    [((), OutputMode.FLY), (APART, OutputMode.FLY), ((), OutputMode.DRY_RUN)],
    ids=["fly", "ranging apart", "dry run"],
)
def test_unchanged_replay_sends_identical_frames(tmp_path, overrides, output):
    recorded_flight(tmp_path, "quickstart", SHORT, *overrides, output=output).fly(
        30
    ).recorder.close()
    _, done = replayed(tmp_path)
    assert done.identical
    assert done.first_difference is None
    assert len(done.was_sent) > 40
    assert bool(done.was_setpoints) == (output is OutputMode.FLY)
    assert max(gaps(tmp_path, done).values()) < 1e-6


@pytest.mark.parametrize(
    ("event", "at", "reason"),
    [("interrupt_at", 8.0, "SIGINT"), ("slow_at", 9.0, "flown to its end")],
)
def test_interrupts_and_late_steps_are_replayed(tmp_path, event, at, reason):
    """The interrupt is followed by safe setpoints. A late step sends no setpoint, and neither ticks
    nor summary count one."""
    flight = recorded_flight(tmp_path, "quickstart", SHORT)
    setattr(flight, event, at)
    flight.fly(30).recorder.close()
    pilot, done = replayed(tmp_path)
    assert done.identical
    assert pilot.mission.outcome.reason == reason
    assert done.until < 13
    assert pilot.setpoints_sent == flight.pilot.setpoints_sent == len(done.was_setpoints)
    steered = [tick for tick in done.ticks if tick.phase is Phase.ENGAGED and tick.time > 5]
    assert [tick.yaw_rate_sent is None for tick in steered].count(True) == (event == "slow_at")


def test_replay_distinguishes_senders_by_source(tmp_path):
    """A heartbeat in LOITER from another address is rejected. Without its recorded address, it
    would end the replayed flight."""
    flight = recorded_flight(tmp_path, "quickstart", SHORT)
    loiter = mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 5, 4, 3).pack(
        mavlink.MAVLink(None, 1, 1)
    )
    flight.fly(9)
    flight.others = [(bytes(loiter), "another address")]
    flight.fly(30).recorder.close()
    pilot, done = replayed(tmp_path)
    assert done.identical
    assert pilot.mission.outcome.reason == "flown to its end"


def test_replay_with_another_law_changes_only_commands(flown):
    _, done = replayed(flown, 'guidance.law="switching"')
    assert not done.identical
    assert done.first_difference > 0
    moved = gaps(flown, done)
    assert moved["r"] < 1e-6
    assert moved["turn_rate"] > 0.05
    _, wider = replayed(flown, "orbit.radius_m=120")
    assert len(wider.setpoints) == len(wider.was_setpoints), (
        "another radius changes the setpoints, but not their number"
    )
    assert not wider.identical


@pytest.mark.parametrize("kept", [0.7, 0.31, 0.001])
def test_truncated_log_is_replayed_to_its_end(flown, tmp_path, kept):
    for path in flown.iterdir():
        data = path.read_bytes()
        cut = kept if path.name in ("flight.tlog", "steps.csv") else 1
        (tmp_path / path.name).write_bytes(data[: int(cut * len(data))])
    _, done = replayed(tmp_path)
    assert done.identical
    assert done.until == pytest.approx(kept * 25, abs=3)


def test_replay_ignores_ranges_after_end_of_pilot(flown):
    """The replayed pilot ends after 5 s of the recorded 20 s. The ranges of the other 15 s are not
    rejected as stalled."""
    pilot, done = replayed(flown, "limits.duration_s=5")
    assert done.ended < 13 < done.until
    assert "stalled" not in pilot.tracker.ranging.rejected
    assert len(done.was_setpoints) > len(done.setpoints) > 0


# --- a plain tlog


def replayed_plain(flown, steps):
    pilot = Pilot(without_timeouts(settings_of(flown)), output_mode=OutputMode.DRY_RUN)
    return pilot, replay(pilot, steps, ticking=True)


def test_replay_of_plain_tlog_steers_without_timeouts(flown):
    mission = without_timeouts(settings_of(flown, "limits.stale_s=0.75"))
    assert (mission.slowest_answer, mission.stale) == (pytest.approx(0.9), 0.75)
    assert mission.file.limits.coast_s == math.inf
    pilot, done = replayed_plain(flown, tlog_steps(flown / "flight.tlog", 191))
    assert pilot.mission.engaged_at is not None
    assert pilot.session.identity.ignored["twin"] == pilot.session.identity.ignored["echo"] == 0
    assert done.setpoints == []
    assert as_ticks(done.ticks).numbers["r"][-1] == pytest.approx(
        open_run(flown).ticks.numbers["r"][-1], abs=1.0
    )
    assert (
        max(b.time - a.time for a, b in pairwise(done.ticks))
        <= pilot.settings.file.limits.tick + 1e-6
    )


def test_replay_skips_gap_in_plain_tlog(flown):
    steps = [step for step in tlog_steps(flown / "flight.tlog", 191) if step.time < 10]
    later = [dataclasses.replace(step, time=step.time + 1e5) for step in steps]
    pilot, done = replayed_plain(flown, [*steps, *later])
    assert len(done.ticks) < 2000
    assert pilot.mission.outcome is None
    assert pilot.mission.engaged_at > 0


HOUR = 3_600_000_000


def v1(stamp, frame):
    return stamp, mavlink.MAVLink_system_time_message(0, 0).pack(
        mavlink.MAVLink(None, 1, 1), force_mavlink1=True
    )


def of_another_vehicle(stamp, frame):
    return stamp, mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3).pack(
        mavlink.MAVLink(None, 7, 1)
    )


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (v1, "MAVLink 1"),
        (of_another_vehicle, "has the autopilots 1/1, 7/1"),
        (lambda stamp, frame: (stamp - HOUR, frame), "its clock jumps by -36"),
        (lambda stamp, frame: (stamp + 2 * HOUR, frame), "its clock jumps by +72"),
        (lambda stamp, frame: (stamp, frame[:-5]), "damaged at byte"),
    ],
    ids=["MAVLink 1", "two vehicles", "clock set back", "clock set ahead", "damaged"],
)
def test_replay_refuses_unsuitable_plain_tlog(flown, tmp_path, change, error):
    records = list(read_tlog(flown / "flight.tlog"))
    records[1000] = change(*records[1000])
    (tmp_path / "x.tlog").write_bytes(
        b"".join(struct.pack(">Q", stamp) + bytes(frame) for stamp, frame in records)
    )
    with pytest.raises(RunError, match=re.escape(error)):
        check_tlog(tmp_path / "x.tlog")


def test_replay_accepts_plain_tlog_with_disordered_timestamps(flown, tmp_path):
    records = enumerate(read_tlog(flown / "flight.tlog"))
    data = [struct.pack(">Q", stamp - at % 3 * 20_000) + frame for at, (stamp, frame) in records]
    (tmp_path / "x.tlog").write_bytes(b"".join(data))
    check_tlog(tmp_path / "x.tlog")
    times = [step.time for step in tlog_steps(tmp_path / "x.tlog", 191)]
    assert times == sorted(times)
