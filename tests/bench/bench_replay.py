"""What a replay costs: 600 s of the quickstart, recorded in lockstep and fed through the pilot again; under the law
that it flies (`auto`), and under the paper's first law. Prints.

    python -m tests.bench.bench_replay
"""

import tempfile
import time
from pathlib import Path

from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from circnav_mav.runlog.run_folder import open_run
from tests.flight.recorded import recorded_flight

SECONDS = 600
LAWS = {"auto": (), "smooth": ('guidance.law="smooth"', 'guidance.estimator="kalman"')}


def main() -> None:
    """Record, replay, print."""
    for law, settings in LAWS.items():
        with tempfile.TemporaryDirectory() as name:
            measure(law, Path(name), settings)


def measure(law: str, folder: Path, overrides: tuple[str, ...]) -> None:
    """One recording, replayed from its folder on the disk."""
    flight = recorded_flight(folder, "quickstart", f"limits.duration_s={SECONDS}", *overrides).fly(SECONDS + 10)
    assert flight.recorder is not None
    flight.recorder.close()
    began, cpu = time.perf_counter(), time.process_time()
    settings = parse_mission(open_run(folder).mission_text, "mission.toml").pilot_settings()
    done = replay(Pilot(settings), recorded_steps(folder))
    took, cpu = time.perf_counter() - began, time.process_time() - cpu
    sizes = ", ".join(f"{path.name} {path.stat().st_size / 1e6:.2f} MB" for path in sorted(folder.iterdir()))
    print(
        f"law {law}: {done.until:.0f} s replayed in {took:.2f} s ({cpu:.2f} s of CPU, {done.until / took:.0f} times as "
        f"fast as flown), identical: {done.identical}"
    )
    print(f"  {done.steps} turns, {done.frames} frames in, {len(done.sent)} out, {len(done.ticks)} ticks; {sizes}")


if __name__ == "__main__":
    main()
