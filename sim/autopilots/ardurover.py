"""Rover 4.6.3. GUIDED drives a commanded speed and turn rate for at most 3 s, in every coordinate
frame."""

import math
from typing import ClassVar

from ..agenda import NEVER
from ..airframes.multicopter import YawLoop
from ..airframes.rover import RingingRover
from ..airframes.unicycle import Unicycle
from ..body import Body, euler, within
from ..config import VehicleConfig
from ..demands import BodyVelocity, Brake
from ..ground import rover_touches
from ..links import Message
from .ardupilot import ArduPilot
from .contract import CUSTOM_MODE_ENABLED, Ack, Command, Say, Severity
from .tables import ROVER, rover_parameters

HOLD = 4
LOITER = 5
RTL = 11
SMART_RTL = 12
GUIDED = 15
DO_CHANGE_SPEED = 178
POSITION = 0x007
VELOCITY = 0x038
ACCELERATION = 0x1C0
YAW_RATE = 0x800
THROTTLE_BIT = 0x40
YAW_RATE_BIT = 0x04
TIMEOUT_US = 3_000_000
DECIDE_US = 100_000
TURN_LAG = 0.12  # lag of the turn rate, s
SPEED_LAG = 0.4  # lag of the speed, s
TURN_GAIN = 0.985  # realized over commanded turn rate
TIGHTEST = 0.9  # smallest turn radius of an Ackermann rover, m
HOMING = 0.8  # turn rate per heading error, 1/s
NEARNESS = 0.4  # speed per remaining distance, 1/s
AT_PLACE = 2.0  # arrival radius, m


class ArduRover(ArduPilot):
    """Modes of the rover: hold, return home, or drive the companion's setpoints."""

    FIRST_MODE = "HOLD"
    touches = staticmethod(rover_touches)
    NEEDS_POSITION = frozenset({5, 6, 9, 10, 11, 12, 15})
    NOT_ARMABLE = frozenset({10, 11, 12, 16})
    MANUAL_MODES = frozenset({0, 1, 3})
    GUIDED_MODES = frozenset({10, 11, 12, 15})
    MODE_COMMANDS: ClassVar = {20: RTL, 17: LOITER}
    BASE_MODE = CUSTOM_MODE_ENABLED

    def __init__(self, config: VehicleConfig, say: Say, start: Body) -> None:
        vehicle = config.vehicle
        super().__init__(ROVER, rover_parameters(config), config, say, start)
        ideal = vehicle.dynamics == "unicycle"
        limit = math.radians(vehicle.max_turn_rate_deg_s)
        self._gain = 1.0 if ideal else TURN_GAIN
        self._airframe: Unicycle | RingingRover = Unicycle(
            limit,
            vehicle.turn_lag_s if ideal else TURN_LAG,
            vehicle.speed_lag_s if ideal else SPEED_LAG,
        )
        if not ideal and (vehicle.turn_damping or vehicle.turn_frequency_rad_s):
            self._airframe = RingingRover(
                YawLoop(limit, 0.05, 1 / TURN_LAG, 0.7).configured(vehicle), SPEED_LAG
            )
        self._target: BodyVelocity | None = None
        self._goal: tuple[float, float] | None = None  # north, east
        self._leg_speed = self.params["WP_SPEED"]
        self._homing: BodyVelocity | None = None
        self._since = 0
        if self.mode == GUIDED and config.start.speed_mps:
            self._target = BodyVelocity(config.start.speed_mps)

    def fly(self, dt: float, wind: tuple[float, float]) -> Body:
        target = self._homing if self._goal is not None else self._target
        if not self.armed or target is None:
            return self._airframe.step(self.body, Brake(2.5), dt)._replace(roll=0.0)
        tightest = max(abs(self.body.forward_speed), 0.01) / TIGHTEST
        rate = within(target.yaw_rate * self._gain, tightest)
        return self._airframe.step(self.body, target._replace(yaw_rate=rate), dt)._replace(roll=0.0)

    def next_decision(self) -> int:
        if self.armed and self.mode == GUIDED and self._target is not None:
            return self._since + TIMEOUT_US
        return NEVER if self._goal is None else super().next_decision()

    def wake(self, now: int) -> None:
        super().wake(now)
        if self.mode == GUIDED and self._target is not None and now >= self._since + TIMEOUT_US:
            self._target = None
            self.say(Severity.WARNING, "target not received last 3secs, stopping")
        if self._goal is not None:
            self._decide_at = now + DECIDE_US
            self._homing = self._way(*self._goal)

    def _way(self, north: float, east: float) -> BodyVelocity | None:
        body = self.body
        distance = math.hypot(body.north - north, body.east - east)
        if distance < AT_PLACE:
            return None
        error = math.remainder(
            math.atan2(east - body.east, north - body.north) - body.heading, math.tau
        )
        speed = min(self._leg_speed, NEARNESS * distance)
        return BodyVelocity(speed, yaw_rate=HOMING * error)

    def setpoint(self, message: Message, now: int) -> bool:
        if self.mode != GUIDED or not self.armed:
            return False
        target = None
        kind = message.get_type()
        if kind == "SET_POSITION_TARGET_LOCAL_NED":
            target = self._local_target(message)
        elif kind == "SET_ATTITUDE_TARGET":
            target = self._attitude_target(message)
        if target is None or not all(map(math.isfinite, target)):
            return False
        self._target = target
        self._since = now
        self._goal = None
        return True

    def go_to(self, north: float, east: float, down: float, now: int) -> None:
        self._target = None
        self._goal = (north, east)
        self._decide_at = now

    def own_command(self, command: Command, now: int) -> int:
        """Handle DO_CHANGE_SPEED. It is accepted only on a leg to a place, because a setpoint has
        its own speed."""
        if command.number != DO_CHANGE_SPEED:
            return Ack.UNSUPPORTED
        if self._goal is None or not 0 < command.params[1] < 100:
            return Ack.FAILED
        self._leg_speed = command.params[1]
        return Ack.ACCEPTED

    def _local_target(self, message: Message) -> BodyVelocity | None:
        """Return velocity and yaw rate in any frame, or None for other combinations, which are
        dropped silently."""
        mask = message.type_mask
        if not (mask & POSITION and mask & ACCELERATION) or mask & YAW_RATE:
            return None
        if mask & VELOCITY:
            return BodyVelocity(0.0, yaw_rate=message.yaw_rate)
        speed = math.copysign(math.hypot(message.vx, message.vy), message.vx)
        return BodyVelocity(self._clipped(speed), yaw_rate=message.yaw_rate)

    def _attitude_target(self, message: Message) -> BodyVelocity | None:
        """Return speed (thrust times WP_SPEED) and yaw rate. If the yaw rate is masked, steer to
        the heading."""
        if message.type_mask & THROTTLE_BIT:
            return None
        speed = self._clipped(message.thrust * self.params["WP_SPEED"])
        if not message.type_mask & YAW_RATE_BIT:
            return BodyVelocity(speed, yaw_rate=message.body_yaw_rate)
        heading = euler(tuple(message.q))[2]
        return BodyVelocity(
            speed, yaw_rate=HOMING * math.remainder(heading - self.body.heading, math.tau)
        )

    def _clipped(self, speed: float) -> float:
        most = self.params["WP_SPEED"]
        return within(speed, most) if math.isfinite(speed) else speed

    def entered(self, mode: int, now: int) -> None:
        self._target = self._homing = None
        self._leg_speed = self.params["WP_SPEED"]
        self._goal = (0.0, 0.0) if mode in (RTL, SMART_RTL) else None
        self._decide_at = now

    def flying(self) -> bool:
        return False

    def disarmed(self) -> None:
        self._target = self._homing = self._goal = None

    def failsafe_mode(self) -> int:
        return HOLD

    def ground_station_lost(self, now: int) -> None:
        self.radio_lost(now)  # the rover sends the same text as for a lost radio

    def estimator_lost(self, now: int) -> None:
        if self.params["FS_EKF_ACTION"] != 0:
            self.fail_to(HOLD, now, Severity.CRITICAL, "EKF failsafe")

    def active(self) -> bool:
        return self.armed

    def shown_airspeed(self, shown: Body, wind: tuple[float, float]) -> float:
        return 0.0
