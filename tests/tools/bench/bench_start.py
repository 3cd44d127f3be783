"""python -m tests.tools.bench.bench_start [--times 5]:

time to the first heartbeat of `circnav fly`, cost of `check`, memory in flight.

Processor times are compared with the time to import numpy and pymavlink's dialect, measured
alternately in the same run. The flight is the quickstart in real time. Its memory is the resident
memory of the process while it steers. Prints figures without asserting.
"""

import argparse
import resource
import statistics
import subprocess
import sys

from tests.process import ROOT, resident_mb
from tests.tools.bench.on_port import SETPOINT, flown
from tests.tools.fault_link.frames import frames, message_id

MISSION = ROOT / "config" / "quickstart.toml"
IMPORTS = ["-c", "import numpy; from pymavlink.dialects.v20 import all"]
CHECK = ["-m", "circnav_mav", "check", str(MISSION)]
STEERED = 20.0
"""Time of steering before the memory is read, s."""
PATIENCE = 60.0


def processor_time(arguments: list[str]) -> float:
    """Return the processor time of a Python process, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def fly(law: str, steered: float) -> tuple[float, float]:
    """Start `circnav fly`. Return the time to its first heartbeat, s, and its memory, MB. steered:
    time of steering before the memory is read, s; 0: the memory is read at the first heartbeat."""
    with flown(MISSION, "--set", f'guidance.law="{law}"') as (vehicle, process, _):
        while not vehicle.received and vehicle.now < PATIENCE:
            vehicle.turn()
        spoke = vehicle.now
        until = PATIENCE if steered else 0.0
        steering = False
        while vehicle.now < until:
            data = vehicle.turn()
            if not steering and any(message_id(frame) == SETPOINT for frame in frames(data)):
                steering = True
                until = vehicle.now + steered
        return spoke, resident_mb(process.pid)


def main(arguments: list[str] | None = None) -> int:
    """Print the measured times and memory."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.bench.bench_start", description=__doc__
    )
    parser.add_argument("--times", type=int, default=5)
    times = parser.parse_args(arguments).times
    measured = [
        (processor_time(IMPORTS), processor_time(CHECK), fly("auto", 0.0)[0]) for _ in range(times)
    ]
    bare, check, spoke = zip(*measured, strict=True)
    imports = statistics.median(bare)
    checks = statistics.median(check)
    print(f"numpy and pymavlink imported: {imports:.2f} s of CPU")
    print(f"circnav check: {checks:.2f} s of CPU, {checks / imports:.1f} times as much")
    print(
        f"circnav fly, first heartbeat after: median {statistics.median(spoke):.2f} s, worst"
        f" {max(spoke):.2f} s"
    )
    for law in ("smooth", "auto"):
        print(f"memory in flight, {law}: {fly(law, STEERED)[1]:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
