"""python -m tests.faults.soak [--hours 10] [--law smooth] [--profile arducopter]: a long flight in lockstep.

The pilot and the recorder as the product has them, the bundled vehicle, real bytes, one manual clock. The 32-bit
milliseconds since boot of the autopilot and those of the ranging radio wrap on the way. Prints one line an hour.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from math import atan2, pi, sqrt
from pathlib import Path

import numpy as np

from circnav_mav.runlog.ticks import read_ticks, read_truth
from sim.vehicle import Truth
from tests.faults.fuzz import resident_mb
from tests.flight.lockstep import Flight, true_radius
from tests.flight.recorded import EPOCH_US, recorded_flight

WRAP = 2**32 / 1000
"""Time, s, after which 32 bits of milliseconds begin anew: 49.7 days."""
HOUR, SETTLING, LOOK_EVERY, LOG_EVERY = 3600.0, 150.0, 0.1, 600.0


@dataclass
class Account:
    """What was seen of a flight since the last line: radius errors, m; turns, clockwise positive; setpoint gaps, s."""

    desired: float
    squares: float = 0.0
    count: int = 0
    worst: float = 0.0
    swept: float = 0.0
    gaps: list[float] = field(default_factory=list)
    _before: Truth | None = None
    _look_at: float = 0.0
    _read_at: float = SETTLING
    _last_setpoint: float = SETTLING

    def watch(self, flight: Flight) -> None:
        """After each step of the flight."""
        if flight.now >= self._look_at:
            self._look_at = flight.now + LOOK_EVERY
            self._look(flight.vehicle.truth)
        if flight.now >= self._read_at + LOG_EVERY:
            self._read_at = flight.now
            self.read_setpoints(flight)

    def read_setpoints(self, flight: Flight) -> None:
        """The gaps between the setpoints that the vehicle has accepted since the last call."""
        times = [at for at, _ in flight.vehicle.setpoint_log if at >= self._last_setpoint]
        self.gaps += [b - a for a, b in pairwise(times)]
        self._last_setpoint = times[-1] if times else self._last_setpoint

    def _look(self, truth: Truth) -> None:
        before, self._before = self._before, truth
        if before is None or truth.time < SETTLING:
            return
        error = true_radius(truth) - self.desired
        self.squares, self.count, self.worst = self.squares + error**2, self.count + 1, max(self.worst, abs(error))
        (an, ae), (bn, be) = ((one.north - one.target_north, one.east - one.target_east) for one in (before, truth))
        self.swept += atan2(an * be - ae * bn, an * bn + ae * be)

    def take(self) -> str:
        """The line, and begin anew."""
        rms = sqrt(self.squares / max(self.count, 1))
        gaps = np.array(self.gaps or [0.0])
        line = (
            f"RMS {rms:.2f} m ({100 * rms / self.desired:.1f} %), worst {self.worst:.2f} m, "
            f"{self.swept / (2 * pi):+.1f} turns clockwise, setpoint gaps median {1000 * np.median(gaps):.0f} ms, "
            f"worst {1000 * gaps.max():.0f} ms"
        )
        self.squares, self.count, self.worst, self.swept, self.gaps = 0.0, 0, 0.0, 0.0, []
        return line


def soak(folder: Path, profile: str, law: str, hours: float, lines_every: float = HOUR) -> Iterator[str]:
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
    account = Account(flight.pilot.settings.orbit.radius)
    memory: list[tuple[float, float]] = []
    while flight.now < until and not flight.pilot.done:
        flight.fly(min(flight.now + lines_every, until), account.watch)
        account.read_setpoints(flight)
        memory.append((flight.now / HOUR, resident_mb()))
        yield f"{flight.now / HOUR:6.2f} h: {account.take()}, RSS {memory[-1][1]:.1f} MB"
    assert flight.recorder is not None
    flight.recorder.close()
    pilot = flight.pilot
    outcome = f"ended: {pilot.outcome.reason}" if pilot.outcome else f"still {pilot.phase.value}"
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
    parser = argparse.ArgumentParser(prog="python -m tests.faults.soak", description="A long flight in lockstep.")
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
