"""The physical side of the vehicle: body, air, target and autopilot, carried forward in simulated time."""

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from random import Random
from typing import NamedTuple

from .autopilots.arducopter import ArduCopter
from .autopilots.arduplane import ArduPlane
from .autopilots.ardurover import ArduRover
from .autopilots.contract import Autopilot, Say
from .autopilots.px4_copter import Px4Copter
from .autopilots.px4_plane import Px4Plane
from .body import GRAVITY, Body, Vector
from .config import VehicleConfig
from .instruments import Instruments
from .sensor import Sample
from .starting import starting_body
from .world import Air, target_at

IMU_WINDOW_US = 20_000  # what an accelerometer's reading is averaged over: autopilots filter at 20 .. 30 Hz
DRIFT_STEP_US = 100_000
RANGE_TOO_OLD_US = 450_000
AUTOPILOTS: dict[str, Callable[[VehicleConfig, Say, Body], Autopilot]] = {
    "arducopter": ArduCopter,
    "arducopter_nogps": ArduCopter,
    "arduplane": ArduPlane,
    "ardurover": ArduRover,
    "px4_copter": Px4Copter,
    "px4_plane": Px4Plane,
}


class Truth(NamedTuple):
    """What really happens. NED metres from home, radians, m/s; angles and rates clockwise seen from above.

    SIM_TRUTH sends north .. wind_east in this order.
    """

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
        self.target = partial(target_at, config.target)
        self._ranged: tuple[int, Sample] | None = None  # what the rangefinder's driver holds, and since when
        self.instruments = Instruments(config.sensors, config.seed, config.sih)
        self.battery = config.battery.percent
        self._battery_at = 0
        self.autopilot = AUTOPILOTS[config.vehicle.profile](config, say, starting_body(config, self.air.velocity))
        self._velocities: deque[tuple[int, Vector]] = deque([(0, self.body.velocity)])
        self._estimator_rng = Random(f"{config.seed}:estimator")
        self._position_rng = Random(f"{config.seed}:position")
        size, drift = config.sensors.gps_error_m, config.sensors.dead_reckoning_mps
        self._gps_error = self._position_rng.gauss(0.0, size), self._position_rng.gauss(0.0, size)
        self._lost_drift = self._position_rng.gauss(0.0, drift), self._position_rng.gauss(0.0, drift)
        self.position_error = self._gps_error  # reported less true, north and east, m
        self.spoofed = 0.0  # m/s by which what the receiver believes moves north

    def run(self, until: int) -> None:
        """Fly to `until`, letting the autopilot act whenever it wants to on the way."""
        while True:
            wake = self.autopilot.wake_us()
            if wake > until:
                break
            self._move(max(wake, self.now))
            self.autopilot.wake(self.now)
        self._move(until)

    def _move(self, to: int) -> None:
        if to > self.now:
            self.autopilot.body = self.autopilot.fly((to - self.now) * 1e-6, self.air.velocity)
            self.now = to
            trail = self._velocities
            trail.append((to, self.body.velocity))
            while trail[1][0] <= to - IMU_WINDOW_US:
                trail.popleft()

    def specific_force(self) -> Vector:
        """What accelerometers feel: acceleration without gravity, m/s^2, forward, right, down; at rest (0, 0, -g)."""
        (began, before), (ended, after) = self._velocities[0], self._velocities[-1]
        seconds = max(1, ended - began) * 1e-6
        north, east, down = ((b - a) / seconds for a, b in zip(before, after, strict=True))
        return self.body.from_earth((north, east, down - GRAVITY))

    def imu(self) -> tuple[Vector, Vector]:
        return self.instruments.imu(self.body, self.specific_force(), self.seconds)

    def drift_estimate(self) -> None:
        """One step of 0.1 s of the estimate's error."""
        body, roll = self.body, self.config.attitude_error
        wander = roll * (1.1 if self.config.sih else 0.6)
        error = body.error.after(DRIFT_STEP_US * 1e-6, roll, wander, body.heading, self._estimator_rng)
        self.autopilot.body = body._replace(error=error)

    def wander(self) -> None:
        """One step of 0.1 s of the error of the reported position: of the GPS, or of dead reckoning without it."""
        sensors, dt = self.config.sensors, DRIFT_STEP_US * 1e-6
        kept = math.exp(-dt / sensors.gps_error_time_s)
        fresh = sensors.gps_error_m * math.sqrt(1 - kept * kept)
        north, east = (kept * error + self._position_rng.gauss(0.0, fresh) for error in self._gps_error)
        self._gps_error = north + self.spoofed * dt, east
        if self.autopilot.gps:
            self.position_error = self._gps_error
            return
        placed = self.autopilot.take_placed()
        if placed is not None:
            self.position_error = placed[0] - self.body.north, placed[1] - self.body.east
        drift = self._lost_drift
        self.position_error = self.position_error[0] + drift[0] * dt, self.position_error[1] + drift[1] * dt

    def range_heard(self, sample: Sample) -> None:
        """By the autopilot's rangefinder driver, which holds it until the next one, or until it is too old."""
        self._ranged = self.now, sample

    def range_held(self) -> Sample | None:
        return self._ranged[1] if self._ranged is not None and self.now - self._ranged[0] <= RANGE_TOO_OLD_US else None

    def reboot(self) -> None:
        """The autopilot starts afresh: disarmed, in its first mode, its clock at zero. The body stays where it is."""
        fresh = self.config.rebooted()
        self.booted = self.now
        self._ranged = None
        self.autopilot = AUTOPILOTS[fresh.vehicle.profile](fresh, self._say, self.body)

    @property
    def body(self) -> Body:
        return self.autopilot.body

    @property
    def seconds(self) -> float:
        return self.now * 1e-6

    @property
    def boot_us(self) -> int:
        """The autopilot's clock."""
        return self.now - self.booted

    @property
    def boot_ms(self) -> int:
        return self.boot_us // 1000 & 0xFFFFFFFF

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
        return math.dist((body.north, body.east, body.down), self.target(self.seconds))

    def slant_rate(self) -> float:
        """How fast the slant range grows, m/s."""
        body, now = self.body, self.seconds
        offset = [a - b for a, b in zip((body.north, body.east, body.down), self.target(now), strict=True)]
        before, after = self.target(now - 0.01), self.target(now + 0.01)
        moved = [(b - a) / 0.02 for a, b in zip(before, after, strict=True)]
        relative = [a - b for a, b in zip(self.body.velocity, moved, strict=True)]
        return sum(a * b for a, b in zip(offset, relative, strict=True)) / max(self.slant_range(), 1e-6)

    def truth(self) -> Truth:
        body, wind, target = self.body, self.air.velocity, self.target(self.seconds)
        speed, airspeed = body.ground_speed, body.airspeed(wind)
        moved = body.north, body.east, body.down, body.heading, body.course, speed, airspeed, body.turn_rate, body.roll
        slant, pilot = math.dist((body.north, body.east, body.down), target), self.autopilot
        return Truth(self.seconds, *moved, *target, slant, *wind, pilot.mode, pilot.armed)
