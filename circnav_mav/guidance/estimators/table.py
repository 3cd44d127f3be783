"""Estimators by their names in mission files."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.guidance.own_code import NameTable, checked
from circnav_mav.guidance.types import RangeEstimate, RangeSample, RateSample

APART = 0.25
"""Longest time, s, between the newest range and the newest range rate. If they are farther apart,
they do not steer."""


class MeasuredRate(Estimator):
    """`measured`: range and range rate as measured by the radio, unfiltered, as in the paper. An
    outlier affects the command until the next sample."""

    nis: float | None = None

    def __init__(self, settings: EstimatorSettings) -> None:
        self.reset()

    def reset(self) -> None:
        self._range: RangeSample | None = None
        self._rate: RateSample | None = None

    @property
    def ready(self) -> bool:
        """True if range and range rate were measured at nearly the same time."""
        return (
            self._range is not None
            and self._rate is not None
            and abs(self._range.time - self._rate.time) <= APART
        )

    def observe(self, sample: RangeSample) -> bool:
        self._range = sample
        self._rate = sample.rate or self._rate
        return True

    def observe_rate(self, sample: RateSample) -> None:
        self._rate = sample

    def at(self, time: float) -> RangeEstimate | None:
        """Return the newest measurements, or None before both were received."""
        if self._range is None or self._rate is None:
            return None
        return RangeEstimate(
            time, self._range.r, self._rate.r_dot, self._range.sigma, self._rate.sigma
        )


MakeEstimator = Callable[[EstimatorSettings], Estimator]


def _own_estimator(name: str, make: Any) -> MakeEstimator:
    form = "a function from EstimatorSettings to an Estimator"
    return checked(name, make, form, lambda made: isinstance(made, Estimator))


def _imported(module: str, name: str) -> MakeEstimator:
    """Return an estimator of this package. Its module is imported when the estimator is built, so
    that checks of a mission do not wait for it."""

    def make(settings: EstimatorSettings) -> Estimator:
        estimators = import_module(f"circnav_mav.guidance.estimators.{module}")
        made: Estimator = getattr(estimators, name)(settings)
        return made

    return make


_BUILT_IN: dict[str, MakeEstimator] = {
    "kalman": _imported("range_rate", "KalmanRangeRate"),
    "drift": _imported("relative_motion", "DriftEstimator"),
    "auto": _imported("relative_motion", "AutoEstimator"),
    "measured": MeasuredRate,
}
ESTIMATORS = NameTable("circnav.estimators", _BUILT_IN, _own_estimator)
"""Estimators by their mission names."""


def default_estimator(law_name: str) -> str:
    """Return the default estimator of a law. Only `auto` and `drift` need the target's position."""
    return law_name if law_name in ("auto", "drift") else "kalman"
