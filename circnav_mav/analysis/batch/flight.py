"""The loop of a batch: B vehicles, one policy, one situation."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from circnav_mav.analysis.batch.sensors import GAUSSIAN, Compass, Radio, Ranging
from circnav_mav.analysis.batch.world import Air, Target, Targets, Wind, flown, turn_step
from circnav_mav.core.air_path import wrap

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
    airspeed_error: float = 0.0
    circle: Circle = field(default_factory=Circle)
    duration: float = 400.0
    dt: float = 0.05

    def lasting(self, duration: float) -> "Situation":
        """The same for so many seconds."""
        return replace(self, duration=duration)


@dataclass(frozen=True, slots=True)
class Seen:
    """What a policy gets in one step, arrays (B,): heading, turn rate, airspeed; range where arrived."""

    dt: float
    psi: Array
    turn_rate: Array
    airspeed: Array
    z: Array
    sigma: Array
    arrived: Array


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


def fly(situation: Situation, make: Make, flights: int, seed: int) -> Tracks:
    """Fly B = flights of a situation; make(circle, sense (B,)) gives the policy. One seed, one world."""
    cfg, dt = situation.circle, situation.dt
    rng, noise = (np.random.default_rng([seed, part]) for part in (0, 1))
    sense = np.where(np.arange(flights) % 2 == 0, 1.0, -1.0)
    angle, psi = rng.uniform(0, 2 * np.pi, (2, flights))
    p = rng.uniform(*cfg.start, flights) * np.stack([np.cos(angle), np.sin(angle)])
    omega = np.zeros(flights)
    bias_sign, drift_sign, speed_sign = rng.choice([-1.0, 1.0], (3, flights))
    air, targets = Air(situation.wind, flights, rng), Targets(situation.target, flights, rng)
    radio = Radio(situation.ranging, flights, noise)
    airspeed = cfg.speed * (1 + speed_sign * situation.airspeed_error)
    sigma = np.full(flights, situation.ranging.sigma)
    policy: Policy = make(cfg, sense)
    steps = round(situation.duration / dt)
    kept = {name: np.zeros((steps, flights), np.float32) for name in ROWS}
    start = None
    for step in range(steps):
        d = air.velocity - targets.velocity
        true = Truth(p, d, psi, omega)
        start = start or true
        r = np.hypot(*p)
        z, arrived = radio.measure(r, step, dt)
        error = bias_sign * situation.compass.bias + drift_sign * situation.compass.drift * step * dt
        command = policy.command(Seen(dt, psi + error, omega, airspeed, z, sigma, arrived), true)
        command = np.clip(command, -cfg.max_turn_rate, cfg.max_turn_rate)
        v = cfg.speed * np.stack([np.cos(psi), np.sin(psi)]) + d
        r_dot = (p * v).sum(axis=0) / np.maximum(r, 1e-9)
        row = (r, r_dot, np.arctan2(p[1], p[0]), omega, command, *policy.estimate, _nees(policy, p))
        for name, value in zip(ROWS, row, strict=True):
            kept[name][step] = value
        p = p + flown(cfg.speed, psi, omega, command, cfg.lag, dt) + d * dt
        omega, turned = turn_step(omega, command, cfg.lag, dt)
        psi = psi + turned
        air.step(dt)
        targets.step(dt)
    assert start is not None
    return Tracks(time=np.arange(steps) * dt, sense=sense, start=start, **kept)


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
