"""Situations of the benchmark with the required errors of `auto`, and flights of B vehicles under one policy."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import radians

import numpy as np

from circnav_mav.api import tune
from circnav_mav.extras.batch.guidance import POLICIES, Authority, Guidance, estimator, fly
from circnav_mav.extras.batch.sensors import (
    LORA,
    UWB,
    ImuNoise,
    MotionNoise,
    MotionSensors,
    Radio,
    Ranging,
    RateNoise,
    Reading,
)
from circnav_mav.extras.batch.world import Airframe, Surroundings, Truth, World, along
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.maths import Array, wrap
from circnav_mav.guidance.step import StepSettings
from circnav_mav.guidance.types import Direction, Orbit

STALE = 0.5
"""Largest age of a range that may steer, s; the default of `limits.stale_s`."""
ORBIT = Orbit(100.0, Direction.COUNTERCLOCKWISE, 15.0, radians(20.0))
TURN_LAG = 0.4
"""Circle ORBIT (flown in both directions) and turn lag (s) of config/quickstart.toml."""
ESTIMATION = EstimatorSettings(ORBIT.speed, ORBIT.max_turn_rate)


@dataclass(frozen=True, slots=True)
class Situation:
    """One row of the benchmark.

    required: largest median RMS radius error of `auto`, m; None: only reported. wind, gust (standard deviation), target
    (speed): m/s, in random directions. target_turn (rad/s), veer (rad), compass_bias (rad), compass_drift (rad/s) and
    airspeed_error (measured over true, minus 1) have random signs. veer, stands, target_walk: see `Surroundings`.
    start: bounds of the initial range, m, uniform.
    """

    name: str
    required: float | None = None
    wind: float = 0.0
    gust: float = 0.0
    target: float = 0.0
    target_turn: float = 0.0
    target_walk: float = 0.0
    veer: float = 0.0
    stands: float = 0.0
    ranging: Ranging = field(default_factory=Ranging)
    rates: RateNoise | None = None
    compass_bias: float = 0.0
    compass_drift: float = 0.0
    noise: MotionNoise = field(default_factory=MotionNoise)
    airspeed_error: float = 0.0
    imu: ImuNoise | None = None
    start: tuple[float, float] = (10.0, 600.0)
    duration: float = 400.0
    dt: float = 0.05


@dataclass(frozen=True, slots=True)
class Tracks:
    """Recorded flights, arrays (N, B); time (N,), sense (B,). angle: direction from the target to
    the vehicle, rad. nees: normalized estimation error squared of (r, theta)."""

    time: Array
    r: Array
    r_dot: Array
    angle: Array
    command: Array
    r_hat: Array
    r_dot_hat: Array
    nees: Array
    sense: Array
    start: Truth


def begin(situation: Situation, flights: int, seed: int) -> tuple[World, Radio, MotionSensors, Array]:
    """Return B flights at their start and their senses of rotation (B,), +1 counter-clockwise.

    A flight depends on the seed and its number, not on the number of flights.
    """
    s, seeds = situation, [(seed, flight) for flight in range(flights)]
    draws = np.array([np.random.default_rng([*one, 3]).random(10) for one in seeds]).T
    angle, psi, wind, course = 2 * np.pi * draws[:4]
    turns, bias, drift, speed = np.where(draws[4:8] < 0.5, -1.0, 1.0)
    around = Surroundings(
        wind=s.wind * along(wind), gust=s.gust, target_speed=s.target, target_course=course,
        target_turn=turns * s.target_turn, target_walk=s.target_walk, veer=turns * s.veer, stands=s.stands,
        phase=draws[9],
    )  # fmt: skip
    r = s.start[0] + (s.start[1] - s.start[0]) * draws[8]
    airframe = Airframe(ORBIT.speed, ORBIT.max_turn_rate, TURN_LAG)
    return (
        World(around, airframe, r * along(angle), psi, seeds),
        Radio(s.ranging, Reading(s.ranging.sigma), seeds, rates=s.rates),
        MotionSensors(
            s.noise, seeds, bias * s.compass_bias, drift * s.compass_drift, 1 + speed * s.airspeed_error, s.imu
        ),
        np.where(np.arange(flights) % 2 == 0, 1.0, -1.0),
    )


Make = Callable[[Array], Guidance]
"""Function that returns the guidance for senses of rotation (B,)."""


def policy(name: str) -> Make:
    """Return a function that makes the guidance of a policy, with the default gain of its law."""
    law, source = POLICIES[name]

    def make(sense: Array) -> Guidance:
        one = StepSettings.of(ORBIT, tune(ORBIT, law, turn_lag=TURN_LAG))
        settings, of_flights = replace(one, sense=sense, k=sense * one.k), estimator(source, ESTIMATION, sense.size)
        return Guidance(settings, of_flights, sense.size, lag=TURN_LAG, stale=STALE, true_lag=TURN_LAG)

    return make


def fly_situation(situation: Situation, make: Make, flights: int, seed: int) -> Tracks:
    world, radio, senses, sense = begin(situation, flights, seed)
    steps, first = round(situation.duration / situation.dt), world.truth
    guidance = make(sense)
    kept = {name: np.zeros((steps, flights), np.float32) for name in ROWS}

    def record(step: int, true: Truth, command: Array, cut: Array) -> None:
        e, angle = guidance.estimator, np.arctan2(true.p[1], true.p[0])
        row = (world.r, world.r_dot, angle, command, e.r, e.r_dot, _nees(e.belief, true.p))
        for name, value in zip(ROWS, row, strict=True):
            kept[name][step] = value

    fly(world, radio, senses, guidance, Authority(flights, steps), situation.dt, record)
    return Tracks(time=np.arange(steps) * situation.dt, sense=sense, start=first, **kept)


ROWS = ("r", "r_dot", "angle", "command", "r_hat", "r_dot_hat", "nees")


def _nees(belief: tuple[Array, Array] | None, p: Array) -> Array:
    """Return the normalized estimation error squared of (r, theta), (B,)."""
    if belief is None:
        return np.nan
    mean, P = belief
    e_r, e_theta = mean[0] - np.hypot(p[0], p[1]), wrap(mean[1] - np.arctan2(p[1], p[0]))
    determinant = P[0, 0] * P[1, 1] - P[0, 1] ** 2
    weighted = P[1, 1] * e_r**2 - 2 * P[0, 1] * e_r * e_theta + P[0, 0] * e_theta**2
    return weighted / np.where(determinant > 0, determinant, np.nan)


V = ORBIT.speed
LAST = 100.0
"""Length of the evaluated last part of a flight, s."""


SITUATIONS = {
    one.name: one
    for one in (
        Situation("calm", 0.12),
        Situation("wind 0.20 V", 0.25, wind=0.20 * V),
        Situation("wind 0.33 V", 0.35, wind=0.33 * V),
        Situation("wind 0.53 V", 0.60, wind=0.53 * V),
        Situation("target 0.2 V", 0.30, target=3.0),
        Situation("target 0.2 V, wind 0.2 V", 0.40, target=3.0, wind=0.20 * V),
        Situation("target turns", target=3.0, target_turn=0.05),
        Situation("wind 0.33 V turns 90 deg in 10 s", 0.4, wind=0.33 * V, veer=radians(90)),
        Situation("it turns, with accelerations", 0.4, wind=0.33 * V, veer=radians(90), imu=ImuNoise()),
        Situation("target stops and goes", 0.4, target=3.0, stands=30.0),
        Situation("target accelerates", target=3.0, target_walk=0.3),
        Situation("gusts 1.5, wind 0.33 V", 1.0, wind=5.0, gust=1.5),
        Situation("the same with accelerations", wind=5.0, gust=1.5, imu=ImuNoise()),
        Situation("accelerations, rate 0.3", wind=5.0, gust=1.5, imu=ImuNoise(), rates=RateNoise(0.3)),
        Situation("accelerations, rate 0.1", wind=5.0, gust=1.5, imu=ImuNoise(), rates=RateNoise(0.1)),
        Situation("gusts with rate 0.1 alone", wind=5.0, gust=1.5, rates=RateNoise(0.1)),
        Situation("uwb, wind 0.2 V", 0.35, wind=0.20 * V, ranging=UWB),
        Situation("lora, wind 0.2 V", 2.0, wind=0.20 * V, ranging=LORA),
        Situation("50 % loss at 5 Hz", wind=0.20 * V, ranging=Ranging(every=4, loss=0.5)),
        Situation("outage 10 s a minute", wind=0.20 * V, ranging=Ranging(outage=10.0)),
        Situation("10 % outliers of 20 m", wind=0.20 * V, ranging=Ranging(outlier_share=0.1)),
        Situation("compass bias 10 deg", wind=0.20 * V, compass_bias=radians(10)),
        Situation("heading drift 0.1 deg/s", wind=0.20 * V, compass_drift=radians(0.1)),
        Situation("airspeed +-10 %", wind=0.20 * V, airspeed_error=0.10),
    )
}
