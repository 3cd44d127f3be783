"""What every estimator of range rate offers."""

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RangeSample, RateSample


class Fused(Enum):
    """What became of a sample."""

    ACCEPTED = "accepted"
    GATED = "gated"


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """What the estimators know of the vehicle and the sensor.

    speed: V, m/s. max_turn_rate: rad/s. gate: innovation gate in standard deviations. restart_after: samples in a row
    outside the gate, agreeing with each other, that restart the filter. min_samples: before the estimate may steer.
    drift_sigma: usual drift, in V; scale_sigma: of true over measured airspeed. A vehicle that holds its speed over the
    ground drifts only as its target moves.
    """

    speed: float
    max_turn_rate: float
    gate: float = 5.0
    restart_after: int = 5
    min_samples: int = 5
    drift_sigma: float = 0.2
    scale_sigma: float = 0.05


class Estimator(Protocol):
    """Range samples in, range and range rate at any moment out."""

    @property
    def ready(self) -> bool:
        """Whether the estimate may steer a vehicle."""

    @property
    def nis(self) -> float | None:
        """Normalised innovation squared of the newest sample; None before the second."""

    def observe(self, sample: RangeSample) -> Fused:
        """Take one sample in, with its range rate where it has one, or refuse it."""

    def observe_rate(self, sample: RateSample) -> None:
        """Take in a measured range rate; it comes at its own times, and counts only beside ranges."""

    def move(self, motion: OwnMotion) -> None:
        """Take in own motion; it comes at its own times, and some estimators have no use for it."""
        return

    def at(self, time: float) -> RangeEstimate | None:
        """The estimate predicted to a moment of the local clock; None before the first sample."""

    def restamp(self) -> None:
        """The sensor's clock has jumped: only an estimator that goes by stamps has to begin anew."""
        return

    def reset(self) -> None:
        """Forget everything."""
