"""A vehicle that runs faster than real time, flown by its own clock, and what is said when it is not."""

import json
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path
from statistics import median

import pytest

from circnav_mav.runlog.tlog import message_id, read_tlog
from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import flight
from tests.frames import output
from tests.process import COPTER, PATIENCE, circnav

SPEED = 3
RANGE, SETPOINT = 132, 84  # DISTANCE_SENSOR, SET_POSITION_TARGET_LOCAL_NED


def test_a_simulator_three_times_as_fast_is_flown_in_its_own_seconds(port: int, tmp_path: Path) -> None:
    """By its typical second: what a busy machine does to some of them is not judged."""
    vehicle = circnav("emulate", COPTER, "--endpoint", f"udpin:127.0.0.1:{port}", "--speed", str(SPEED))
    try:
        assert vehicle.stdout is not None
        vehicle.stdout.readline()
        overrides = ("--set", 'link.clock="autopilot"', "--duration", "12", "--out", str(tmp_path / "run"))
        flight = circnav("fly", COPTER, "--endpoint", f"udpout:127.0.0.1:{port}", *overrides, drawn=False)
        assert flight.stdout is not None
        told = [(float(line.split()[0]), time.monotonic()) for line in flight.stdout if "link age" in line]
        _, errors = flight.communicate(timeout=PATIENCE)
    finally:
        vehicle.terminate()
        vehicle.communicate(timeout=PATIENCE)
    assert (flight.returncode, errors) == (0, "")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["flown_s"] == pytest.approx(12.0, abs=1.0)
    assert a_second(tmp_path / "run", RANGE) == pytest.approx(10, rel=0.1)  # the radio's 10 Hz, in the run's seconds
    assert a_second(tmp_path / "run", SETPOINT) == pytest.approx(20, rel=0.2)  # a tick after each range
    paces = [(run - before) / (real - then) for (before, then), (run, real) in pairwise(told)]
    assert median(paces) == pytest.approx(SPEED, rel=0.4)


def a_second(run: Path, number: int) -> float:
    """Frames of a message in the median second of a run."""
    seconds = Counter(
        stamp // 1_000_000 for stamp, frame in read_tlog(run / "flight.tlog") if message_id(frame) == number
    )
    return median(seconds[second] for second in range(min(seconds), max(seconds) + 1))


@pytest.mark.parametrize(("speed", "told"), [(1.0, None), (1.05, None), (0.5, 0.5), (8.0, 8.0)])
def test_a_vehicle_whose_time_runs_at_another_speed_is_noticed(speed: float, told: float | None) -> None:
    flown = flight("arducopter")
    pilot, vehicle, ticks = flown.pilot, flown.vehicle, []
    for step in range(1, 1501):
        now = 0.01 * step
        vehicle.advance(now * speed)
        for frame in vehicle.outgoing("main"):
            pilot.receive(frame, now, "sim")
        vehicle.receive(output(pilot, now))
        ticks += pilot.take_records()
    assert pilot.session.clock_speed.noticed == (told if told is None else pytest.approx(told, rel=0.02))
    alarms = [one for one in StatusSource(pilot, Onlookers()).status(ticks[-1], 15.0).alarms if one.startswith("CLOCK")]
    words = f"CLOCK: autopilot time runs {speed:g} times as fast as ours: for a simulator set link.clock"
    assert [alarm.startswith(words) for alarm in alarms] == ([] if told is None else [True])
