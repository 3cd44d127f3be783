"""python -m tests.bench.bench_start [--times 5]: how soon `circnav fly` speaks, what `check` costs, memory in flight.

Processor times beside that of importing numpy and pymavlink's dialect, in the same run, in turn. The flight is the
quickstart's in real time; its memory is what is resident once it steers, threads and all. Prints; asserts nothing.
"""

import argparse
import os
import resource
import select
import statistics
import subprocess
import sys
import tempfile
import time

from sim.faults.frames import frames, message_id
from tests.bench.on_port import ROOT, SETPOINT, VehicleOnPort

MISSION = ROOT / "config" / "quickstart.toml"
IMPORTS = ["-c", "import numpy; from pymavlink.dialects.v20 import all"]
CHECK = ["-m", "circnav_mav", "check", str(MISSION)]
STEERED = 20.0
"""Time, s, of steering before the memory is read."""
PATIENCE = 60.0


def processor_time(arguments: list[str]) -> float:
    """Of a Python process, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def memory(pid: int) -> float:
    """Resident memory of a process, MB."""
    with open(f"/proc/{pid}/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def fly(law: str, steered: float) -> tuple[float, float]:
    """Start `circnav fly`: s until its first heartbeat, and MB once it has steered for a time (s; 0: at once)."""
    vehicle = VehicleOnPort(MISSION)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "circnav_mav", "fly", str(MISSION), "--out", f"{folder}/run", "--endpoint"]
        command += [f"udpout:127.0.0.1:{vehicle.port}", "--set", f'guidance.law="{law}"']
        began = time.monotonic()
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
        try:
            while not vehicle.heard and time.monotonic() - began < PATIENCE:
                select.select([], [], [], 0.001)
                vehicle.listen(float("inf"))
            spoke = time.monotonic() - began
            until = began + PATIENCE if steered else 0.0
            steering = False
            while (now := time.monotonic()) < until:
                for _ in vehicle.fly(now - began):
                    pass
                data = vehicle.listen(now - began)
                if data is not None:
                    vehicle.vehicle.receive(data)
                    if not steering and any(message_id(frame) == SETPOINT for frame in frames(data)):
                        steering, until = True, now + steered
            return spoke, memory(process.pid)
        finally:
            process.kill()
            process.wait()
            vehicle.close()


def main(arguments: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.bench_start", description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    times = parser.parse_args(arguments).times
    measured = [(processor_time(IMPORTS), processor_time(CHECK), fly("auto", 0.0)[0]) for _ in range(times)]
    bare, check, spoke = zip(*measured, strict=True)
    imports, checks = statistics.median(bare), statistics.median(check)
    print(f"numpy and pymavlink imported: {imports:.2f} s of CPU")
    print(f"circnav check: {checks:.2f} s of CPU, {checks / imports:.1f} times as much")
    print(f"circnav fly, first heartbeat after: median {statistics.median(spoke):.2f} s, worst {max(spoke):.2f} s")
    for law in ("smooth", "auto"):
        print(f"memory in flight, {law}: {fly(law, STEERED)[1]:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
