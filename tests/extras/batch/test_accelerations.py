"""Measured accelerations in gusts: their benefit to the estimator, and the cost of false ones."""

from dataclasses import replace

import numpy as np

from circnav_mav.extras.batch.estimators import Auto
from circnav_mav.extras.batch.flight import ESTIMATION, ORBIT, Situation, fly_situation, policy
from circnav_mav.extras.batch.sensors import ImuNoise

LIES = ("honest", "frozen", "turned", "shaking", "biased")
"""Faults of measured accelerations. A batch flies eight flights of each."""


def in_gusts(imu: ImuNoise | None, told: tuple[str, ...]) -> tuple[dict[str, float], float]:
    """Return the median RMS radius error (m) by fault in gusts of 0.1 V, and the weight of the honest accelerations."""
    shakes, banks, lie = np.random.default_rng(3), [], np.repeat(told, 8)

    class Deceived(Auto):
        def observe(self, measured, true):
            if (change := measured.velocity_change) is not None:
                biased = change + 0.025 * np.array([np.cos(measured.psi), np.sin(measured.psi)])  # 0.5 m/s^2 in 0.05 s
                shaken = change + shakes.normal(0, 0.15, change.shape)  # 3 m/s^2
                lies = [change, 0 * change + 0.02, change[::-1], shaken, biased]
                chosen = np.select([lie == one for one in LIES], lies)
                measured = replace(measured, velocity_change=chosen)
            super().observe(measured, true)

    def make(sense):
        guidance = policy("auto")(sense)
        guidance.estimator = Deceived(ESTIMATION, sense.size, ORBIT.speed)
        banks.append(guidance.estimator)
        return guidance

    gusts = Situation("gusts", wind=5.0, gust=1.5, imu=imu, start=(80, 150), duration=110.0)
    tracks = fly_situation(gusts, make, lie.size, 5)
    rms = np.sqrt(((tracks.r[tracks.time > 60] - 100.0) ** 2).mean(axis=0))
    believed = banks[0]._banks[0].assumed[2, lie == "honest"].mean()
    return {one: float(np.median(rms[lie == one])) for one in told}, float(believed)


def test_accelerations_show_a_gust_before_the_ranges_do_and_those_that_lie_cost_little():
    without = in_gusts(None, LIES[:1])[0]["honest"]
    felt, believed = in_gusts(ImuNoise(), LIES)
    assert felt.pop("honest") < 0.6 * without
    assert believed > 0.9
    assert max(felt.values()) < 1.25 * without, felt
