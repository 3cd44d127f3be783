"""The estimators by their mission names."""

from collections.abc import Callable

from circnav_mav.core.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.core.estimators.kalman import KalmanRangeRate

ESTIMATORS: dict[str, Callable[[EstimatorSettings], Estimator]] = {
    "kalman": KalmanRangeRate,
}
