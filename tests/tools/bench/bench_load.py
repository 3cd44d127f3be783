"""python -m tests.tools.bench.bench_load [--seconds 180] [--law smooth] [--hogs N]:

a real-time flight on a busy machine.

`circnav fly` in a separate process, over UDP, against a vehicle in this process that sends 200
messages per second, with one busy process per core. Prints figures without asserting.
"""

import argparse
import csv
import os
import subprocess
import sys
import time
from math import inf, sqrt
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot.tick_scheduler import TickScheduler
from tests.flight.lockstep import true_radius
from tests.process import ROOT, resident_mb
from tests.tools.bench.on_port import SETPOINT, VehicleOnPort, flown
from tests.tools.fault_link.frames import frames, message_id, write

MISSION = ROOT / "config" / "arducopter.toml"
RADIUS = 30.0
TICK = 0.05
GCS = (255, 190)
RANGE = 132
EXTRA = {31: 50, 32: 50, 33: 50, 24: 10, 85: 10}
"""Rate in Hz by message id of the messages that the vehicle sends in addition to the requested
streams (31 messages per second)."""
SETTLING = 90.0


class Bench:
    """Records of the application's output. Times are from the clock of this process."""

    def __init__(self) -> None:
        self.sent = 0
        self.setpoints: list[float] = []
        self.latencies: list[float] = []
        self.errors: list[float] = []
        self.memory: list[tuple[float, float]] = []
        """Time, s, and resident memory of the application, MB, once per second."""

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
            if now >= len(self.memory):
                self.memory.append((now, resident_mb(process.pid)))
                self.errors.append(true_radius(vehicle.vehicle.truth) - RADIUS)


def request(vehicle: VehicleOnPort) -> None:
    """Request the additional messages as a ground station."""
    for number, rate in EXTRA.items():
        values = (number, 1e6 / rate, 0, 0, 0, 0, 0)
        ask = mavlink.MAVLink_command_long_message(1, 1, 511, 0, *values)
        vehicle.vehicle.receive(write(ask, *GCS))


def lateness(ticks: Path) -> list[float]:
    """Return the delay of each tick that was not triggered by a range, s."""
    beat = TickScheduler(TICK)
    accepted = 0
    late = []
    with ticks.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            at = float(row["time"])
            if int(row["accepted"]) > accepted:
                beat.received(at)
            elif row["phase"] == "engaged":
                late.append(at - beat.due)
            accepted = int(row["accepted"])
            beat.stepped(at)
    return late


def milliseconds(values: list[float]) -> str:
    p50, p99 = np.percentile(values, [50, 99]) * 1000
    return f"p50 {p50:.1f} ms, p99 {p99:.1f} ms, worst {max(values) * 1000:.1f} ms ({len(values)})"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="bench_load", description="A flight on a busy machine.")
    parser.add_argument("--seconds", type=float, default=180.0)
    parser.add_argument("--law", default="smooth")
    parser.add_argument(
        "--hogs", type=int, default=os.cpu_count() or 1, help="processes that only compute"
    )
    options = parser.parse_args(arguments)
    bench = Bench()
    hogs = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.hogs)
    ]
    law = f'guidance.law="{options.law}"'
    try:
        with flown(MISSION, "--set", law, "--duration", "1e6") as (vehicle, process, run):
            bench.fly(vehicle, process, options.seconds)
            process.terminate()
            Bench().fly(vehicle, process, options.seconds + 3.0)
            process.wait(timeout=120)
            report(options, bench, run)
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()
    return 0


def report(options: argparse.Namespace, bench: Bench, run: Path) -> None:
    memory = bench.memory
    print(
        f"{memory[-1][0]:.0f} s of arducopter, law {options.law}, {options.hogs} hogs on"
        f" {os.cpu_count()} cores (load {os.getloadavg()[0]:.1f}), {bench.sent / memory[-1][0]:.0f}"
        " messages a second to the application"
    )
    print(f"tick lateness: {milliseconds(lateness(run / 'ticks.csv'))}")
    print(f"range to setpoint, by the vehicle's clock: {milliseconds(bench.latencies)}")
    print(f"setpoint gaps: {milliseconds(list(np.diff(bench.setpoints)))}")
    late = [(at, mb) for at, mb in memory if at > options.seconds / 4]
    slope = np.polyfit(*zip(*late, strict=True), 1)[0] * 3600
    print(
        f"memory: {late[-1][1]:.1f} MB, {late[-1][1] - late[0][1]:+.2f} MB since a quarter, slope"
        f" {slope:+.1f} MB/h"
    )
    errors = bench.errors[int(SETTLING) :] or bench.errors[-1:]
    rms = sqrt(sum(error**2 for error in errors) / len(errors))
    worst = max(map(abs, errors))
    print(
        f"radius error after {SETTLING:.0f} s: RMS {rms:.2f} m ({100 * rms / RADIUS:.1f} %), worst"
        f" {worst:.2f} m"
    )
    print(
        "files: "
        + ", ".join(
            f"{path.name} {path.stat().st_size / 1e6:.2f} MB" for path in sorted(run.iterdir())
        )
    )


if __name__ == "__main__":
    sys.exit(main())
