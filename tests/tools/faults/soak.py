"""A long flight of `circnav fly`.

    python -m tests.tools.faults.soak [--hours 10] [--law smooth] [--profile copter]

The installed command in a separate process, with the bundled vehicle in lockstep. The 32-bit
milliseconds since boot of the autopilot and of the ranging radio wrap during the flight. Prints one
line for each hour: the circle by the simulator's truth, the gaps between setpoints, and the memory
of the process.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from circnav_mav.runlog.replay import SETPOINT_IDS
from circnav_mav.runlog.run_folder import open_run
from circnav_mav.runlog.ticks import Truth
from circnav_mav.runlog.tlog import message_id, read_tlog
from tests.process import ROOT, UNDRAWN, resident_mb

WRAP = 2**32 / 1000
"""Time after which a 32-bit millisecond counter wraps, s: 49.7 days."""
HOUR = 3600.0
SETTLING = 150.0
LOOK_EVERY = 0.2
"""Wall time between two readings of the process memory, s."""
Memory = list[tuple[float, float]]
"""List of (time of the flight, s; resident memory, MB)."""


def command(folder: Path, profile: str, law: str, seconds: float) -> tuple[str, ...]:
    """Return the command of the flight. The autopilot's clock wraps at a third of the flight, the
    radio's at two thirds."""
    changes = (
        f'guidance.law="{law}"',
        "sim.truth.rate_hz=1",
        f"sim.vehicle.boot_age_s={WRAP - seconds / 3}",
        f"sim.ranging.clock_offset_s={WRAP - 2 * seconds / 3}",
    )
    overrides = [word for change in changes for word in ("--set", change)]
    return ("fly", profile, "--duration", str(seconds), "--out", str(folder), *overrides)


def flown(folder: Path, profile: str, law: str, seconds: float) -> Iterator[tuple[float, float]]:
    """Yield flight time, s, and resident memory, MB, at intervals while a flight is flown into a
    folder."""
    arguments = [sys.executable, "-c", UNDRAWN, *command(folder, profile, law, seconds)]
    ticks = folder / "ticks.csv"
    with (folder.parent / "screen").open("w") as screen:
        process = subprocess.Popen(arguments, cwd=ROOT, stdout=screen, stderr=subprocess.STDOUT)
        try:
            while process.poll() is None:
                time.sleep(LOOK_EVERY)
                # the flight has no record yet, or the process has just ended
                with suppress(OSError, IndexError):
                    with ticks.open("rb") as file:
                        file.seek(max(ticks.stat().st_size - 2000, 0))
                        whole = file.read().split(b"\n")[1:-1]
                    yield float(whole[-1].split(b",")[0]), resident_mb(process.pid)
        finally:
            process.kill()
            process.wait()


def memory_slope(memory: Memory) -> float:
    """Return the growth of the memory, MB/h, without the first fifth and the end of the flight."""
    end = memory[-1][0]
    late = [(at / HOUR, mb) for at, mb in memory if end / 5 < at < end]
    return float(np.polyfit(*zip(*late, strict=True), 1)[0])


def account(truth: Truth, setpoints: np.ndarray, since: float, until: float, desired: float) -> str:
    """Return the figures of the circle, and the gaps between setpoints, of a part of the flight."""
    seen = (truth.time >= since) & (truth.time < until)
    error = truth.radius[seen] - desired
    gaps = 1000 * np.diff(setpoints[(setpoints >= since) & (setpoints < until)])
    if not len(error) or not len(gaps):
        return "too short to be judged"
    rms = float(np.sqrt(np.mean(error**2)))
    return (
        f"RMS {rms:.2f} m ({100 * rms / desired:.1f} %), worst {np.abs(error).max():.2f} m, "
        f"setpoint gaps median {np.median(gaps):.0f} ms, worst {gaps.max():.0f} ms"
    )


def soak(folder: Path, profile: str, law: str, seconds: float) -> Iterator[str]:
    """Fly and report each hour. At the end report the circle, the recording and the end of the
    flight."""
    memory: Memory = []
    for at, mb in flown(folder, profile, law, seconds):
        if memory and at // HOUR > memory[-1][0] // HOUR:
            yield f"{at / HOUR:6.2f} h: memory {mb:.1f} MB"
        memory.append((at, mb))
    yield (folder.parent / "screen").read_text()[-1000:].rpartition("mode ")[2]
    end = memory[-1][0]
    ended = max(mb for at, mb in memory if at == memory[-1][0])
    yield f"memory slope {memory_slope(memory):+.3f} MB/h, at the end {ended:.1f} MB ({end:.0f} s)"
    run = open_run(folder)
    truth = run.truth
    radius = float(run.ticks.numbers["desired"][-1])
    assert truth is not None
    log = read_tlog(folder / "flight.tlog")
    sent = [stamp for stamp, frame in log if message_id(frame) in SETPOINT_IDS]
    setpoints = (np.array(sent) - run.epoch_us) / 1e6
    edges = [SETTLING, *np.arange(HOUR, truth.time[-1], HOUR), truth.time[-1]]
    for since, until in pairwise(edges):
        yield (
            f"{since / HOUR:6.2f} to {until / HOUR:.2f} h:"
            f" {account(truth, setpoints, since, until, radius)}"
        )
    yield (
        f"ranges rejected {run.summary['samples_rejected']}, recording:"
        f" {run.summary['recording_problem'] or 'whole'}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--law", default="smooth")
    parser.add_argument("--profile", default="copter")
    options = parser.parse_args()
    print(f"{options.hours:g} h of {options.profile}, law {options.law}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for line in soak(Path(folder) / "run", options.profile, options.law, options.hours * HOUR):
            print(line, flush=True)


if __name__ == "__main__":
    main()
