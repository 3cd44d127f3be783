"""A vehicle that runs faster than real time, flown by its own clock, and what is said when it is not."""

import json
import os
import time
from pathlib import Path

import pytest

from circnav_mav.runtime.status import Watch
from tests.flight.lockstep import flight
from tests.process import COPTER, circnav

SPEED = 5


def test_a_simulator_five_times_as_fast_is_flown_in_its_own_seconds(tmp_path: Path) -> None:
    endpoint = f"127.0.0.1:{22000 + os.getpid() % 8000}"
    vehicle = circnav("emulate", COPTER, "--endpoint", f"udpin:{endpoint}", "--speed", str(SPEED))
    try:
        assert vehicle.stdout is not None
        vehicle.stdout.readline()
        overrides = ("--set", 'link.clock="autopilot"', "--duration", "40", "--out", str(tmp_path / "run"))
        began = time.monotonic()
        flight = circnav("fly", COPTER, "--endpoint", f"udpout:{endpoint}", *overrides)
        printed, errors = flight.communicate(timeout=60)
        elapsed = time.monotonic() - began
    finally:
        vehicle.terminate()
        vehicle.communicate(timeout=10)
    assert (flight.returncode, errors) == (0, ""), printed
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["flown_s"] == pytest.approx(40.0, abs=1.0)
    assert summary["samples_accepted"] == pytest.approx(10 * 40, rel=0.1)  # the radio's 10 Hz, in the run's seconds
    assert summary["setpoints_sent"] == pytest.approx(20 * 40, rel=0.2)  # a tick after each range
    assert elapsed < 40.0 / 2


@pytest.mark.parametrize(("speed", "told"), [(1.0, None), (1.05, None), (0.5, 0.5), (8.0, 8.0)])
def test_a_vehicle_whose_time_runs_at_another_speed_is_noticed(speed: float, told: float | None) -> None:
    flown = flight("arducopter")
    pilot, vehicle, ticks = flown.pilot, flown.vehicle, []
    for step in range(1, 1501):
        now = 0.01 * step
        vehicle.advance(now * speed)
        for frame in vehicle.outgoing("main"):
            pilot.receive(frame, now, "sim")
        vehicle.receive(pilot.step(now))
        ticks += pilot.take_records()
    assert pilot.session.boot_clock.noticed == (told if told is None else pytest.approx(told, rel=0.02))
    alarms = [one for one in Watch(pilot).status(ticks[-1], 15.0).alarms if one.startswith("CLOCK")]
    words = f"CLOCK: the autopilot's time runs at {speed:g} of ours: a simulator at this speed is flown with link.clock"
    assert [alarm.startswith(words) for alarm in alarms] == ([] if told is None else [True])
