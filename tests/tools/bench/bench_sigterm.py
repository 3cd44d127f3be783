"""python -m tests.tools.bench.bench_sigterm [--times 30] [--signal TERM]:

time from the signal to the safe setpoint, over UDP.

The application flies the quickstart in a separate process. The vehicle runs in this process and
records the arrival of the first safe setpoint (no speed, no turn) after the signal.
"""

import argparse
import signal
import statistics
import sys
from collections.abc import Callable
from typing import Any

from tests.frames import read
from tests.process import ROOT
from tests.tools.bench.on_port import SETPOINT, VehicleOnPort, flown
from tests.tools.fault_link.frames import frames, message_id

PATIENCE = 60.0
FLY_FOR = 1.0


def wait_for(vehicle: VehicleOnPort, found: Callable[[Any], bool], until: float) -> float:
    """Return the time at which a matching setpoint is received, or infinity."""
    while vehicle.now < until:
        data = vehicle.turn()
        if any(message_id(frame) == SETPOINT and found(read(frame)) for frame in frames(data)):
            return vehicle.now
    return float("inf")


def once(number: int) -> float:
    """Fly once and send the signal. Return the time from the signal to the safe setpoint, s."""
    with flown(ROOT / "config" / "quickstart.toml") as (vehicle, process, _):
        wait_for(vehicle, lambda setpoint: setpoint.vx > 0, PATIENCE)
        wait_for(vehicle, lambda setpoint: False, vehicle.now + FLY_FOR)
        sent = vehicle.now
        process.send_signal(number)
        safe_at = wait_for(
            vehicle, lambda setpoint: setpoint.vx == 0 and setpoint.yaw_rate == 0, sent + 5.0
        )
        process.wait(timeout=30)
        return safe_at - sent


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.bench.bench_sigterm", description=__doc__
    )
    parser.add_argument("--times", type=int, default=30)
    parser.add_argument("--signal", default="TERM", choices=("TERM", "INT"))
    options = parser.parse_args(arguments)
    number = signal.Signals[f"SIG{options.signal}"]
    took = sorted(1000 * once(number) for _ in range(options.times))
    print(
        f"SIG{options.signal} to safe setpoint, {len(took)} times: median"
        f" {statistics.median(took):.1f} ms, ",
        end="",
    )
    print(f"worst {took[-1]:.1f} ms")
    return 0 if took[-1] < 100 else 1


if __name__ == "__main__":
    sys.exit(main())
