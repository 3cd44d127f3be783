"""python -m tests.bench.bench_sigterm [--times 30] [--signal TERM]: from the signal to the safe setpoint, over UDP.

The application is a process of its own that flies the quickstart; the vehicle is flown here, on the same machine, and
notes when the first safe setpoint (no speed, no turn) arrives after the signal.
"""

import argparse
import signal
import statistics
import subprocess
import sys
import tempfile
import time

from sim.faults.frames import frames, message_id, read
from tests.bench.on_port import ROOT, SETPOINT, VehicleOnPort

MISSION = ROOT / "config" / "quickstart.toml"
PATIENCE = 60.0
FLY_FOR = 1.0


class Bench:
    """The vehicle, and when the application steers it and leaves it safe."""

    def __init__(self) -> None:
        self._link = VehicleOnPort(MISSION)
        self._started = time.monotonic()
        self.port = self._link.port
        self.steering_since: float | None = None
        self.safe_at: float | None = None

    def run(self, until: float) -> None:
        """Fly and listen until a moment of the monotonic clock, or a safe setpoint after steering ones."""
        while (now := time.monotonic()) < until and self.safe_at is None:
            for _ in self._link.fly(now - self._started):
                pass
            data = self._link.listen(now - self._started, at_most=until - now)
            if data is not None:
                self._note(data, time.monotonic())
                self._link.vehicle.receive(data)

    def _note(self, data: bytes, now: float) -> None:
        for frame in frames(data):
            if message_id(frame) == SETPOINT:
                message = read(frame)
                if message.vx > 0 and self.steering_since is None:
                    self.steering_since = now
                elif message.vx == 0 and message.yaw_rate == 0 and self.steering_since is not None:
                    self.safe_at = now

    def close(self) -> None:
        self._link.close()


def once(number: int) -> float:
    """One flight that is told to end; s from the signal to the safe setpoint."""
    bench = Bench()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "circnav_mav", "fly", str(MISSION), "--endpoint"]
        command += [f"udpout:127.0.0.1:{bench.port}", "--out", f"{folder}/run"]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
        try:
            deadline = time.monotonic() + PATIENCE
            while bench.steering_since is None and time.monotonic() < deadline and process.poll() is None:
                bench.run(time.monotonic() + 0.2)
            bench.run(time.monotonic() + FLY_FOR)
            sent = time.monotonic()
            process.send_signal(number)
            bench.run(sent + 5.0)
            process.wait(timeout=30)
        finally:
            process.kill()
            process.wait()
            bench.close()
    return bench.safe_at - sent if bench.safe_at is not None else float("inf")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.bench_sigterm", description=__doc__)
    parser.add_argument("--times", type=int, default=30)
    parser.add_argument("--signal", default="TERM", choices=("TERM", "INT"))
    options = parser.parse_args(arguments)
    number = signal.Signals[f"SIG{options.signal}"]
    took = sorted(1000 * once(number) for _ in range(options.times))
    print(f"SIG{options.signal} to safe setpoint, {len(took)} times: median {statistics.median(took):.1f} ms, ", end="")
    print(f"worst {took[-1]:.1f} ms")
    return 0 if took[-1] < 100 else 1


if __name__ == "__main__":
    sys.exit(main())
