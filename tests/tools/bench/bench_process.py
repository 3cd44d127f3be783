"""Times and memory of `circnav fly` as a process of its own, in real time over UDP.

    python -m tests.tools.bench.bench_process                                # 5 of each
    python -m tests.tools.bench.bench_process --rows SIGTERM --seeds 1 30

The application flies the quickstart; the vehicle runs in this process. Prints median and worst of
each row: processor time to import numpy and pymavlink's dialect, and of `circnav check`; time to
the first heartbeat; resident memory while the application steers; time from a signal to the first
safe setpoint (no speed, no turn).
"""

import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

from tests.frames import read
from tests.process import ROOT, resident_mb
from tests.tools import cells
from tests.tools.bench.on_port import SETPOINT, VehicleOnPort, flown
from tests.tools.fault_link.frames import frames, message_id

MISSION = ROOT / "config" / "quickstart.toml"
PATIENCE = 60.0
FLY_FOR = 1.0
STEERED = 20.0
"""Time of steering before a signal (FLY_FOR), and before the memory is read (STEERED), s."""


def processor_time(*arguments: str) -> float:
    """Return the processor time of a Python process, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def wait_for(vehicle: VehicleOnPort, found: Callable[[Any], bool], until: float) -> float:
    """Return the time at which a matching setpoint is received, or infinity."""
    while vehicle.now < until:
        data = vehicle.turn()
        if any(message_id(frame) == SETPOINT and found(read(frame)) for frame in frames(data)):
            return vehicle.now
    return float("inf")


def first_heartbeat() -> float:
    """Return the time from the start of `circnav fly` to its first datagram, s."""
    with flown(MISSION) as (vehicle, _, _):
        while not vehicle.received and vehicle.now < PATIENCE:
            vehicle.turn()
        return vehicle.now


def memory(law: str) -> float:
    """Return the resident memory of a flight by a law, MB."""
    with flown(MISSION, "--set", f'guidance.law="{law}"') as (vehicle, process, _):
        wait_for(vehicle, lambda setpoint: True, PATIENCE)
        wait_for(vehicle, lambda setpoint: False, vehicle.now + STEERED)
        return resident_mb(process.pid)


def safe_after(number: signal.Signals) -> float:
    """Return the time from a signal to the safe setpoint, ms."""
    with flown(MISSION) as (vehicle, process, _):
        wait_for(vehicle, lambda setpoint: setpoint.vx > 0, PATIENCE)
        wait_for(vehicle, lambda setpoint: False, vehicle.now + FLY_FOR)
        sent = vehicle.now
        process.send_signal(number)
        safe_at = wait_for(
            vehicle, lambda setpoint: setpoint.vx == 0 and setpoint.yaw_rate == 0, sent + 5.0
        )
        process.wait(timeout=30)
        return 1000 * (safe_at - sent)


ROWS: dict[str, Callable[[], float]] = {
    "numpy and pymavlink imported, s of CPU": partial(
        processor_time, "-c", "import numpy; from pymavlink.dialects.v20 import all"
    ),
    "circnav check, s of CPU": partial(processor_time, "-m", "circnav_mav", "check", str(MISSION)),
    "first heartbeat after, s": first_heartbeat,
    "memory in flight, smooth, MB": partial(memory, "smooth"),
    "memory in flight, auto, MB": partial(memory, "auto"),
    "SIGTERM": partial(safe_after, signal.SIGTERM),
    "SIGINT": partial(safe_after, signal.SIGINT),
}
"""Rows of the table. The rows of signals: time to the safe setpoint, ms."""


def measured(row: str, number: int) -> cells.Result:
    return {"value": ROWS[row]()}


def main() -> None:
    """Print the table."""
    parser = cells.parser(__doc__, ROWS, (1, 5))
    parser.set_defaults(processes=1)
    values = {
        row: [one["value"] for one in found]
        for row, found in cells.flown(measured, parser.parse_args()).items()
    }
    rows = ((row, len(found), median(found), max(found)) for row, found in values.items())
    print(cells.table("of the process | times | median | worst", rows))


if __name__ == "__main__":
    main()
