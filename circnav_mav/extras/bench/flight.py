"""One flight of the benchmark: a planar point mass, its sensors, and the public `Guidance` of
circnav.

SI, radians, the paper's frame (x east, y north, counter-clockwise).
"""

from dataclasses import dataclass, replace
from math import atan2, cos, exp, hypot, nan, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.api import Guidance, tune
from circnav_mav.extras.bench.situations import LAST, ORBIT, TURN_LAG, Ranging, RateNoise, Situation
from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator
from circnav_mav.guidance.estimators.table import ESTIMATORS, default_estimator
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.types import (
    Direction,
    IntegratedAcceleration,
    OwnMotion,
    RangeEstimate,
    RangeSample,
    RateSample,
    RelativeMotion,
)

TRUTH = "truth"
"""Name of the estimator `FullInformation`."""
PUBLISHED = "circnav_mav.extras.bench.published_laws:"
POLICIES: dict[str, tuple[str, str]] = {
    **{law: (law, default_estimator(law)) for law in reversed(LAWS)},
    **{
        law: (PUBLISHED + law, "kalman")
        for law in ("bounded", "three_circles", "relay", "pd", "pi")
    },
    "bounded, sliding mode": (PUBLISHED + "bounded", PUBLISHED + "SlidingMode"),
    "full information": ("drift", TRUTH),
}
"""Policies of the benchmark: law and estimator."""
GUST_TIME = 10.0
"""Correlation time of the gusts, s, as in the longitudinal Dryden spectrum at constant airspeed."""
VEER_TIME = 10.0
"""Duration of a change of the wind direction, s."""
VEER_EVERY = 50.0
"""Time from the start of a change of the wind direction to the start of the next one, s."""
COAST = 10.0
"""Time without ranges in which the turn rate of the circle is commanded, s: `limits.coast_s` of a
mission by default."""
GAUSS = ((0.5 - sqrt(15) / 10, 5 / 18), (0.5, 8 / 18), (0.5 + sqrt(15) / 10, 5 / 18))
"""Gauss-Legendre rule with three points on 0 to 1: place and weight."""
ROWS = ("r", "r_dot", "angle", "command", "r_hat", "r_dot_hat", "nees", "nis")
Pair = tuple[float, float]


def law_and_estimator(policy: str) -> tuple[str, str]:
    """Return law and estimator of a policy: a name of POLICIES, or `law` or `law+estimator`, either
    of which may be user-defined. Raises ValueError."""
    if policy in POLICIES:
        return POLICIES[policy]
    law, _, estimator = policy.partition("+")
    law = POLICIES.get(law, (law, ""))[0]
    estimator = estimator or default_estimator(law)
    if not LAWS.knows(law) or not ESTIMATORS.knows(estimator):
        names = (*POLICIES, *LAWS.names()[len(LAWS) :], "module:name", "law+estimator")
        raise ValueError(f'"{policy}" is not one of: {"; ".join(names)}')
    return law, estimator


def check_policy(policy: str) -> None:
    """Import the user-defined code of a policy. Raises ValueError."""
    if policy not in POLICIES:
        Guidance(ORBIT, *law_and_estimator(policy))


@dataclass(frozen=True, slots=True)
class Track:
    """One recorded flight.

    rows: arrays (steps,) by the names of ROWS. The estimates are NaN before the last LAST seconds.
    time: (steps,), s.
    sense: +1 counter-clockwise, -1 clockwise.
    start: vehicle minus target position at the start, m.
    heading: heading at the start, rad.
    """

    rows: dict[str, NDArray[np.float32]]
    time: NDArray[Any]
    sense: float
    start: Pair
    heading: float


class World:
    """Vehicle, wind and target.

    x, y: vehicle minus target position, m.
    heading, turn_rate: heading and turn rate of the vehicle, rad and rad/s.
    """

    def __init__(
        self, situation: Situation, draws: NDArray[np.float64], random: np.random.Generator
    ) -> None:
        """draws: ten uniform numbers from 0 to 1 that choose the start and all directions."""
        self._situation = situation
        self._random = random
        angle, self.heading, self._wind_from, self.course = (
            2 * pi * float(draw) for draw in draws[:4]
        )
        self._sense = -1.0 if draws[4] < 0.5 else 1.0
        self._phase = float(draws[9])
        r = situation.start[0] + (situation.start[1] - situation.start[0]) * float(draws[8])
        self.x = r * cos(angle)
        self.y = r * sin(angle)
        self.turn_rate = 0.0
        self._target_speed = situation.target
        east, north = random.standard_normal(2).tolist()
        self._gust = (situation.gust * east, situation.gust * north)
        self._now = 0.0

    @property
    def wind(self) -> Pair:
        """Present wind, m/s."""
        times, since = divmod(self._now + self._phase * VEER_EVERY, VEER_EVERY)
        angle = self._wind_from + self._sense * self._situation.veer * (
            times + min(since / VEER_TIME, 1.0)
        )
        speed = self._situation.wind
        return speed * cos(angle) + self._gust[0], speed * sin(angle) + self._gust[1]

    @property
    def target_velocity(self) -> Pair:
        """Present velocity of the target, m/s."""
        stands = self._situation.stands
        if stands and (self._now / (2 * stands) + self._phase) % 1 >= 0.5:
            return 0.0, 0.0
        return self._target_speed * cos(self.course), self._target_speed * sin(self.course)

    @property
    def drift(self) -> Pair:
        """Wind minus target velocity, m/s."""
        wind = self.wind
        target = self.target_velocity
        return wind[0] - target[0], wind[1] - target[1]

    @property
    def velocity(self) -> Pair:
        """Velocity over ground, m/s."""
        wind = self.wind
        return ORBIT.speed * cos(self.heading) + wind[0], ORBIT.speed * sin(self.heading) + wind[1]

    @property
    def r(self) -> float:
        """Range, m."""
        return hypot(self.x, self.y)

    @property
    def r_dot(self) -> float:
        """Range rate, m/s."""
        v = self.velocity
        target = self.target_velocity
        return (self.x * (v[0] - target[0]) + self.y * (v[1] - target[1])) / max(self.r, 1e-9)

    def step(self, dt: float, command: float) -> None:
        """Advance by dt with a constant command, rad/s."""
        goal = min(max(command, -ORBIT.max_turn_rate), ORBIT.max_turn_rate)
        drift = self.drift
        way = ORBIT.speed * dt
        headings = [
            (self.heading + turn_step(self.turn_rate, goal, at * dt)[1], weight)
            for at, weight in GAUSS
        ]
        self.x += way * sum(weight * cos(heading) for heading, weight in headings) + drift[0] * dt
        self.y += way * sum(weight * sin(heading) for heading, weight in headings) + drift[1] * dt
        self.turn_rate, angle = turn_step(self.turn_rate, goal, dt)
        self.heading += angle
        self._now += dt
        cfg = self._situation
        self.course += self._sense * cfg.target_turn * dt
        if cfg.gust:
            kept = exp(-dt / GUST_TIME)  # the exact transition of the process
            spread = cfg.gust * sqrt(1 - kept**2)
            east, north = self._random.standard_normal(2).tolist()
            self._gust = (
                kept * self._gust[0] + spread * east,
                kept * self._gust[1] + spread * north,
            )
        if cfg.target_walk:
            velocity = np.array(self.target_velocity)
            x, y = velocity + cfg.target_walk * sqrt(dt) * self._random.standard_normal(2)
            self._target_speed = min(hypot(x, y), cfg.target)
            self.course = atan2(y, x)


def turn_step(omega: float, command: float, dt: float) -> Pair:
    """Return turn rate and turned angle after dt with a constant command: the exact first-order
    lag."""
    keep = exp(-dt / TURN_LAG)
    return command + (omega - command) * keep, command * dt + (omega - command) * TURN_LAG * (
        1 - keep
    )


class Radio:
    """Ranges, and range rates if `rates` is given, with the errors of a radio."""

    def __init__(
        self, ranging: Ranging, rates: RateNoise | None, random: np.random.Generator
    ) -> None:
        self._ranging = ranging
        self._rates = rates
        self._random = random
        self._error = ranging.drifting * random.standard_normal()
        self._outage_from = 20.0 + 40.0 * random.random()
        self._offset = 0.0 if rates is None else rates.bias * random.standard_normal()

    def measure(self, world: World, step: int, dt: float) -> RangeSample | None:
        """Return the sample of this step, or None. Call once per step."""
        cfg = self._ranging
        now = step * dt
        if step % cfg.every:
            return None
        white, fresh, rate_white, rate_fresh = self._random.standard_normal(4).tolist()
        lost, wild, spread = self._random.random(3).tolist()
        since = dt * cfg.every
        self._error = _markov(self._error, cfg.drifting, since / cfg.drift_time, fresh)
        if self._rates is not None:
            self._offset = _markov(
                self._offset, self._rates.bias, since / self._rates.bias_time, rate_fresh
            )
        if lost < cfg.loss or (cfg.outage and (now - self._outage_from) % 60.0 < cfg.outage):
            return None
        z = (
            world.r
            + self._error
            + cfg.white * white
            + cfg.near_bias * max(1 - world.r / cfg.near, 0.0)
        )
        if wild < cfg.outlier_share:
            z += cfg.outlier * (2 * spread - 1)
        sample = RangeSample(now, now, z, cfg.sigma)
        if self._rates is None:
            return sample
        r_dot = world.r_dot + self._offset + self._rates.white * rate_white
        return sample._replace(r_dot=r_dot, r_dot_sigma=self._rates.sigma)


def _markov(error: float, sigma: float, share: float, fresh: float) -> float:
    """Return the next value of a Gauss-Markov error. share: time step over correlation time."""
    kept = exp(-share)
    return kept * error + sigma * sqrt(1 - kept**2) * fresh


class MotionSensors:
    """Own motion as an autopilot reports it: noise, compass bias and drift, airspeed scale,
    accelerations."""

    def __init__(
        self, situation: Situation, draws: NDArray[np.float64], random: np.random.Generator
    ) -> None:
        bias, drift, speed = (-1.0 if draw < 0.5 else 1.0 for draw in draws[5:8])
        self._situation = situation
        self._random = random
        self._bias = bias * situation.compass_bias
        self._drift = drift * situation.compass_drift
        self._scale = 1 + speed * situation.airspeed_error
        imu = situation.imu
        self._imu_bias = np.zeros(2) if imu is None else imu.bias * random.standard_normal(2)
        self._before: tuple[Pair, float] | None = None
        self._acceleration = IntegratedAcceleration(0.0, 0.0, 0.0)

    def report(self, world: World, now: float) -> OwnMotion:
        """Return the report at this time. Call once per step."""
        noise = self._situation.noise
        errors = self._random.standard_normal(3).tolist()
        turned = self._bias + self._drift * now
        own = OwnMotion(
            time=now,
            heading=world.heading + turned + noise.heading * errors[0],
            turn_rate=world.turn_rate + noise.turn_rate * errors[1],
            airspeed=ORBIT.speed * self._scale + noise.airspeed * errors[2],
        )
        if self._situation.imu is None:
            return own
        self._integrate(world, self._situation.imu.white, turned)
        return own._replace(acceleration=self._acceleration)

    def _integrate(self, world: World, white: float, turned: float) -> None:
        """Add the measured change of velocity since the last step. Noise and bias act forward and
        to the left."""
        velocity = world.velocity
        if self._before is not None:
            before, heading = self._before
            errors = self._imu_bias + white * self._random.standard_normal(2)
            forward, left = (errors * self._situation.dt).tolist()
            nose = (world.heading + heading) / 2
            x = velocity[0] - before[0] + forward * cos(nose) - left * sin(nose)
            y = velocity[1] - before[1] + forward * sin(nose) + left * cos(nose)
            east = self._acceleration.x + x * cos(turned) - y * sin(turned)
            north = self._acceleration.y + x * sin(turned) + y * cos(turned)
            self._acceleration = IntegratedAcceleration(east, north, 0.0)
        self._before = (velocity, world.heading)


class FullInformation(Estimator):
    """Estimator that returns the truth, as a reference. It is a user-defined estimator of
    `Guidance`."""

    ready = True
    nis = None

    def __init__(self, world: World) -> None:
        self._world = world

    def observe(self, sample: RangeSample) -> bool:
        return True

    def observe_rate(self, sample: RateSample) -> None:
        return

    def at(self, time: float) -> RangeEstimate:
        world = self._world
        drift = world.drift
        relative = RelativeMotion(
            world.x,
            world.y,
            0.0,
            drift[0],
            drift[1],
            world.heading,
            world.turn_rate,
            ORBIT.speed,
            1.0,
            True,
        )
        return RangeEstimate(time, world.r, world.r_dot, 0.0, 0.0, relative=relative)

    def reset(self) -> None:
        return


def fly(situation: Situation, policy: str, seed: int, flight: int) -> Track:
    """Fly one flight. All random numbers depend on situation, seed and flight number alone, so they
    are the same for every policy."""
    streams = [np.random.default_rng([seed, flight, part]) for part in range(4)]
    draws = streams[3].random(10)
    world = World(situation, draws, streams[0])
    radio = Radio(situation.ranging, situation.rates, streams[1])
    sensors = MotionSensors(situation, draws, streams[2])
    start = (world.x, world.y)
    heading = world.heading
    direction = Direction.COUNTERCLOCKWISE if flight % 2 == 0 else Direction.CLOCKWISE
    orbit = replace(ORBIT, direction=direction)
    law, name = law_and_estimator(policy)
    settings = EstimatorSettings(orbit.speed, orbit.max_turn_rate)
    estimator = FullInformation(world) if name == TRUTH else ESTIMATORS[name](settings)
    guidance = Guidance(orbit, tune(orbit, law, turn_lag=TURN_LAG), estimator, coast=COAST)
    steps = round(situation.duration / situation.dt)
    rows = {name: np.full(steps, np.nan, np.float32) for name in ROWS}
    for step in range(steps):
        now = step * situation.dt
        guidance.update_motion(sensors.report(world, now))
        sample = radio.measure(world, step, situation.dt)
        accepted = sample is not None and guidance.update_range(sample)
        command = guidance.command(now)
        # Without a valid estimate the vehicle keeps the steady turn of the circle.
        turn = orbit.steady_turn_rate if command is None else command.turn_rate
        rows["r"][step] = world.r
        rows["r_dot"][step] = world.r_dot
        rows["angle"][step] = atan2(world.y, world.x)
        rows["command"][step] = turn
        if now >= situation.duration - LAST:
            estimate = guidance.estimate(now)
            if estimate is not None:
                rows["r_hat"][step] = estimate.r
                rows["r_dot_hat"][step] = estimate.r_dot
            if accepted and estimator.ready:
                rows["nees"][step] = _nees(estimator, estimate, world)
                rows["nis"][step] = nan if estimator.nis is None else estimator.nis
        world.step(situation.dt, turn)
    times = np.arange(steps) * situation.dt
    return Track(rows, times, float(direction.turn_sign), start, heading)


def _nees(estimator: Estimator, found: RangeEstimate | None, world: World) -> float:
    """Return the normalized estimation error squared of the position at the newest range: of range
    and direction for `auto`, of x and y for an estimator that returns `position_covariance`. NaN
    without an estimated position."""
    if isinstance(estimator, AutoEstimator):
        estimate = estimator.drift.filter.estimate
        if estimate is None or not estimator.drift.ready:
            return nan
        covariance = estimate.covariance[:2, :2]
        direction = float(estimate.mean[1]) - atan2(world.y, world.x)
        error = np.array([estimate.mean[0] - world.r, (direction + pi) % (2 * pi) - pi])
    else:
        relative = None if found is None else found.relative
        if relative is None or relative.position_covariance is None:
            return nan
        xx, xy, yy = relative.position_covariance
        covariance = np.array([[xx, xy], [xy, yy]])
        error = np.array([relative.x - world.x, relative.y - world.y])
    return float(error @ np.linalg.solve(covariance, error))
