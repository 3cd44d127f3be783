"""The estimators by their mission names."""

from collections.abc import Callable

from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings, Fused
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator, DriftEstimator
from circnav_mav.guidance.estimators.unicycle import UnicycleEstimator
from circnav_mav.guidance.types import RangeEstimate, RangeSample, RateSample

APART = 0.25
"""Most time, s, between the newest range and the newest rate that may steer."""


class Measured(Estimator):
    """`measured`: range and range rate as the radio measures them, with no filter in between: the paper as written. An
    outlier steers, too, until the next."""

    nis: float | None = None

    def __init__(self, settings: EstimatorSettings) -> None:
        self.reset()

    def reset(self) -> None:
        self._range: RangeSample | None = None
        self._rate: RateSample | None = None

    @property
    def ready(self) -> bool:
        """Whether there are both, of about one moment."""
        return self._range is not None and self._rate is not None and abs(self._range.time - self._rate.time) <= APART

    def observe(self, sample: RangeSample) -> Fused:
        self._range = sample
        self._rate = sample.rate or self._rate
        return Fused.ACCEPTED

    def observe_rate(self, sample: RateSample) -> None:
        self._rate = sample

    def at(self, time: float) -> RangeEstimate | None:
        """What was measured last; None before there are both."""
        if self._range is None or self._rate is None:
            return None
        return RangeEstimate(time, self._range.r, self._rate.r_dot, self._range.sigma, self._rate.sigma)


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
