"""Physics of the vehicle: body, air, target and autopilot, advanced in simulated time."""

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
from .body import GRAVITY, Body, EstimateError, Vector, to_earth
from .config import VehicleConfig
from .ground import standing
from .instruments import Instruments
from .sensor import Sample
from .starting import starting_body
from .world import HOME_AMSL_M, Air, target_at, to_degrees

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
    """True state. NED meters from home, radians, m/s. Angles and rates are clockwise seen from
    above.

    SIM_TRUTH sends the fields from north to wind_east in this order.
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
    crashed: bool
    pitch: float


class Flight:
    """Vehicle, air and target. Times are whole microseconds of simulated time since the start."""

    def __init__(self, config: VehicleConfig, say: Say) -> None:
        self.config = config
        self.now = 0
        self.booted = -round(config.vehicle.boot_age_s * 1e6)
        self._say = say
        self.ekf_zeros = 0  # number of the next EKF_STATUS_REPORTs with flags 0
        self.home_rise = 0.0  # height of the present home above the first one, m
        self.crashed = False  # a hard contact with the ground; the vehicle stays there
        self.air = Air(config.wind, config.seed)
        self.target = partial(target_at, config.target)
        # Time and newest sample of the rangefinder driver
        self._ranged: tuple[int, Sample] | None = None
        self.instruments = Instruments(config.sensors, config.seed, config.sih)
        self.battery = config.battery.percent
        self._battery_at = 0
        self.autopilot = AUTOPILOTS[config.vehicle.profile](
            config, say, starting_body(config, self.air.velocity)
        )
        self._velocities: deque[tuple[int, Vector]] = deque([(0, self.body.velocity)])
        self._estimator_rng = Random(f"{config.seed}:estimator")
        self._estimated_at = self.body.velocity[:2]
        self._position_rng = Random(f"{config.seed}:position")
        size = config.sensors.gps_error_m
        drift = config.sensors.dead_reckoning_mps
        self._gps_error = self._position_rng.gauss(0.0, size), self._position_rng.gauss(0.0, size)
        self._lost_drift = (
            self._position_rng.gauss(0.0, drift),
            self._position_rng.gauss(0.0, drift),
        )
        self.position_error = self._gps_error  # reported minus true, north and east, m
        self._location = (0, 0, self._altitude)  # last reported: degE7, degE7, m above sea level

    def run(self, until: int) -> None:
        """Fly to `until`. The autopilot acts whenever one of its timers is due."""
        while True:
            wake = self.autopilot.wake_us()
            if wake > until:
                break
            self._move(max(wake, self.now))
            self.autopilot.wake(self.now)
        self._move(until)

    def _move(self, to: int) -> None:
        if to > self.now:
            before = self.body
            self.autopilot.heading_error = self.instruments.heading_error(self.seconds)
            after = self.autopilot.fly((to - self.now) * 1e-6, self.air.velocity)
            after, broken = self.autopilot.touches(before, after)
            self.crashed = self.crashed or broken
            self.autopilot.body = standing(before) if self.crashed else after
            self.now = to
            trail = self._velocities
            trail.append((to, self.body.velocity))
            # 20_000: averaging time of the accelerometers, us. Autopilots filter accelerations at
            # 20 to 30 Hz.
            while trail[1][0] <= to - 20_000:
                trail.popleft()

    def specific_force(self) -> Vector:
        """Return the true specific force, m/s^2: forward, right, down; at rest (0, 0, -g)."""
        (began, before), (ended, after) = self._velocities[0], self._velocities[-1]
        seconds = max(1, ended - began) * 1e-6
        north, east, down = ((b - a) / seconds for a, b in zip(before, after, strict=True))
        return self.body.from_earth((north, east, down - GRAVITY))

    def imu(self, index: int = 0) -> tuple[Vector, Vector]:
        return self.instruments.imu(self.body, self.specific_force(), self.seconds, index)

    def step_estimate_error(self) -> None:
        """Advance the error of the autopilot's estimate by 0.1 s."""
        body = self.body
        roll = self.config.attitude_error
        if self.config.unaided_tilts and not self.autopilot.position:
            before = self._estimated_at
            self._estimated_at = body.velocity[:2]
            # A bias of the accelerometers looks like an acceleration.
            bias = to_earth(self.instruments.level_bias, self.instruments.level_bias, body.heading)
            north, east = (
                (b - a) / (DRIFT_STEP_US * 1e-6) + wrong
                for a, b, wrong in zip(before, body.velocity, bias, strict=False)
            )
            error = body.error.unaided(DRIFT_STEP_US * 1e-6, (north, east))
            self.autopilot.body = body._replace(error=error)
            return
        self._estimated_at = body.velocity[:2]
        if roll == 0:
            self.autopilot.body = body._replace(error=EstimateError())
            return
        wander = roll * (1.1 if self.config.sih else 0.6)
        error = body.error.after(
            DRIFT_STEP_US * 1e-6, roll, wander, body.heading, self._estimator_rng
        )
        self.autopilot.body = body._replace(error=error)

    def step_position_error(self) -> None:
        """Advance the error of the reported position by 0.1 s: error of the GPS, or drift without
        GPS."""
        sensors = self.config.sensors
        dt = DRIFT_STEP_US * 1e-6
        kept = math.exp(-dt / sensors.gps_error_time_s)
        fresh = sensors.gps_error_m * math.sqrt(1 - kept * kept)
        north, east = (
            kept * error + self._position_rng.gauss(0.0, fresh) for error in self._gps_error
        )
        self._gps_error = north, east
        if self.autopilot.gps:
            self.position_error = self._gps_error
            return
        external = self.autopilot.take_external_position()
        if external is not None:
            self.position_error = external[0] - self.body.north, external[1] - self.body.east
        drift = self._lost_drift
        self.position_error = (
            self.position_error[0] + drift[0] * dt,
            self.position_error[1] + drift[1] * dt,
        )

    def receive_range(self, sample: Sample) -> None:
        """Store a sample in the autopilot's rangefinder driver. It is valid until the next sample
        arrives or the sample is too old."""
        self._ranged = self.now, sample

    def latest_range(self) -> Sample | None:
        """Return the sample in the rangefinder driver. None if there is none or the sample is too
        old."""
        return (
            self._ranged[1]
            if self._ranged is not None and self.now - self._ranged[0] <= RANGE_TOO_OLD_US
            else None
        )

    def set_home(self, rise: float | None) -> None:
        """Move home to a height above the first home, m. None: to the vehicle's height
        (MAV_CMD_DO_SET_HOME)."""
        self.home_rise = -self.body.down if rise is None else rise

    def reboot(self) -> None:
        """Restart the autopilot: disarmed, in its first mode, its clock at zero. The body keeps its
        position."""
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
        """Autopilot's clock, us since its boot."""
        return self.now - self.booted

    @property
    def boot_ms(self) -> int:
        return self.boot_us // 1000 & 0xFFFFFFFF

    def charge(self, percent: float) -> None:
        self.battery = percent
        self._battery_at = self.now

    def battery_percent(self) -> float:
        minutes = (self.now - self._battery_at) / 60e6
        return max(0.0, self.battery - self.config.battery.drain_percent_per_min * minutes)

    @property
    def _altitude(self) -> float:
        return HOME_AMSL_M - self.body.down

    def location(self) -> tuple[int, int, float]:
        """Return latitude and longitude, degE7, and altitude above sea level, m. ArduPilot repeats
        the last location if the estimator has none ("we send stale data", GCS_Common.cpp)."""
        if self.autopilot.locates(self.now):
            place = self.degrees_e7() if self.autopilot.position else self._location[:2]
            self._location = (*place, self._altitude)
        return self._location

    def degrees_e7(self) -> tuple[int, int]:
        """Return the reported latitude and longitude."""
        north, east = self.position_error
        latitude, longitude = to_degrees(self.body.north + north, self.body.east + east)
        return round(latitude * 1e7), round(longitude * 1e7)

    def shown(self) -> Body:
        """Return the body as the autopilot estimates it."""
        return self.instruments.body(self.body, self.seconds)

    def slant_range(self) -> float:
        body = self.body
        return math.dist((body.north, body.east, body.down), self.target(self.seconds))

    def slant_rate(self) -> float:
        """Return the rate of the slant range, m/s, positive when it grows."""
        body = self.body
        now = self.seconds
        offset = [
            a - b for a, b in zip((body.north, body.east, body.down), self.target(now), strict=True)
        ]
        before = self.target(now - 0.01)
        after = self.target(now + 0.01)
        moved = [(b - a) / 0.02 for a, b in zip(before, after, strict=True)]
        relative = [a - b for a, b in zip(self.body.velocity, moved, strict=True)]
        return sum(a * b for a, b in zip(offset, relative, strict=True)) / max(
            self.slant_range(), 1e-6
        )

    def truth(self) -> Truth:
        body = self.body
        wind = self.air.velocity
        target = self.target(self.seconds)
        speed = body.ground_speed
        airspeed = body.airspeed(wind)
        moved = (
            body.north,
            body.east,
            body.down,
            body.heading,
            body.course,
            speed,
            airspeed,
            body.turn_rate,
            body.roll,
        )
        slant = math.dist((body.north, body.east, body.down), target)
        pilot = self.autopilot
        state = pilot.mode, pilot.armed, self.crashed, body.pitch
        return Truth(self.seconds, *moved, *target, slant, *wind, *state)
