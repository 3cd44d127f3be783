"""The physical side of the vehicle: body, air, target and autopilot, carried forward in simulated time."""

import math
from random import Random
from typing import NamedTuple

from sim.autopilots import arducopter
from sim.autopilots.contract import Autopilot, Say
from sim.body import Body
from sim.config import RandomStart, Start, VehicleConfig
from sim.sensor import Rangefinder
from sim.world import Air, TargetMotion


class Truth(NamedTuple):
    """What really happens. NED metres from home, radians, m/s; angles and rates clockwise seen from above."""

    time: float
    north: float
    east: float
    down: float
    heading: float
    course: float
    ground_speed: float
    airspeed: float
    turn_rate: float
    roll: float
    target_north: float
    target_east: float
    target_down: float
    range: float
    wind_north: float
    wind_east: float
    mode: int
    armed: bool


class Battery(NamedTuple):
    """What is left in the battery."""

    volts: float = 12.6
    percent: int = 100


class Flight:
    """Everything that moves. Time is whole microseconds of simulated time since the start."""

    def __init__(self, config: VehicleConfig, say: Say) -> None:
        self.config = config
        self.now = 0
        self.booted = 0
        self.air = Air.steady(config.wind)
        self.battery = Battery()
        self.rangefinder = Rangefinder()
        self.target = TargetMotion(config.target)
        self.body = starting_body(config)
        self.autopilot: Autopilot = arducopter.ArduCopter(config, say)

    def next_due(self) -> int:
        return max(self.now, self.autopilot.wake_us())

    def run(self, until: int) -> None:
        """Fly to `until`, letting the autopilot act whenever it wants to on the way."""
        while True:
            wake = self.autopilot.wake_us()
            if wake > until:
                break
            self._move(max(wake, self.now))
            self.autopilot.wake(self.now, self.body)
        self._move(until)

    def _move(self, to: int) -> None:
        if to > self.now:
            self.body = self.autopilot.fly(self.body, (to - self.now) * 1e-6, self.air.velocity)
            self.now = to

    @property
    def seconds(self) -> float:
        return self.now * 1e-6

    @property
    def boot_ms(self) -> int:
        return (self.now - self.booted) // 1000 & 0xFFFFFFFF

    def slant_range(self) -> float:
        north, east, down = self.target.at(self.seconds)
        return math.dist((self.body.north, self.body.east, self.body.down), (north, east, down))

    def truth(self) -> Truth:
        body, wind = self.body, self.air.velocity
        target = self.target.at(self.seconds)
        return Truth(
            time=self.seconds,
            north=body.north,
            east=body.east,
            down=body.down,
            heading=body.heading,
            course=body.course,
            ground_speed=body.ground_speed,
            airspeed=body.airspeed(wind),
            turn_rate=body.turn_rate,
            roll=body.roll,
            target_north=target[0],
            target_east=target[1],
            target_down=target[2],
            range=math.dist((body.north, body.east, body.down), target),
            wind_north=wind[0],
            wind_east=wind[1],
            mode=self.autopilot.mode,
            armed=self.autopilot.armed,
        )


def starting_body(config: VehicleConfig) -> Body:
    start = drawn(config.start, config)
    heading = math.remainder(math.radians(start.heading_deg), math.tau)
    return Body(
        north=start.north_m,
        east=start.east_m,
        down=-start.altitude_m,
        heading=heading,
        velocity_north=start.speed_mps * math.cos(heading),
        velocity_east=start.speed_mps * math.sin(heading),
    )


class _Place(NamedTuple):
    north_m: float
    east_m: float
    altitude_m: float
    heading_deg: float
    speed_mps: float


def drawn(start: Start, config: VehicleConfig) -> _Place:
    """The start with its random parts drawn from the seed; range and bearing are horizontal, from the target."""
    bounds: RandomStart = start.random
    rng = Random(f"{config.seed}:start")
    draws = [rng.random() for _ in range(5)]

    def pick(interval: tuple[float, float] | None, otherwise: float, draw: float) -> float:
        return otherwise if interval is None else interval[0] + (interval[1] - interval[0]) * draw

    north = pick(bounds.north_m, start.north_m, draws[0])
    east = pick(bounds.east_m, start.east_m, draws[1])
    if bounds.range_m is not None or bounds.bearing_deg is not None:
        away_north, away_east = north - config.target.north_m, east - config.target.east_m
        distance = pick(bounds.range_m, math.hypot(away_north, away_east), draws[3])
        bearing = math.radians(pick(bounds.bearing_deg, math.degrees(math.atan2(away_east, away_north)), draws[4]))
        north = config.target.north_m + distance * math.cos(bearing)
        east = config.target.east_m + distance * math.sin(bearing)
    heading = pick(bounds.heading_deg, start.heading_deg, draws[2])
    return _Place(north, east, start.altitude_m, heading, start.speed_mps)
