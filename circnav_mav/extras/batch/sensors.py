"""Sensors of a batch: ranges with the errors of real radios, heading, turn rate and airspeed with noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from circnav_mav.extras.batch.world import Draws, turned
from circnav_mav.guidance.maths import MAX_SIGMA_GROWTH, Array


@dataclass(frozen=True, slots=True)
class Ranging:
    """Errors of radios; numbers or arrays (B,).

    white: standard deviation of white noise, m. drifting: standard deviation of a Gauss-Markov error with correlation
    time drift_time, s. bias: m. loss: fraction of lost samples. outlier_share: fraction of samples with an error of up
    to ±outlier, m. near_bias: bias at zero range, m; it falls to 0 at `near`, m. farthest: maximum range, m; beyond
    0.85 of it gaps of `gap` s begin at gap_rate, 1/s. outage: time without samples in every minute, s. every:
    simulation steps per sample.
    """

    white: Array = 0.5
    drifting: Array = 0.0
    drift_time: Array = 2.0
    bias: Array = 0.0
    loss: Array = 0.0
    outlier_share: Array = 0.0
    outlier: Array = 20.0
    near_bias: Array = 0.0
    near: Array = 50.0
    farthest: Array = np.inf
    gap_rate: Array = 0.0
    gap: Array = 2.0
    outage: float = 0.0
    every: int = 1

    @property
    def sigma(self) -> Array:
        """Standard deviation of white and drifting error together, m."""
        return np.hypot(self.white, self.drifting)


UWB = Ranging(white=0.02, drifting=0.15, drift_time=3.0)
LORA = Ranging(white=1.0, drifting=2.0, drift_time=5.0, every=2, loss=0.1, near_bias=3.0)


@dataclass(frozen=True, slots=True)
class RateNoise:
    """Standard deviations of measured range rates, m/s.

    white: independent from sample to sample. bias: the carrier's offset, with correlation time bias_time, s.
    """

    white: float = 0.3
    bias: float = 0.0
    bias_time: float = 60.0

    @property
    def sigma(self) -> float:
        """Standard deviation of white noise and bias together, m/s."""
        return float(np.hypot(self.white, self.bias))


@dataclass(frozen=True, slots=True)
class Reading:
    """Processing of ranges in the receiver; numbers or arrays (B,), m.

    sigma: standard deviation, reported or assumed. most: largest accepted range. height: height above the target, used
    to compute the horizontal range.
    """

    sigma: Array
    most: Array = np.inf
    height: Array = 0.0


class Radio:
    """Radios of B flights. height (B,): height of the vehicles above their targets, m."""

    def __init__(
        self, ranging: Ranging, reading: Reading, seeds: Sequence[Sequence[int]], height: Array = 0.0,
        rates: RateNoise | None = None,
    ) -> None:  # fmt: skip
        """rates: noise of the range rates that are sent with the ranges; None: ranges only."""
        self._ranging, self._reading, self._height, self._rates = ranging, reading, height, rates
        self._draws = Draws(seeds, 1, 2, 5)
        first = self._draws.next()
        self._error, self._outage_from = ranging.drifting * first[0], 20.0 + 40.0 * first[2]
        self._gap_until = np.zeros(len(seeds))
        self._newest = np.zeros(len(seeds)), np.ones(len(seeds))
        if rates is not None:
            self._carrier = Draws(seeds, 5, 2)
            self._offset = rates.bias * self._carrier.next()[0]

    def measure_rate(self, r_dot: Array, step: int, dt: float) -> tuple[Array, float] | None:
        """Return the measured range rates (B,), m/s, and their standard deviation; None in a step without a sample.

        Call once per simulation step. r_dot: true horizontal range rates (B,), m/s.
        """
        noise, every = self._rates, self._ranging.every
        if noise is None or step % every:
            return None
        white, fresh = self._carrier.next()
        kept = np.exp(-dt * every / noise.bias_time)
        self._offset = kept * self._offset + noise.bias * np.sqrt(1 - kept**2) * fresh
        return r_dot + self._offset + noise.white * white, noise.sigma

    def measure(self, r: Array, step: int, dt: float) -> tuple[Array, Array, Array]:
        """Return the measured horizontal ranges (B,), their standard deviations, and True where a range was accepted.

        Call once per simulation step. r: true horizontal ranges (B,), m.
        """
        cfg, now = self._ranging, step * dt
        if step % cfg.every:
            return *self._newest, np.zeros(r.shape, bool)
        white, fresh, lost, wild, spread, gap, _ = self._draws.next()
        kept = np.exp(-dt * cfg.every / cfg.drift_time)
        self._error = kept * self._error + cfg.drifting * np.sqrt(1 - kept**2) * fresh
        slant = np.hypot(r, self._height)
        begins = (slant > 0.85 * cfg.farthest) & (gap < cfg.gap_rate * dt * cfg.every)
        self._gap_until = np.where(begins, now + cfg.gap, self._gap_until)
        arrived = (lost >= cfg.loss) & (slant <= cfg.farthest) & (now >= self._gap_until)
        if cfg.outage:
            arrived &= (now - self._outage_from) % 60.0 >= cfg.outage
        z = slant + cfg.bias + self._error + cfg.white * white
        z = z + cfg.near_bias * np.maximum(1 - slant / cfg.near, 0.0)
        z = z + (wild < cfg.outlier_share) * cfg.outlier * (2 * spread - 1)
        # from here on as in `maths.horizontal` and in the range reader of the flight stack
        z, reading = np.maximum(z, 0.0), self._reading
        rho = np.sqrt(np.maximum(z**2 - reading.height**2, 1e-9))
        growth = np.where(reading.height > 0, z / rho, 1.0)
        counts = (z > 0) & (z <= reading.most) & (growth <= MAX_SIGMA_GROWTH)
        self._newest = rho, reading.sigma * growth
        return *self._newest, arrived & counts


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Standard deviations of an autopilot's reports of its own motion, independent from step to step.

    heading: rad. turn_rate: rad/s. airspeed: m/s. The defaults are those of real autopilots in calm air.
    """

    heading: float = 0.02
    turn_rate: float = 0.01
    airspeed: float = 0.3


NO_NOISE = MotionNoise(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """Standard deviations of measured accelerations, m/s^2.

    white: independent from step to step. bias: constant in a flight, forward and to the left; it contains the attitude
    error in the compensation of gravity.
    """

    white: float = 0.2
    bias: float = 0.1


class MotionSensors:
    """Reports of B autopilots on their own motion: compass bias (rad) and drift (rad/s), airspeed scale, noise.

    Accelerations are measured if `imu` is given.
    """

    def __init__(
        self, noise: MotionNoise, seeds: Sequence[Sequence[int]], bias: Array = 0.0, drift: Array = 0.0,
        airspeed_scale: Array = 1.0, imu: ImuNoise | None = None,
    ) -> None:  # fmt: skip
        self._sigma = np.array([[noise.heading], [noise.turn_rate], [noise.airspeed]])
        self._bias, self._drift, self._scale = bias, drift, airspeed_scale
        self._draws = Draws(seeds, 2, 3) if self._sigma.any() else None
        self._imu = imu
        self._before: tuple[Array, Array, float] | None = None
        if imu is not None:
            self._shakes = Draws(seeds, 4, 2)
            self._imu_bias = imu.bias * self._shakes.next()

    def report(self, psi: Array, turn_rate: Array, airspeed: Array, now: float) -> tuple[Array, Array, Array]:
        """Return heading, turn rate and airspeed as reported."""
        errors = self._sigma if self._draws is None else self._sigma * self._draws.next()
        heading = psi + self._bias + self._drift * now
        return heading + errors[0], turn_rate + errors[1], airspeed * self._scale + errors[2]

    def velocity_change(self, psi: Array, velocity: Array, now: float) -> Array | None:
        """Return the change of the velocity since the last call (2, B), m/s, from accelerometers and compass.

        psi: true heading, rad. None without an `imu` and at the first call.
        """
        before, self._before = self._before, (psi, velocity, now)
        if self._imu is None or before is None:
            return None
        dt = now - before[2]
        wrong = (self._imu_bias + self._imu.white * self._shakes.next()) * dt
        nose = (psi + before[0]) / 2
        return turned(velocity - before[1] + turned(wrong, nose), self._bias + self._drift * now)
