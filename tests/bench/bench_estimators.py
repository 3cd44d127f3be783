"""python -m tests.bench.bench_estimators: what one step of the estimators costs on this machine."""

import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.relative_ekf import STATES, Hypotheses, Noise, mixture, predict, update
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator
from circnav_mav.guidance.types import OwnMotion, RangeSample

ROUNDS = 400


def tell_costs() -> str:
    """Median time of 32 hypotheses' Kalman step, of the whole `auto` estimator, and of one filterpy EKF of 8 states."""
    bank, reference = _median(_bank_step(32)), _median(_filterpy_step())
    observing = sorted(_in_flight(1200))
    middle, tail = observing[len(observing) // 2], observing[int(0.99 * len(observing))]
    return (
        f"one drift step of 32 hypotheses: {1e6 * bank:.0f} us, {bank / reference:.1f} filterpy EKF steps "
        f"({1e6 * reference:.0f} us)\n"
        f"the auto estimator at 20 Hz, own motion, range and estimate: median {1e6 * middle:.0f} us, "
        f"99th percentile {1e6 * tail:.0f} us, {100 * 20 * sum(observing) / len(observing):.1f} % of a core"
    )


def _median(step: Callable[[], object]) -> float:
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        step()
        times.append(time.perf_counter() - began)
    return sorted(times)[ROUNDS // 2]


def _bank_step(count: int) -> Callable[[], object]:
    x = np.zeros((STATES, count, 1))
    x[0], x[1, :, 0], x[4] = 100.0, np.arange(count), 1.0
    h = Hypotheses(x, np.repeat(np.eye(STATES)[..., None, None], count, axis=2), np.zeros((count, 1)))
    noise = Noise(*(np.full((count, 1), value) for value in (1e-2, 1.5, 0.7, 0.7)))
    path, z, sigma, valid = np.ones((2, 1)), np.array([100.0]), np.array([0.5]), np.array([True])
    dt = np.array([0.05])

    def step() -> object:
        return mixture(update(predict(h, noise, dt, path, sigma), noise, z, sigma, valid, 5.0)[0])

    return step


def _filterpy_step() -> Callable[[], object]:
    ekf = ExtendedKalmanFilter(dim_x=STATES, dim_z=1)
    ekf.x[0, 0], ekf.R = 100.0, np.array([[0.25]])
    H = np.eye(STATES)[[0]]

    def step() -> None:
        ekf.predict()
        ekf.update(np.array([[100.0]]), lambda _: H, lambda x: H @ x)

    return step


def _in_flight(steps: int) -> list[float]:
    """Times of an estimator that hears a target from a turning vehicle."""
    estimator, times = AutoEstimator(EstimatorSettings(15.0, 0.35)), []
    rng = np.random.default_rng(0)
    for i in range(steps):
        t = 0.05 * i
        turn = 0.15 + 0.1 * np.sin(0.3 * t)
        heading = 0.15 * t + (1 - np.cos(0.3 * t)) / 3
        r = 200 + 50 * np.sin(0.1 * t) + rng.normal(0, 0.5)
        began = time.perf_counter()
        estimator.move(OwnMotion(t, float(heading), float(turn), 15.0))
        estimator.observe(RangeSample(t, t, float(r), 0.5))
        estimator.at(t)
        times.append(time.perf_counter() - began)
    return times


if __name__ == "__main__":
    print(tell_costs())
