"""The estimators by their mission names."""

from collections.abc import Callable

from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.guidance.estimators.measured import Measured
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator, DriftEstimator
from circnav_mav.guidance.estimators.unicycle import UnicycleEstimator

ESTIMATORS: dict[str, Callable[[EstimatorSettings], Estimator]] = {
    "kalman": KalmanRangeRate,
    "unicycle": UnicycleEstimator,
    "drift": DriftEstimator,
    "auto": AutoEstimator,
    "measured": Measured,
}


def default_estimator(law_name: str) -> str:
    """The estimator that a law wants: one that also finds the target, or range and range rate alone."""
    return law_name if law_name in ("auto", "drift") else "kalman"
