"""ArduCopter 4.6.3: GUIDED takes velocities and yaw rates, for three seconds after the last one."""

import math

from sim.agenda import NEVER
from sim.airframes.unicycle import Unicycle
from sim.autopilots.ardupilot import (
    ARM_DISARM,
    CAPABILITIES,
    CUSTOM_MODE_ENABLED,
    DO_SET_MODE,
    SET_LOCAL_POSITION,
    STREAMABLE,
    UNKNOWN_IDS,
    VERSION_4_6_3,
    ModeSwitch,
    arming_ack,
)
from sim.autopilots.contract import (
    ACCEPTED,
    EMERGENCY,
    FAILED,
    IN_AIR,
    LANDING,
    ON_GROUND,
    STATUS_ACTIVE,
    STATUS_STANDBY,
    TAKING_OFF,
    UNSUPPORTED,
    Command,
    Identity,
    Say,
)
from sim.autopilots.copter_targets import GoTo, Poison, Stop, read_local_target
from sim.autopilots.legs import toward
from sim.autopilots.modes import COPTER as MODES
from sim.body import Body
from sim.config import VehicleConfig
from sim.demands import BodyVelocity, Brake, Demand, EarthVelocity
from sim.params import INT8, INT16, Parameter, Parameters
from sim.wire import Message

GUIDED, RTL, LAND, AUTO, SMART_RTL = 4, 6, 9, 3, 21
NEEDS_POSITION = frozenset({3, 4, 5, 6, 7, 11, 16, 17, 21})
NOT_ARMABLE = frozenset({3, 6, 9, 14, 15, 17, 19, 21})
HOVER_TYPE = 2
SETPOINT_IDS = frozenset({84})
LEG_US = 100_000
TAKEOFF_COMMAND, LAND_COMMAND, RTL_COMMAND, LOITER_COMMAND = 22, 21, 20, 17

IDENTITY = Identity(
    profile="arducopter",
    mav_type=HOVER_TYPE,
    autopilot=3,
    version=VERSION_4_6_3,
    capabilities=CAPABILITIES | SET_LOCAL_POSITION,
    modes=MODES,
    streamable=STREAMABLE,
    fastest_us=3_125,  # loop rate 400 Hz
    unknown_ids=UNKNOWN_IDS,
)


def parameters(config: VehicleConfig) -> Parameters:
    table = (
        Parameter("SYSID_THISMAV", config.vehicle.system_id, INT16),
        Parameter("SYSID_MYGCS", 255, INT16),
        Parameter("ARMING_CHECK", 1, INT16),
        Parameter("FS_GCS_ENABLE", 0, INT8),
        Parameter("FS_GCS_TIMEOUT", 5.0),
        Parameter("FS_EKF_ACTION", 1, INT8),
        Parameter("GUID_OPTIONS", 0, INT16),
        Parameter("GUID_TIMEOUT", config.vehicle.setpoint_timeout_s or 3.0),
        Parameter("LAND_SPEED", 50, INT16),
        Parameter("RTL_ALT", 1500, INT16),
        Parameter("WPNAV_SPEED", 1000.0),
        Parameter("WPNAV_SPEED_UP", 250.0),
        Parameter("WPNAV_SPEED_DN", 150.0),
        Parameter("WPNAV_ACCEL", 250.0),
    )
    return Parameters(table, bytewise=False)


class ArduCopter:
    """The copter's flight modes; velocities are flown by the ideal airframe."""

    def __init__(self, config: VehicleConfig, say: Say) -> None:
        self.identity = IDENTITY
        self.params = parameters(config)
        self.armed = config.start.armed
        self._say = say
        self._gps = config.vehicle.gps
        self._modes = ModeSwitch(MODES, MODES[config.start.mode or "LOITER"], say)
        limit = math.radians(config.vehicle.max_turn_rate_deg_s)
        self._airframe = Unicycle(limit, config.vehicle.turn_lag_s, config.vehicle.speed_lag_s)
        self._climbing_to: float | None = None
        self._target: BodyVelocity | EarthVelocity | GoTo | None = None
        self._since = 0
        self._leg_at = 0
        self._demand: Demand = Brake()
        if self.mode == GUIDED and config.start.speed_mps > 0:
            self._target = BodyVelocity(config.start.speed_mps)
            self._demand = self._target

    @property
    def mode(self) -> int:
        return self._modes.mode

    # -- what is flown ------------------------------------------------------------------------------------------------

    def fly(self, body: Body, dt: float, wind: tuple[float, float]) -> Body:
        return self._airframe.step(body, self._demand, dt)

    def wake_us(self) -> int:
        if not self.armed:
            return NEVER
        if self._on_a_leg():
            return self._leg_at
        if self._target is not None:
            return self._since + round(self.params["GUID_TIMEOUT"] * 1e6)
        return NEVER

    def wake(self, now: int, body: Body) -> None:
        if self._on_a_leg():
            self._leg_at = now + LEG_US
            self._demand = self._leg(body)
        else:  # GUID_TIMEOUT: brakes and hovers in GUIDED, without a word
            self._target = None
            self._demand = Brake()

    def _on_a_leg(self) -> bool:
        guided_leg = self.mode == GUIDED and (self._climbing_to is not None or isinstance(self._target, GoTo))
        return guided_leg or self.mode in (RTL, SMART_RTL, LAND)

    def _leg(self, body: Body) -> Demand:
        climb, sink = self.params["WPNAV_SPEED_UP"] / 100, self.params["WPNAV_SPEED_DN"] / 100
        speed = self.params["WPNAV_SPEED"] / 100
        if self.mode == GUIDED and self._climbing_to is not None:
            if body.down <= self._climbing_to + 0.1:
                self._climbing_to = None
                return Brake()
            return EarthVelocity(0.0, 0.0, max(-climb, 0.5 * (self._climbing_to - body.down) - 0.2))
        if isinstance(self._target, GoTo):
            return toward(body, *self._target, speed, climb if self._target.down < body.down else sink)
        return self._way_home(body, speed, climb) if self.mode != LAND else self._descent(body)

    def _way_home(self, body: Body, speed: float, climb: float) -> Demand:
        if body.north**2 + body.east**2 <= 4.0:
            return self._descent(body)
        cruise = min(body.down, -self.params["RTL_ALT"] / 100)
        if body.down > cruise + 0.5:
            return EarthVelocity(0.0, 0.0, -climb)
        return toward(body, 0.0, 0.0, cruise, speed, climb)

    def _descent(self, body: Body) -> Demand:
        if body.down >= -0.01:
            self._disarm()
            return Brake()
        low = body.down > -10.0
        return Brake(down=self.params["LAND_SPEED"] / 100 if low else self.params["WPNAV_SPEED_DN"] / 100)

    # -- what is obeyed -----------------------------------------------------------------------------------------------

    def setpoint(self, message: Message, now: int, body: Body) -> bool:
        if (
            message.get_msgId() not in SETPOINT_IDS
            or self.mode != GUIDED
            or not self.armed
            or self._climbing_to is not None
        ):
            return False
        target = read_local_target(message, body, turns_with_nose=True)
        if isinstance(target, Poison):
            self._crash()
            return False
        if isinstance(target, Stop):
            self._target, self._demand = None, Brake()
            return False
        self._target, self._since, self._leg_at = target, now, now
        self._demand = self._leg(body) if isinstance(target, GoTo) else target
        return True

    def command(self, command: Command, now: int, body: Body) -> tuple[int, ...]:
        if command.number == DO_SET_MODE:
            return (self._modes.command(command, self._obstacle, lambda mode: self._enter(mode, now)),)
        if command.number == ARM_DISARM:
            return (self._arming(command, body),)
        if command.number == TAKEOFF_COMMAND:
            return (self._take_off(command, now, body),)
        mode = {LAND_COMMAND: LAND, RTL_COMMAND: RTL, LOITER_COMMAND: MODES["LOITER"]}.get(command.number)
        if mode is None:
            return (UNSUPPORTED,)
        return (self._modes.change(mode, self._obstacle, lambda entered: self._enter(entered, now)),)

    def heard(self, message: Message, now: int) -> None:
        if message.get_msgId() == 11:  # SET_MODE has no ack
            enabled = message.base_mode & CUSTOM_MODE_ENABLED
            if enabled:
                self._modes.change(message.custom_mode, self._obstacle, lambda mode: self._enter(mode, now))

    def _obstacle(self, mode: int) -> str | None:
        if mode == AUTO:
            return "missing mission"
        if mode in NEEDS_POSITION and not self._gps:
            return "requires position"
        return None

    def _enter(self, mode: int, now: int) -> None:
        self._target, self._climbing_to, self._leg_at = None, None, now
        self._demand = Brake()

    def _arming(self, command: Command, body: Body) -> int:
        refusal = "Mode not armable" if self.mode in NOT_ARMABLE else None
        if self.mode in NEEDS_POSITION and not self._gps:
            refusal = "Need Position Estimate"
        ack, armed = arming_ack(command, self.armed, refusal, self._flying(body), self._say)
        if self.armed and not armed:
            self._disarm()
        self.armed = armed
        return ack

    def _take_off(self, command: Command, now: int, body: Body) -> int:
        if self.mode != GUIDED or not self.armed or self._flying(body) or not command.z > 0:
            return FAILED
        self._climbing_to, self._leg_at = -command.z, now
        return ACCEPTED

    def _disarm(self) -> None:
        self.armed = False
        self._target, self._climbing_to = None, None
        self._demand = Brake(deceleration=10.0)

    def _crash(self) -> None:
        self._say(EMERGENCY, "Crash: Disarming: AngErr=180>30, Accel=0.1<3.0")
        self._disarm()
        self._demand = Brake(deceleration=1.0, down=10.0)

    # -- what is reported ---------------------------------------------------------------------------------------------

    def base_mode(self) -> int:
        manual = 64 if self.mode in (0, 1, 2, 5, 11, 13, 16) else 0
        guided = 8 if self.mode in (3, 4, 6, 7, 9, 20) else 0
        return CUSTOM_MODE_ENABLED | 16 | manual | guided | (128 if self.armed else 0)

    def system_status(self, body: Body) -> int:
        return STATUS_ACTIVE if self._flying(body) else STATUS_STANDBY

    def landed_state(self, body: Body) -> int:
        if not self._flying(body):
            return ON_GROUND
        if self._climbing_to is not None:
            return TAKING_OFF
        return LANDING if self.mode == LAND else IN_AIR

    def shown_airspeed(self, body: Body, wind: tuple[float, float]) -> float:
        """A copter without an airspeed sensor shows its ground speed."""
        return body.ground_speed

    def has_position(self) -> bool:
        return self._gps

    def _flying(self, body: Body) -> bool:
        return self.armed and (body.down < -0.1 or self._climbing_to is not None)
