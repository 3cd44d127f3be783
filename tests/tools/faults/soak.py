"""python -m tests.tools.faults.soak [--hours 10] [--law smooth] [--profile arducopter]: a long flight in lockstep.

The pilot and the recorder as the product has them, the bundled vehicle, real bytes, one manual clock. The 32-bit
milliseconds since boot of the autopilot and those of the ranging radio wrap on the way. Prints one line an hour.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from circnav_mav.runlog.ticks import read_ticks, read_truth
from tests.flight.lockstep import Flight, clockwise_turns, rms_error, true_radius
from tests.flight.recorded import EPOCH_US, recorded_flight
from tests.tools.faults.fuzz import resident_mb

WRAP = 2**32 / 1000
"""Time, s, after which 32 bits of milliseconds begin anew: 49.7 days."""
HOUR, SETTLING = 3600.0, 150.0


def account(flight: Flight, since: float) -> str:
    """What was seen of a flight since some time: the radius, the turns and the gaps between setpoints."""
    truths = [truth for truth in flight.truths if truth.time >= since]
    if len(truths) < 2:
        return "too short to be judged"
    desired = flight.pilot.settings.orbit.radius
    rms, worst = rms_error(truths, desired), max(abs(true_radius(truth) - desired) for truth in truths)
    gaps = 1000 * np.diff([at for at, _ in flight.vehicle.setpoint_log if at >= since])
    return (
        f"RMS {rms:.2f} m ({100 * rms / desired:.1f} %), worst {worst:.2f} m, {clockwise_turns(truths):+.1f} turns "
        f"clockwise, setpoint gaps median {np.median(gaps):.0f} ms, worst {gaps.max():.0f} ms"
    )


def soak(folder: Path, profile: str, law: str, hours: float) -> Iterator[str]:
    """Fly, and tell each hour. The autopilot's clock wraps at a third of the flight, the radio's at two thirds."""
    until = hours * HOUR
    changes = (
        f'guidance.law="{law}"',
        f"limits.duration_s={until + HOUR}",
        "sim.truth.rate_hz=1",
        f"sim.vehicle.boot_age_s={WRAP - until / 3}",
        f"sim.ranging.clock_offset_s={WRAP - 2 * until / 3}",
    )
    flight = recorded_flight(folder, profile, *changes)
    memory: list[tuple[float, float]] = []
    while flight.now < until and not flight.pilot.done:
        since = max(flight.now, SETTLING)
        flight.fly(min(flight.now + HOUR, until))
        memory.append((flight.now / HOUR, resident_mb()))
        yield f"{flight.now / HOUR:6.2f} h: {account(flight, since)}, RSS {memory[-1][1]:.1f} MB"
        flight.truths.clear()
        flight.sent.clear()
    assert flight.recorder is not None
    flight.recorder.close()
    pilot, mission = flight.pilot, flight.pilot.mission
    outcome = f"ended: {mission.outcome.reason}" if mission.outcome else f"still {mission.phase.value}"
    yield (
        f"{outcome}; ranges taken {pilot.tracker.accepted}, rejected {dict(pilot.tracker.ranging.rejected)}; "
        f"reboots seen {pilot.session.vehicle.reboots}; recording: {flight.recorder.problem or 'whole'}"
    )
    late = [(at, mb) for at, mb in memory if at > hours / 5] if len(memory) > 4 else memory
    if len(late) > 1:
        yield f"memory slope after the first fifth: {np.polyfit(*zip(*late, strict=True), 1)[0]:+.2f} MB/h"
    sizes = ", ".join(f"{path.name} {path.stat().st_size / 1e6:.1f} MB" for path in sorted(folder.iterdir()))
    yield f"files: {sizes}"
    before, began = resident_mb(), time.monotonic()
    ticks, truth = read_ticks(folder), read_truth(folder, EPOCH_US)
    yield (
        f"read back: {len(ticks.time)} ticks, {len(truth.time) if truth else 0} truths in "
        f"{time.monotonic() - began:.0f} s, {resident_mb() - before:+.0f} MB"
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.faults.soak", description="A long flight in lockstep.")
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--law", default="smooth")
    parser.add_argument("--profile", default="arducopter")
    options = parser.parse_args(arguments)
    began = time.monotonic()
    print(f"{options.hours:g} h of {options.profile}, law {options.law}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for line in soak(Path(folder), options.profile, options.law, options.hours):
            print(line, flush=True)
    print(f"flown in {time.monotonic() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
