"""Interface of the estimators of range, range rate and relative motion."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RangeSample, RateSample


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """Settings of an estimator: properties of the vehicle and the sensor.

    speed: speed V of the vehicle, m/s.
    max_turn_rate: limit of the turn rate, rad/s.
    gate: innovation gate in standard deviations.
    restart_after: number of consecutive samples outside the gate, but consistent with each other,
        after which the filter restarts.
    min_samples: fewest samples before the estimate may steer.
    drift_sigma: typical drift, as a share of V. If a vehicle holds its ground speed, the drift is
        the target's motion alone.
    scale_sigma: standard deviation of the airspeed scale (true over measured airspeed).
    scale_bounds: lower and upper bound of the airspeed scale.
    acceleration_bias: standard deviation of the lasting error of measured accelerations, m/s^2.
    """

    speed: float
    max_turn_rate: float
    gate: float = 5.0
    restart_after: int = 5
    min_samples: int = 5
    drift_sigma: float = 0.2
    scale_sigma: float = 0.05
    scale_bounds: tuple[float, float] = (0.85, 1.15)
    acceleration_bias: float = 0.2


@dataclass(frozen=True, slots=True)
class MethodChange:
    """Change of the reported motion of a copter from motion over the ground to motion through the
    air.

    wind: velocity of the air over the ground, x and y, m/s.
    wind_sigma: standard deviation of each component of the wind, m/s.
    scale_sigma: standard deviation of the airspeed scale, which is 1 from now on.
    settings: estimator settings from now on.
    """

    wind: tuple[float, float]
    wind_sigma: float
    scale_sigma: float
    settings: EstimatorSettings


@runtime_checkable
class Estimator(Protocol):
    """Estimates range and range rate at any time from range samples."""

    @property
    def ready(self) -> bool:
        """True if the estimate may steer a vehicle."""

    @property
    def nis(self) -> float | None:
        """Normalized innovation squared of the newest sample, or None before the second sample."""

    def observe(self, sample: RangeSample) -> bool:
        """Add a sample, with its range rate if it has one. Return True if it was accepted, False if
        it was rejected, for example by a gate."""

    def observe_rate(self, sample: RateSample) -> None:
        """Add a measured range rate, which may arrive between ranges. Range rates are used only in
        addition to ranges."""

    def move(self, motion: OwnMotion) -> None:
        """Add own motion, which may arrive between ranges. Some estimators ignore own motion."""
        return

    def at(self, time: float) -> RangeEstimate | None:
        """Return the estimate predicted to a time of the local clock (s), or None before the first
        sample."""

    def fly_through_air(self, change: "MethodChange") -> None:
        """Continue with own motion through the air. Until now, own motion was over the ground.
        Estimators that do not use own motion ignore the change."""
        return

    def restamp(self) -> None:
        """Handle a jump of the sensor's clock. Estimators that use the sensor's timestamps start
        again."""
        return

    def reset(self) -> None:
        """Return to the initial state."""
