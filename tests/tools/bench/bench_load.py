"""A real-time flight on a busy machine.

    python -m tests.tools.bench.bench_load [--seconds 180] [--law smooth] [--hogs N]

`circnav fly` in a separate process, over UDP, against a vehicle in this process that sends 200
messages per second, with one busy process per core. Prints figures without asserting.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import inf

import numpy as np
from numpy.typing import ArrayLike
from pymavlink.dialects.v20 import all as mavlink

from tests.flight.lockstep import true_radius
from tests.process import ROOT
from tests.tools.bench.on_port import SETPOINT, VehicleOnPort, flown
from tests.tools.fault_link.frames import frames, message_id, write

MISSION = ROOT / "config" / "arducopter.toml"
RADIUS = 30.0
GCS = (255, 190)
RANGE = 132
EXTRA = {31: 50, 32: 50, 33: 50, 24: 10, 85: 10}
"""Rate in Hz by message id of the messages that the vehicle sends in addition to the requested
streams (31 messages per second)."""
SETTLING = 90.0


class Record:
    """Output of the application. Times are from the clock of this process."""

    def __init__(self) -> None:
        self.sent = 0
        self.setpoints: list[float] = []
        self.latencies: list[float] = []
        self.errors: list[tuple[float, float]] = []
        """Time, s, and radius error, m, once per second."""

    def fly(
        self, vehicle: VehicleOnPort, process: "subprocess.Popen[bytes]", seconds: float
    ) -> None:
        range_at = inf
        while (now := vehicle.now) < seconds and process.poll() is None:
            for frame in vehicle.speak():
                self.sent += 1
                if message_id(frame) == RANGE:
                    range_at = time.perf_counter()
            first = not vehicle.received
            if SETPOINT in map(message_id, frames(vehicle.receive())):
                self.setpoints.append(now)
                if range_at < inf:
                    self.latencies.append(time.perf_counter() - range_at)
                range_at = inf
            if first and vehicle.received:
                request(vehicle)
            if now >= len(self.errors):
                self.errors.append((now, true_radius(vehicle.vehicle.truth) - RADIUS))

    def report(self) -> str:
        """Return the figures as text."""
        times, errors = np.array(self.errors).T
        late = errors[times > SETTLING] if times[-1] > SETTLING else errors[-1:]
        rms = float(np.sqrt(np.mean(late**2)))
        return (
            f"{self.sent / times[-1]:.0f} messages a second to the application, load"
            f" {os.getloadavg()[0]:.1f}\n"
            f"range to setpoint, by the vehicle's clock: {milliseconds(self.latencies)}\n"
            f"setpoint gaps: {milliseconds(np.diff(self.setpoints))}\n"
            f"radius error after {SETTLING:.0f} s: RMS {rms:.2f} m ({100 * rms / RADIUS:.1f} %),"
            f" worst {np.abs(late).max():.2f} m"
        )


def request(vehicle: VehicleOnPort) -> None:
    """Request the additional messages as a ground station."""
    for number, rate in EXTRA.items():
        values = (number, 1e6 / rate, 0, 0, 0, 0, 0)
        ask = mavlink.MAVLink_command_long_message(1, 1, 511, 0, *values)
        vehicle.vehicle.receive(write(ask, *GCS))


def milliseconds(values: ArrayLike) -> str:
    p50, p99, worst = 1000 * np.percentile(values, [50, 99, 100])
    return f"p50 {p50:.1f} ms, p99 {p99:.1f} ms, worst {worst:.1f} ms"


@contextmanager
def hogs(count: int) -> Iterator[None]:
    """Run processes that only compute."""
    with ExitStack() as running:
        for _ in range(count):
            hog = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            running.callback(hog.wait)
            running.callback(hog.kill)
        yield


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=180.0)
    parser.add_argument("--law", default="smooth")
    parser.add_argument("--hogs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    law = f'guidance.law="{options.law}"'
    record = Record()
    with (
        hogs(options.hogs),
        flown(MISSION, "--set", law, "--duration", "1e6") as (vehicle, process, _),
    ):
        record.fly(vehicle, process, options.seconds)
    print(record.report())


if __name__ == "__main__":
    main()
