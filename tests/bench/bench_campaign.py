"""What a campaign costs: batch flights of 400 s at 20 Hz per second and core, and memory, beside the same flights
through a plain loop, one flight after the other. Prints.

    python -m tests.bench.bench_campaign [FLIGHTS]

The loop is what one would write without a batch: the emulator's sensor and airframe, the estimator and the law that
fly, one flight at a time, without MAVLink. It flies a sample of the flights, and its time is scaled up. And `auto`, a
tenth of the flights with ranges at 10 Hz, beside the same flights in lockstep. Times are CPU times of one process.
"""

import math
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from circnav_mav.emulator.airframes.unicycle import Unicycle
from circnav_mav.emulator.demands import BodyVelocity
from circnav_mav.emulator.sensor import RangeSensor
from circnav_mav.emulator.starting import starting_body
from circnav_mav.experiments.campaign.file import load_campaign
from circnav_mav.experiments.campaign.fly import chunks, fly_chunk
from circnav_mav.experiments.campaign.lockstep import fly_lockstep
from circnav_mav.experiments.campaign.plan import Campaign, Run, prepare
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.slant import horizontal
from circnav_mav.guidance.step import steering
from circnav_mav.guidance.types import RangeSample

SAMPLE = 6
TICK = 0.05
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


def plain_loop(run: Run) -> tuple[float, float]:
    """One flight, step by step; RMS radius error of its last third and closest approach, m."""
    orbit, config = run.mission.orbit, run.vehicle
    estimator, steer = KalmanRangeRate(run.mission.estimation), steering(orbit, run.mission.law)
    sensor, body = RangeSensor(config.ranging, config.seed), starting_body(config, (0.0, 0.0))
    airframe = Unicycle(math.radians(config.vehicle.max_turn_rate_deg_s), config.vehicle.turn_lag_s, 0.0)
    height, radii = run.mission.file.orbit.height_above_target_m or 0.0, []
    for step in range(round(run.mission.file.limits.duration_s / TICK)):
        now = step * TICK
        sample = sensor.measure(math.hypot(body.north, body.east, body.down), round(now * 1e6))
        flat = horizontal(sample.distance, 0.5, height) if sample else None
        if flat is not None:
            estimator.observe(RangeSample(now, now, *flat))
        estimate = estimator.at(now)
        turn = steer(estimate).turn_rate if estimate and estimator.ready else orbit.steady_turn_rate
        body = airframe.step(body, BodyVelocity(orbit.speed, yaw_rate=-turn), TICK)
        radii.append(math.hypot(body.north, body.east))
    late = radii[2 * len(radii) // 3 :]
    return math.sqrt(sum((r - orbit.radius) ** 2 for r in late) / len(late)), min(radii)


def batch(campaign: Campaign) -> tuple[float, list[dict[str, object]]]:
    """CPU seconds and rows of all flights of a campaign, missions read and checked, figures made."""
    began = time.process_time()
    rows = [row for chunk in chunks(campaign) for row in fly_chunk(campaign, chunk)]
    return time.process_time() - began, rows


def main() -> None:
    """Measure, print."""
    flights = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    campaigns = [campaign_of("smooth", 20.0, runs) for runs in (flights // 4, flights // 2, flights)]
    began = time.process_time()
    alone = [plain_loop(prepare(campaigns[0], number)) for number in range(SAMPLE)]
    per_flight = (time.process_time() - began) / SAMPLE
    print("law smooth, 400 s at 20 Hz, ranges at 20 Hz; CPU time of one process")
    print(f"plain loop: {per_flight:.2f} s a flight, mean of {SAMPLE} flights")
    for campaign in campaigns:
        seconds, rows = batch(campaign)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        assert {row["engine"] for row in rows} == {"batch"}
        print(
            f"batch of {len(rows)}: {seconds:.1f} s, {len(rows) / seconds:.0f} flights/s a core, "
            f"{1000 * seconds / len(rows):.2f} ms a flight, peak memory {peak:.0f} MB, "
            f"{per_flight * len(rows) / seconds:.0f} times faster (loop scaled up)"
        )
    for number, (rms, closest) in enumerate(alone[:3]):
        row = rows[number]
        print(f"flight {number}: RMS {rms:.3f} m alone, {row['rms_m']:.3f} m in the batch; closest {closest:.1f} m, "
              f"{row['closest_m']:.1f} m")  # fmt: skip
    kept = np.mean([row["kept"] is True for row in rows])
    print(f"kept {100 * kept:.1f} %")
    measure_auto(max(flights // 10, SAMPLE))


def campaign_of(law: str, rate: float, runs: int) -> Campaign:
    """Flights of one law with ranges at a rate, Hz."""
    mission = Path(__file__).parents[2] / "config" / "campaign_mission.toml"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(FILE.format(mission=mission, runs=runs, law=law, rate=rate), encoding="utf-8")
        return load_campaign(path)


def measure_auto(flights: int) -> None:
    """Measure `auto` in a batch and in lockstep, print."""
    campaign = campaign_of("auto", 10.0, flights)
    began = time.process_time()
    for number in range(SAMPLE // 2):
        fly_lockstep(prepare(campaign, number))
    per_flight = 2 * (time.process_time() - began) / SAMPLE
    seconds, rows = batch(campaign)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    assert {row["engine"] for row in rows} == {"batch"}
    kept = np.mean([row["kept"] is True for row in rows])
    print(
        f"law auto, ranges at 10 Hz: batch of {flights}: {seconds:.1f} s, {flights / seconds:.1f} flights/s a core, "
        f"peak memory {peak:.0f} MB; {per_flight:.1f} s a flight in lockstep: {per_flight * flights / seconds:.0f} "
        f"times faster; kept {100 * kept:.1f} %"
    )


if __name__ == "__main__":
    main()
