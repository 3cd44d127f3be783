"""The physical side of the vehicle: body, air, target and autopilot, carried forward in simulated time."""

import math
from typing import NamedTuple

from sim.autopilots.build import build_autopilot
from sim.autopilots.contract import Say
from sim.body import Body
from sim.config import VehicleConfig
from sim.instruments import Instruments
from sim.sensor import Rangefinder
from sim.starting import starting_body
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


class Flight:
    """Everything that moves. Time is whole microseconds of simulated time since the start."""

    def __init__(self, config: VehicleConfig, say: Say) -> None:
        self.config = config
        self.now = 0
        self.booted = -round(config.vehicle.boot_age_s * 1e6)
        self._say = say
        self.air = Air(config.wind, config.seed)
        self.target = TargetMotion(config.target)
        self.rangefinder = Rangefinder()
        self.instruments = Instruments(config.sensors, config.seed)
        self.battery = config.battery.percent
        self._battery_at = 0
        self.body = starting_body(config, self.air.velocity)
        self.autopilot = build_autopilot(config, say, self.body)

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

    def reboot(self) -> None:
        """The autopilot starts afresh: disarmed, in its first mode, its clock at zero. The body stays where it is."""
        fresh = self.config.rebooted()
        self.booted = self.now
        self.rangefinder = Rangefinder()
        self.autopilot = build_autopilot(fresh, self._say, self.body)

    @property
    def seconds(self) -> float:
        return self.now * 1e-6

    @property
    def boot_ms(self) -> int:
        return (self.now - self.booted) // 1000 & 0xFFFFFFFF

    def charge(self, percent: float) -> None:
        self.battery, self._battery_at = percent, self.now

    def battery_percent(self) -> float:
        minutes = (self.now - self._battery_at) / 60e6
        return max(0.0, self.battery - self.config.battery.drain_percent_per_min * minutes)

    def shown(self) -> Body:
        """The body as the autopilot's estimate has it."""
        return self.instruments.body(self.body, self.seconds)

    def slant_range(self) -> float:
        body = self.body
        return math.dist((body.north, body.east, body.down), self.target.at(self.seconds))

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
