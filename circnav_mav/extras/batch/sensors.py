"""What the vehicles of a batch measure: ranges with the errors of real radios, heading and airspeed with theirs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from circnav_mav.extras.batch.world import Draws, turned
from circnav_mav.guidance.maths import MAX_SIGMA_GROWTH, Array


@dataclass(frozen=True, slots=True)
class Ranging:
    """How radios err; numbers or arrays (B,). white: standard deviation, m. drifting: of a Gauss-Markov error with
    correlation time drift_time, s. bias: m. loss: share of samples that never arrives. outlier_share: share that is off
    by up to +-outlier, m. near_bias: bias at zero range, gone at `near`, m. farthest: m; from 0.85 of it on gaps of
    `gap` s come gap_rate times a second. outage: s without samples in every minute. every: simulation steps from sample
    to sample."""

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
        """The standard deviation of all of it, m."""
        return np.hypot(self.white, self.drifting)


UWB = Ranging(white=0.02, drifting=0.15, drift_time=3.0)
LORA = Ranging(white=1.0, drifting=2.0, drift_time=5.0, every=2, loss=0.1, near_bias=3.0)


@dataclass(frozen=True, slots=True)
class RateNoise:
    """Standard deviations of measured range rates, m/s. white: from sample to sample. bias: of an error that lasts,
    with correlation time bias_time, s: the carrier's offset."""

    white: float = 0.3
    bias: float = 0.0
    bias_time: float = 60.0

    @property
    def sigma(self) -> float:
        """The standard deviation of all of it, m/s."""
        return float(np.hypot(self.white, self.bias))


@dataclass(frozen=True, slots=True)
class Reading:
    """What a receiver makes of ranges; numbers or arrays (B,), m. sigma: standard deviation, reported or assumed.
    most: largest range that counts. height: above the target, by which slant ranges are made horizontal."""

    sigma: Array
    most: Array = np.inf
    height: Array = 0.0


class Radio:
    """Ranges of B flights. height (B,): of the vehicles above their targets, m."""

    def __init__(
        self, ranging: Ranging, reading: Reading, seeds: Sequence[Sequence[int]], height: Array = 0.0,
        rates: RateNoise | None = None,
    ) -> None:  # fmt: skip
        """rates: of the range rates that come with the ranges; None: there are none."""
        self._ranging, self._reading, self._height, self._rates = ranging, reading, height, rates
        self._draws = Draws(seeds, 1, 2, 5)
        first = self._draws.next()
        self._error, self._outage_from = ranging.drifting * first[0], 20.0 + 40.0 * first[2]
        self._deaf_until = np.zeros(len(seeds))
        self._newest = np.zeros(len(seeds)), np.ones(len(seeds))
        if rates is not None:
            self._carrier = Draws(seeds, 5, 2)
            self._offset = rates.bias * self._carrier.next()[0]

    def measure_rate(self, r_dot: Array, step: int, dt: float) -> tuple[Array, float] | None:
        """Of horizontal range rates (B,), m/s, what is measured, and its standard deviation; None where nothing is.
        Called once in every simulation step."""
        noise, every = self._rates, self._ranging.every
        if noise is None or step % every:
            return None
        white, fresh = self._carrier.next()
        kept = np.exp(-dt * every / noise.bias_time)
        self._offset = kept * self._offset + noise.bias * np.sqrt(1 - kept**2) * fresh
        return r_dot + self._offset + noise.white * white, noise.sigma

    def measure(self, r: Array, step: int, dt: float) -> tuple[Array, Array, Array]:
        """Of horizontal ranges (B,) what is read, its standard deviation, and which of them count, (B,). Called once in
        every simulation step."""
        cfg, now = self._ranging, step * dt
        if step % cfg.every:
            return *self._newest, np.zeros(r.shape, bool)
        white, fresh, lost, wild, spread, gap, _ = self._draws.next()
        kept = np.exp(-dt * cfg.every / cfg.drift_time)
        self._error = kept * self._error + cfg.drifting * np.sqrt(1 - kept**2) * fresh
        slant = np.hypot(r, self._height)
        begins = (slant > 0.85 * cfg.farthest) & (gap < cfg.gap_rate * dt * cfg.every)
        self._deaf_until = np.where(begins, now + cfg.gap, self._deaf_until)
        arrived = (lost >= cfg.loss) & (slant <= cfg.farthest) & (now >= self._deaf_until)
        if cfg.outage:
            arrived &= (now - self._outage_from) % 60.0 >= cfg.outage
        z = slant + cfg.bias + self._error + cfg.white * white
        z = z + cfg.near_bias * np.maximum(1 - slant / cfg.near, 0.0)
        z = z + (wild < cfg.outlier_share) * cfg.outlier * (2 * spread - 1)
        # from here on as `maths.horizontal` and the reader of ranges do in flight
        z, reading = np.maximum(z, 0.0), self._reading
        rho = np.sqrt(np.maximum(z**2 - reading.height**2, 1e-9))
        growth = np.where(reading.height > 0, z / rho, 1.0)
        counts = (z > 0) & (z <= reading.most) & (growth <= MAX_SIGMA_GROWTH)
        self._newest = rho, reading.sigma * growth
        return *self._newest, arrived & counts


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Standard deviations of what an autopilot reports of its own motion, white from step to step. heading: rad.
    turn_rate: rad/s. airspeed: m/s. Defaults: what real autopilots show in still flight."""

    heading: float = 0.02
    turn_rate: float = 0.01
    airspeed: float = 0.3


NO_NOISE = MotionNoise(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """Standard deviations of measured accelerations, m/s^2. white: from step to step. bias: constant in a flight,
    forward and to the left: of the sensor, and of the attitude that frees it of gravity."""

    white: float = 0.2
    bias: float = 0.1


class OwnSenses:
    """What B autopilots report of their own motion: compass bias (rad) and drift (rad/s), airspeed scale, and noise.
    Accelerations where there is an `imu`."""

    def __init__(
        self, noise: MotionNoise, seeds: Sequence[Sequence[int]], bias: Array = 0.0, drift: Array = 0.0,
        airspeed_scale: Array = 1.0, imu: ImuNoise | None = None,
    ) -> None:  # fmt: skip
        self._sigma = np.array([[noise.heading], [noise.turn_rate], [noise.airspeed]])
        self._bias, self._drift, self._scale = bias, drift, airspeed_scale
        self._draws = Draws(seeds, 2, 3) if self._sigma.any() else None
        self._imu = imu
        self._felt_at: tuple[Array, Array, float] | None = None
        if imu is not None:
            self._shakes = Draws(seeds, 4, 2)
            self._imu_bias = imu.bias * self._shakes.next()

    def report(self, psi: Array, turn_rate: Array, airspeed: Array, now: float) -> tuple[Array, Array, Array]:
        """Heading, turn rate and airspeed as reported."""
        errors = self._sigma if self._draws is None else self._sigma * self._draws.next()
        heading = psi + self._bias + self._drift * now
        return heading + errors[0], turn_rate + errors[1], airspeed * self._scale + errors[2]

    def feel(self, psi: Array, velocity: Array, now: float) -> Array | None:
        """The change of the velocity (2, B), m/s, since the last call, as accelerometers tell it by a compass that
        errs; psi: true heading."""
        before, self._felt_at = self._felt_at, (psi, velocity, now)
        if self._imu is None or before is None:
            return None
        dt = now - before[2]
        wrong = (self._imu_bias + self._imu.white * self._shakes.next()) * dt
        nose = (psi + before[0]) / 2
        return turned(velocity - before[1] + turned(wrong, nose), self._bias + self._drift * now)
