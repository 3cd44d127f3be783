"""Rover 4.6.3: GUIDED takes a speed and a turn rate for three seconds, whatever the frame says."""

import math

from sim.agenda import NEVER
from sim.airframes.unicycle import Unicycle
from sim.autopilots.ardupilot import CUSTOM_MODE_ENABLED, Core, Sensed
from sim.autopilots.ardupilot_tables import ROVER, rover_parameters
from sim.autopilots.contract import (
    CRITICAL,
    ON_GROUND,
    STATUS_ACTIVE,
    STATUS_CRITICAL,
    STATUS_STANDBY,
    UNSUPPORTED,
    WARNING,
    Command,
    Say,
)
from sim.autopilots.modes import ROVER as MODES
from sim.body import Body
from sim.config import Event, VehicleConfig
from sim.demands import BodyVelocity, Brake
from sim.wire import Message

HOLD, LOITER, AUTO, RTL, SMART_RTL, GUIDED = 4, 5, 10, 11, 12, 15
NEEDS_POSITION = frozenset({LOITER, AUTO, RTL, SMART_RTL, GUIDED, 6, 9})
LOCAL_TARGET, ATTITUDE_TARGET = 84, 82
POSITION, VELOCITY, ACCELERATION, YAW, YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
THROTTLE_BIT, YAW_RATE_BIT = 0x40, 0x04
TIMEOUT_US, THINK_US = 3_000_000, 100_000
TURN_LAG, SPEED_LAG, TURN_GAIN = 0.12, 0.4, 0.985
TIGHTEST = 0.9  # m: an Ackermann rover does not turn on the spot
HOMING = 0.8


class ArduRover:
    """The rover's modes: hold, go home, or what the companion says."""

    def __init__(self, config: VehicleConfig, say: Say) -> None:
        vehicle, mode = config.vehicle, MODES[config.start.mode or "HOLD"]
        self.identity = ROVER
        self.params = rover_parameters(config)
        self._core = Core(
            ROVER, self.params, say, self, mode, config.start.armed, Sensed(vehicle.gps, vehicle.odometry)
        )
        ideal = vehicle.dynamics == "unicycle"
        limit = math.radians(vehicle.max_turn_rate_deg_s)
        self._gain = 1.0 if ideal else TURN_GAIN
        self._airframe = Unicycle(
            limit, vehicle.turn_lag_s if ideal else TURN_LAG, vehicle.speed_lag_s if ideal else SPEED_LAG
        )
        self._target: BodyVelocity | None = None
        self._homing: BodyVelocity | None = None
        self._since = self._think_at = 0
        if mode == GUIDED and config.start.speed_mps:
            self._target = BodyVelocity(config.start.speed_mps)

    @property
    def mode(self) -> int:
        return self._core.mode

    @property
    def armed(self) -> bool:
        return self._core.armed

    # -- what is flown ------------------------------------------------------------------------------------------------

    def fly(self, body: Body, dt: float, wind: tuple[float, float]) -> Body:
        target = self._target if self.mode == GUIDED else self._homing
        if not self.armed or target is None:
            return self._airframe.step(body, Brake(2.5), dt)._replace(roll=0.0)
        tightest = max(abs(body.forward_speed), 0.01) / TIGHTEST
        rate = max(-tightest, min(tightest, target.yaw_rate * self._gain))
        return self._airframe.step(body, target._replace(yaw_rate=rate), dt)._replace(roll=0.0)

    def wake_us(self) -> int:
        own = NEVER
        if self.armed and self.mode == GUIDED and self._target is not None:
            own = self._since + TIMEOUT_US
        elif self.armed and self.mode in (RTL, SMART_RTL):
            own = self._think_at
        return min(own, self._core.wake_us())

    def wake(self, now: int, body: Body) -> None:
        self._core.wake(now)
        if self.mode == GUIDED and self._target is not None and now >= self._since + TIMEOUT_US:
            self._target = None
            self._core.say(WARNING, "target not received last 3secs, stopping")
        if self.mode in (RTL, SMART_RTL):
            self._think_at = now + THINK_US
            self._homing = self._way_home(body)

    def _way_home(self, body: Body) -> BodyVelocity | None:
        if math.hypot(body.north, body.east) < 2.0:
            return None
        error = math.remainder(math.atan2(-body.east, -body.north) - body.heading, math.tau)
        return BodyVelocity(self.params["WP_SPEED"], yaw_rate=HOMING * error)

    # -- what is obeyed -----------------------------------------------------------------------------------------------

    def setpoint(self, message: Message, now: int, body: Body) -> bool:
        if self.mode != GUIDED or not self.armed:
            return False
        number = message.get_msgId()
        target = None
        if number == LOCAL_TARGET:
            target = self._local_target(message, body)
        elif number == ATTITUDE_TARGET:
            target = self._attitude_target(message, body)
        if target is None or not all(map(math.isfinite, target)):
            return False
        self._target, self._since = target, now
        return True

    def _local_target(self, message: Message, body: Body) -> BodyVelocity | None:
        """Velocity and yaw rate; the frame is irrelevant. Other combinations are dropped without a word."""
        mask = message.type_mask
        if not (mask & POSITION and mask & ACCELERATION) or mask & YAW_RATE:
            return None
        if mask & VELOCITY:
            return BodyVelocity(0.0, yaw_rate=message.yaw_rate)
        speed = math.copysign(math.hypot(message.vx, message.vy), message.vx)
        return BodyVelocity(self._clipped(speed), yaw_rate=message.yaw_rate)

    def _attitude_target(self, message: Message, body: Body) -> BodyVelocity | None:
        """Thrust is a share of WP_SPEED; the yaw rate counts whatever the other bits say."""
        if message.type_mask & THROTTLE_BIT:
            return None
        speed = self._clipped(message.thrust * self.params["WP_SPEED"])
        if not message.type_mask & YAW_RATE_BIT:
            return BodyVelocity(speed, yaw_rate=message.body_yaw_rate)
        w, x, y, z = message.q
        heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return BodyVelocity(speed, yaw_rate=HOMING * math.remainder(heading - body.heading, math.tau))

    def _clipped(self, speed: float) -> float:
        most = self.params["WP_SPEED"]
        return max(-most, min(most, speed)) if math.isfinite(speed) else speed

    def command(self, command: Command, now: int, body: Body) -> tuple[int, ...]:
        shared = self._core.command(command, now, body)
        if shared is not None:
            return (shared,)
        mode = {20: RTL, 17: LOITER}.get(command.number)
        return (UNSUPPORTED if mode is None else self._core.change_mode(mode, now),)

    def heard(self, message: Message, now: int) -> None:
        self._core.heard(message, now)

    def happen(self, event: Event, now: int) -> None:
        self._core.happen(event, now)

    # -- the rover's own rules ----------------------------------------------------------------------------------------

    def obstacle(self, mode: int) -> str | None:
        if mode in NEEDS_POSITION and not self._core.position:
            return "requires position"
        return "missing mission" if mode == AUTO else None

    def entered(self, mode: int, now: int) -> None:
        self._target = self._homing = None
        self._think_at = now

    def arming_refusal(self) -> str | None:
        return "Mode not armable" if self.mode in (AUTO, RTL, SMART_RTL, 16) else None

    def flying(self, body: Body) -> bool:
        return False

    def disarmed(self) -> None:
        self._target = self._homing = None

    def ground_station_lost(self, now: int) -> None:
        self._core.say(WARNING, "Radio Failsafe")  # so it says, for a ground station too
        self._core.force_mode(HOLD, now)

    def estimator_lost(self, now: int) -> None:
        if self.params["FS_EKF_ACTION"] != 0:
            self._core.failsafe = True
            self._core.say(CRITICAL, "EKF failsafe")
            self._core.force_mode(HOLD, now)

    def radio_lost(self, now: int) -> None:
        self._core.failsafe = True
        self._core.force_mode(HOLD, now)

    # -- what is reported ---------------------------------------------------------------------------------------------

    def base_mode(self) -> int:
        guided = 8 if self.mode in (AUTO, RTL, SMART_RTL, GUIDED) else 0
        manual = 64 if self.mode in (0, 1, 3) else 0
        return CUSTOM_MODE_ENABLED | manual | guided | (128 if self.armed else 0)

    def system_status(self, body: Body) -> int:
        if self._core.failsafe:
            return STATUS_CRITICAL
        return STATUS_ACTIVE if self.armed else STATUS_STANDBY

    def flown(self) -> None:
        return None

    def wanted_roll(self) -> float | None:
        return None

    def intended_mode(self) -> int:
        return self._core.mode

    def landed_state(self, body: Body) -> int:
        return ON_GROUND

    def shown_airspeed(self, body: Body, wind: tuple[float, float]) -> float:
        return 0.0

    def has_position(self) -> bool:
        return self._core.position

    def has_gps(self) -> bool:
        return self._core.gps
