"""What a campaign costs: batch flights of 400 s per second and core, and memory, beside the same flights in lockstep;
law `smooth` with ranges at 20 Hz, and `auto`, a tenth of the flights, at 10 Hz. CPU times of one process. Prints.

    python -m tests.bench.bench_campaign [FLIGHTS]
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from circnav_mav.experiments.campaign.file import load_campaign
from circnav_mav.experiments.campaign.fly import chunks, fly_chunk
from circnav_mav.experiments.campaign.lockstep import fly_lockstep
from circnav_mav.experiments.campaign.plan import prepare

ALONE = 3
"""Flights in lockstep whose mean time is told."""
FILE = """
mission = "{mission}"
runs = {runs}
vary."start.range_m" = {{uniform = [20, 500]}}
vary."start.bearing_deg" = {{uniform = [0, 360]}}
vary."start.heading_deg" = {{uniform = [0, 360]}}
vary."limits.duration_s" = [400.0]
vary."guidance.law" = ["{law}"]
vary."ranging.rate_hz" = [{rate}]
vary."sim.ranging.rate_hz" = [{rate}]
vary."sim.wind.speed_mps" = [0.0]
"""


def measure(law: str, rate: float, runs: int) -> None:
    """Fly, print. Missions are read and checked, figures made."""
    mission = Path(__file__).parents[2] / "config" / "campaign_mission.toml"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(FILE.format(mission=mission, runs=runs, law=law, rate=rate), encoding="utf-8")
        campaign = load_campaign(path)
    began = time.process_time()
    for number in range(ALONE):
        fly_lockstep(prepare(campaign, number))
    alone, began = (time.process_time() - began) / ALONE, time.process_time()
    rows = [row for chunk in chunks(campaign) for row in fly_chunk(campaign, chunk)]
    seconds = time.process_time() - began
    assert {row["engine"] for row in rows} == {"batch"}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"law {law}, ranges at {rate:.0f} Hz: batch of {runs}: {seconds:.1f} s, {runs / seconds:.1f} flights/s a core, "
        f"peak memory {peak:.0f} MB; {alone:.1f} s a flight in lockstep: {alone * runs / seconds:.0f} times faster; "
        f"kept {100 * np.mean([row['kept'] is True for row in rows]):.1f} %"
    )


if __name__ == "__main__":
    flights = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    measure("smooth", 20.0, flights)
    measure("auto", 10.0, max(flights // 10, ALONE))
