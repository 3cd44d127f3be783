"""The loop of a batch: B vehicles, one policy, one situation."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from circnav_mav.experiments.batch.sensors import GAUSSIAN, Compass, Imu, ImuNoise, MotionNoise, Radio, Ranging
from circnav_mav.experiments.batch.world import Air, Target, Targets, Wind, flown, turn_step
from circnav_mav.guidance.air_path import wrap

Array = Any


@dataclass(frozen=True, slots=True)
class Circle:
    """speed: V, m/s. radius: r_d, m. max_turn_rate: rad/s. lag: of the turn, s. start: range at first, m, uniform."""

    speed: float = 15.0
    radius: float = 100.0
    max_turn_rate: float = 0.35
    lag: float = 0.4
    start: tuple[float, float] = (10.0, 600.0)


@dataclass(frozen=True, slots=True)
class Situation:
    """Everything that makes one row of the benchmark. airspeed_error: measured over true minus 1, either sign."""

    name: str
    wind: Wind = field(default_factory=Wind)
    target: Target = field(default_factory=Target)
    ranging: Ranging = GAUSSIAN
    compass: Compass = field(default_factory=Compass)
    noise: MotionNoise = field(default_factory=MotionNoise)
    airspeed_error: float = 0.0
    imu: ImuNoise | None = None
    circle: Circle = field(default_factory=Circle)
    duration: float = 400.0
    dt: float = 0.05

    def lasting(self, duration: float) -> "Situation":
        """The same for so many seconds."""
        return replace(self, duration=duration)


@dataclass(frozen=True, slots=True)
class Seen:
    """What a policy gets in one step, arrays (B,): heading, turn rate, airspeed; range where arrived; felt (2, B):
    change of the velocity since the step before, m/s, by accelerometers."""

    dt: float
    psi: Array
    turn_rate: Array
    airspeed: Array
    z: Array
    sigma: Array
    arrived: Array
    felt: Array | None = None


@dataclass(frozen=True, slots=True)
class Truth:
    """What is true: p = vehicle - target (2, B), d = wind - target velocity (2, B), psi, turn_rate (B,)."""

    p: Array
    d: Array
    psi: Array
    turn_rate: Array


class Policy(Protocol):
    """An estimator and a law for B flights. For the metrics: `estimate` is (r, r') of the last step, `belief` the mean
    (2, B) and covariance (2, 2, B) of (r, theta), nan where there is no trust, None if it has none."""

    estimate: tuple[Array, Array]
    belief: tuple[Array, Array] | None

    def command(self, seen: Seen, true: Truth) -> Array:
        """Turn rates (B,), counter-clockwise positive. Only the full-information reference may look at `true`."""
        ...


Make = Callable[[Circle, Array], Policy]
"""Makes a policy for a circle and the senses of rotation (B,), +1 counter-clockwise."""


@dataclass(frozen=True, slots=True)
class Tracks:
    """What happened, arrays (N, B); time (N,). angle: of p, rad. nees: of (r, theta). sense (B,)."""

    time: Array
    r: Array
    r_dot: Array
    angle: Array
    turn_rate: Array
    command: Array
    r_hat: Array
    r_dot_hat: Array
    nees: Array
    sense: Array
    start: Truth


@dataclass(slots=True)
class World:
    """Where B flights are and what surrounds them. p: vehicle - target (2, B), m. psi, turn_rate: of the vehicle (B,).
    sense (B,): +1 counter-clockwise. airspeed (B,): as measured but for its noise, m/s. compass, compass_drift:
    its error, rad and rad/s. sigma (B,): what the radio says of itself, m. noise: draws the errors of own motion."""

    sense: Array
    p: Array
    psi: Array
    turn_rate: Array
    air: Air
    targets: Targets
    radio: Radio
    airspeed: Array
    compass: Array
    compass_drift: Array
    sigma: Array
    noise: np.random.Generator


def begin(situation: Situation, flights: int, seed: int) -> World:
    """The worlds of B flights at their start. One seed, one world."""
    cfg = situation.circle
    rng, noise, motion_noise = (np.random.default_rng([seed, part]) for part in (0, 1, 2))
    angle, psi = rng.uniform(0, 2 * np.pi, (2, flights))
    p = rng.uniform(*cfg.start, flights) * np.stack([np.cos(angle), np.sin(angle)])
    bias_sign, drift_sign, speed_sign = rng.choice([-1.0, 1.0], (3, flights))
    return World(
        sense=np.where(np.arange(flights) % 2 == 0, 1.0, -1.0),
        p=p,
        psi=psi,
        turn_rate=np.zeros(flights),
        air=Air(situation.wind, flights, rng),
        targets=Targets(situation.target, flights, rng),
        radio=Radio(situation.ranging, flights, noise),
        airspeed=cfg.speed * (1 + speed_sign * situation.airspeed_error),
        compass=bias_sign * situation.compass.bias,
        compass_drift=drift_sign * situation.compass.drift,
        sigma=np.full(flights, situation.ranging.sigma),
        noise=motion_noise,
    )


def fly(situation: Situation, make: Make, flights: int, seed: int) -> Tracks:
    """Fly B = flights of a situation; make(circle, sense (B,)) gives the policy."""
    return fly_in(begin(situation, flights, seed), situation, make)


def fly_in(world: World, situation: Situation, make: Make) -> Tracks:
    """Fly a situation from the start that the world says; the world goes along."""
    cfg, dt, w = situation.circle, situation.dt, world
    policy: Policy = make(cfg, w.sense)
    steps = round(situation.duration / dt)
    kept = {name: np.zeros((steps, w.sense.size), np.float32) for name in ROWS}
    start = None
    felt: Array | None = None
    imu = None if situation.imu is None else Imu(situation.imu, w.sense.size, w.noise)
    for step in range(steps):
        d = w.air.velocity - w.targets.velocity
        true = Truth(w.p, d, w.psi, w.turn_rate)
        start = start or true
        r = np.hypot(*w.p)
        z, arrived = w.radio.measure(r, step, dt)
        of_heading, of_rate, of_speed = situation.noise.draw(w.sense.size, w.noise)
        psi = w.psi + w.compass + w.compass_drift * step * dt + of_heading
        seen = Seen(dt, psi, w.turn_rate + of_rate, w.airspeed + of_speed, z, w.sigma, arrived, felt)
        command = policy.command(seen, true)
        command = np.clip(command, -cfg.max_turn_rate, cfg.max_turn_rate)
        v = cfg.speed * np.stack([np.cos(w.psi), np.sin(w.psi)]) + d
        r_dot = (w.p * v).sum(axis=0) / np.maximum(r, 1e-9)
        row = (r, r_dot, np.arctan2(w.p[1], w.p[0]), w.turn_rate, command, *policy.estimate, _nees(policy, w.p))
        for name, value in zip(ROWS, row, strict=True):
            kept[name][step] = value
        w.p = w.p + flown(cfg.speed, w.psi, w.turn_rate, command, cfg.lag, dt) + d * dt
        before = cfg.speed * np.stack([np.cos(w.psi), np.sin(w.psi)]) + w.air.velocity
        w.turn_rate, turned = turn_step(w.turn_rate, command, cfg.lag, dt)
        w.psi = w.psi + turned
        w.air.step(dt)
        w.targets.step(dt)
        if imu is not None:
            now = cfg.speed * np.stack([np.cos(w.psi), np.sin(w.psi)]) + w.air.velocity
            felt = imu.measure(now - before, w.psi - turned / 2, w.compass + w.compass_drift * step * dt, dt)
    assert start is not None
    return Tracks(time=np.arange(steps) * dt, sense=w.sense, start=start, **kept)


ROWS = ("r", "r_dot", "angle", "turn_rate", "command", "r_hat", "r_dot_hat", "nees")


def _nees(policy: Policy, p: Array) -> Array:
    """Normalised estimation error squared of (r, theta), (B,)."""
    if policy.belief is None:
        return np.nan
    mean, P = policy.belief
    e_r, e_theta = mean[0] - np.hypot(p[0], p[1]), wrap(mean[1] - np.arctan2(p[1], p[0]))
    determinant = P[0, 0] * P[1, 1] - P[0, 1] ** 2
    weighted = P[1, 1] * e_r**2 - 2 * P[0, 1] * e_r * e_theta + P[0, 0] * e_theta**2
    return weighted / np.where(determinant > 0, determinant, np.nan)
