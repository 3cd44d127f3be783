"""The estimators by their mission names."""

from collections.abc import Callable

from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator, DriftEstimator
from circnav_mav.guidance.estimators.unicycle import UnicycleEstimator

ESTIMATORS: dict[str, Callable[[EstimatorSettings], Estimator]] = {
    "kalman": KalmanRangeRate,
    "unicycle": UnicycleEstimator,
    "drift": DriftEstimator,
    "auto": AutoEstimator,
}
