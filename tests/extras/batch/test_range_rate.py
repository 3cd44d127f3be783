"""The array filter of the batch, compared with filterpy's, which the flight uses."""

import numpy as np
import pytest

from circnav_mav.extras.batch.range_rate import RangeRate, observe, observe_rate
from circnav_mav.guidance.estimators.interface import EstimatorSettings, Fused
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.types import RangeSample, RateSample

V, TURN = 15.0, 0.35
SETTINGS = EstimatorSettings(speed=V, max_turn_rate=TURN)


def sequence(rng, count=300):
    """Return steps (s), ranges (m), their deviations (m), and range rates (m/s) of a vehicle that flies past a
    target. One range in 20 is an outlier, and two jumps restart the filter."""
    dt = rng.uniform(0.02, 0.4, count)
    t = np.cumsum(dt)
    r = np.hypot(-300 + V * t, 80.0) + np.where(t > rng.uniform(10, 20), 90.0, 0.0) - np.where(t > 35, 60.0, 0.0)
    sigma = rng.uniform(0.2, 2.0, count)
    z = np.abs(r + sigma * rng.normal(size=count) + np.where(rng.random(count) < 0.05, 60.0, 0.0))
    rates = np.gradient(r, t) + 0.2 * rng.normal(size=count) + np.where(rng.random(count) < 0.05, 30.0, 0.0)
    return dt, z, sigma, rates


@pytest.mark.parametrize("with_rates", [False, True], ids=["ranges", "ranges and rates"])
def test_arrays_of_flights_are_filtered_as_filterpy_filters_each_of_them(with_rates):
    """Equal to 1e-9, through ranges and rates that the gate rejects, and through restarts."""
    rng, flights = np.random.default_rng(11), 6
    dt, z, sigma, rates = (np.array(part).T for part in zip(*(sequence(rng) for _ in range(flights)), strict=True))
    now, alone = np.zeros(flights), [KalmanRangeRate(SETTINGS) for _ in range(flights)]
    together = RangeRate(*(np.full(flights, value) for value in RangeRate()))
    gated, restarts = 0, 0
    for step, (h, ranges, noise, measured) in enumerate(zip(dt, z, sigma, rates, strict=True)):
        now = now + h
        together = observe(together, SETTINGS, h=h if step else 0.0 * h, z=ranges, sigma=noise)
        fused = [
            kalman.observe(RangeSample(time, time, r, deviation))
            for kalman, time, r, deviation in zip(alone, now, ranges, noise, strict=True)
        ]
        assert [one is Fused.GATED for one in fused] == (together.refused > 0).tolist()
        begun = np.array([kalman.nis is not None for kalman in alone])
        nis = np.array([kalman.nis or 0.0 for kalman in alone])
        assert nis == pytest.approx(np.where(begun, together.nis, 0.0), rel=1e-9, abs=1e-9)
        gated, restarts = gated + fused.count(Fused.GATED), restarts + int(np.sum(together.samples == 1)) * (step > 0)
        if with_rates:
            together = observe_rate(together, SETTINGS, h=0.0 * h, z=measured, sigma=0.2)
            for kalman, time, r_dot in zip(alone, now, measured, strict=True):
                kalman.observe_rate(RateSample(time, time, r_dot, 0.2))
        assert together.ready(SETTINGS).tolist() == [kalman.ready for kalman in alone]
        state = np.array([(*kalman._filter.x[:, 0], *kalman._filter.P[np.triu_indices(2)]) for kalman in alone]).T
        for theirs, ours in zip(state, together[:5], strict=True):
            assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-9)
    assert gated > 50 and restarts >= 2 * flights
