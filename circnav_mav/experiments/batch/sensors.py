"""What the vehicles of a batch measure: ranges with the errors of real radios, heading and airspeed with theirs."""

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any


@dataclass(frozen=True, slots=True)
class Ranging:
    """white: standard deviation, m. drifting: of a Gauss-Markov error with correlation time drift_time, s.

    every: simulation steps from sample to sample. loss: share that never arrives. outlier_share: share that is off
    by +-outlier, m. outage: s without samples in every minute. near_bias: m of bias at zero range, gone at 50 m.
    """

    white: float = 0.5
    drifting: float = 0.0
    drift_time: float = 2.0
    every: int = 1
    loss: float = 0.0
    outlier_share: float = 0.0
    outlier: float = 20.0
    outage: float = 0.0
    near_bias: float = 0.0

    @property
    def sigma(self) -> float:
        """What the radio says of itself: the standard deviation of all of it, m."""
        return float(np.hypot(self.white, self.drifting))


GAUSSIAN = Ranging()
UWB = Ranging(white=0.02, drifting=0.15)
LORA = Ranging(white=1.0, drifting=2.0, every=2, loss=0.1, near_bias=3.0)
PRESETS = {"gaussian": GAUSSIAN, "uwb": UWB, "lora": LORA}


@dataclass(frozen=True, slots=True)
class Compass:
    """bias: rad, either sign. drift: rad/s, either sign."""

    bias: float = 0.0
    drift: float = 0.0


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Standard deviations of what an autopilot reports of its own motion, white from step to step. heading: rad.
    turn_rate: rad/s. airspeed: m/s. Defaults: what real autopilots show in still flight."""

    heading: float = 0.02
    turn_rate: float = 0.01
    airspeed: float = 0.3

    def draw(self, flights: int, rng: np.random.Generator) -> Array:
        """Errors of heading, turn rate and airspeed in one step, (3, B)."""
        sigma = np.array([self.heading, self.turn_rate, self.airspeed])
        return sigma[:, None] * rng.standard_normal((3, flights))


NO_NOISE = MotionNoise(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """Standard deviations of measured accelerations, m/s^2. white: from step to step. bias: constant in a flight,
    forward and to the left: of the sensor, and of the attitude that frees it of gravity."""

    white: float = 0.2
    bias: float = 0.1


class Imu:
    """Accelerometers of B flights."""

    def __init__(self, noise: ImuNoise, flights: int, rng: np.random.Generator) -> None:
        self._noise, self._rng = noise, rng
        self._bias = noise.bias * rng.standard_normal((2, flights))

    def measure(self, change: Array, psi: Array, compass: Array, dt: float) -> Array:
        """The change of the velocity (2, B), m/s, in a step, as it is felt by a vehicle with its nose at psi (B,), rad,
        and turned by what its compass says."""
        error = (self._bias + self._noise.white * self._rng.standard_normal(change.shape)) * dt
        c, s = np.cos(psi), np.sin(psi)
        x, y = change[0] + c * error[0] - s * error[1], change[1] + s * error[0] + c * error[1]
        c, s = np.cos(compass), np.sin(compass)
        return np.stack([c * x - s * y, s * x + c * y])


class Radio:
    """Ranges of B flights."""

    def __init__(self, ranging: Ranging, flights: int, rng: np.random.Generator) -> None:
        self._ranging, self._rng = ranging, rng
        self._error = ranging.drifting * rng.standard_normal(flights)
        self._outage_from = rng.uniform(20.0, 60.0, flights)

    def measure(self, r: Array, step: int, dt: float) -> tuple[Array, Array]:
        """Ranges (B,) and which of them arrived (B,). Called once in every simulation step."""
        cfg, rng = self._ranging, self._rng
        if cfg.drifting:
            keep = np.exp(-dt / cfg.drift_time)
            self._error = keep * self._error + cfg.drifting * np.sqrt(1 - keep**2) * rng.standard_normal(r.shape)
        z = r + self._error + cfg.white * rng.standard_normal(r.shape)
        z = z + cfg.near_bias * np.maximum(1 - r / 50.0, 0.0)
        arrived = np.full(r.shape, step % cfg.every == 0)
        if cfg.outlier_share:
            wild = rng.random(r.shape) < cfg.outlier_share
            z = z + wild * cfg.outlier * rng.choice([-1.0, 1.0], r.shape)
        if cfg.loss:
            arrived &= rng.random(r.shape) >= cfg.loss
        if cfg.outage:
            arrived &= (step * dt - self._outage_from) % 60.0 >= cfg.outage
        return np.maximum(z, 0.1), arrived
