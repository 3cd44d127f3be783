"""The estimators by their mission names."""

from collections.abc import Callable

from circnav_mav.core.estimators.drift import AutoEstimator, DriftEstimator
from circnav_mav.core.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.core.estimators.kalman import KalmanRangeRate
from circnav_mav.core.estimators.unicycle import UnicycleEstimator

ESTIMATORS: dict[str, Callable[[EstimatorSettings], Estimator]] = {
    "kalman": KalmanRangeRate,
    "unicycle": UnicycleEstimator,
    "drift": DriftEstimator,
    "auto": AutoEstimator,
}
