"""python -m tests.tools.bench.bench_estimators: time of an estimator step on this machine."""

import time
from collections.abc import Callable

import numpy as np

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator
from circnav_mav.guidance.types import OwnMotion, RangeSample


def timed(step: Callable[[int], object], rounds: int) -> np.ndarray:
    """Return the times of a number of steps, us."""
    times = []
    for number in range(rounds):
        began = time.perf_counter()
        step(number)
        times.append(1e6 * (time.perf_counter() - began))
    return np.array(times)


def in_flight() -> Callable[[int], object]:
    """Return a step of an estimator with range samples from a turning vehicle at 20 Hz."""
    estimator = AutoEstimator(EstimatorSettings(15.0, 0.35))
    rng = np.random.default_rng(0)

    def step(number: int) -> None:
        t = 0.05 * number
        heading = 0.15 * t + (1 - np.cos(0.3 * t)) / 3
        turn = 0.15 + 0.1 * np.sin(0.3 * t)
        estimator.move(OwnMotion(t, float(heading), float(turn), 15.0))
        estimator.observe(
            RangeSample(t, t, float(200 + 50 * np.sin(0.1 * t) + rng.normal(0, 0.5)), 0.5)
        )
        estimator.at(t)

    return step


if __name__ == "__main__":
    times = timed(in_flight(), 1200)
    print(
        "the auto estimator at 20 Hz, own motion, range and estimate: median"
        f" {np.median(times):.0f} us, 99th percentile {np.percentile(times, 99):.0f} us,"
        f" {times.mean() * 20 / 1e4:.1f} % of a core"
    )
