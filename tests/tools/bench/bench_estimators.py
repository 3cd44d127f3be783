"""python -m tests.tools.bench.bench_estimators: time of an estimator step on this machine."""

import time
from collections.abc import Callable

import numpy as np

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_ekf import (
    STATES,
    Hypotheses,
    Noise,
    mixture,
    predict,
    update,
)
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


def bank_step(count: int) -> Callable[[int], object]:
    """Return a Kalman step of this many hypotheses."""
    x = np.zeros((STATES, count, 1))
    x[0], x[1, :, 0], x[4] = 100.0, np.arange(count), 1.0
    h = Hypotheses(
        x, np.repeat(np.eye(STATES)[..., None, None], count, axis=2), np.zeros((count, 1))
    )
    noise = Noise(*(np.full((count, 1), value) for value in (1e-2, 1.5, 0.7, 0.7)))
    path = np.ones((2, 1))
    z = np.array([100.0])
    sigma = np.array([0.5])
    valid = np.array([True])
    dt = np.array([0.05])
    return lambda number: mixture(
        update(predict(h, noise, dt, path, sigma), noise, z, sigma, valid, 5.0)[0]
    )


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
    print(f"one step of 32 hypotheses: {np.median(timed(bank_step(32), 400)):.0f} us")
    times = timed(in_flight(), 1200)
    print(
        "the auto estimator at 20 Hz, own motion, range and estimate: median"
        f" {np.median(times):.0f} us, 99th percentile {np.percentile(times, 99):.0f} us,"
        f" {times.mean() * 20 / 1e4:.1f} % of a core"
    )
