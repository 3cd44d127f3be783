"""ArduCopter 4.6.3: GUIDED takes velocities, GUIDED and GUIDED_NOGPS attitudes, each for three seconds."""

from sim.agenda import NEVER
from sim.airframes.copter import CopterAirframe, copter_airframe
from sim.autopilots import copter_legs as legs
from sim.autopilots.ardupilot import CUSTOM_MODE_ENABLED, Core, Sensed
from sim.autopilots.ardupilot_tables import COPTER, copter_parameters
from sim.autopilots.contract import (
    ACCEPTED,
    CRITICAL,
    EMERGENCY,
    FAILED,
    IN_AIR,
    LANDING,
    ON_GROUND,
    STATUS_ACTIVE,
    STATUS_CRITICAL,
    STATUS_STANDBY,
    TAKING_OFF,
    UNSUPPORTED,
    WARNING,
    Command,
    Say,
)
from sim.autopilots.copter_attitude import read_attitude_target
from sim.autopilots.copter_targets import GoTo, Poison, Stop, read_local_target
from sim.autopilots.modes import COPTER as MODES
from sim.body import Body
from sim.config import Event, VehicleConfig
from sim.demands import BodyVelocity, Brake, Demand, EarthVelocity, Spin, Tilt
from sim.wire import Message

AUTO, GUIDED, RTL, LAND, GUIDED_NOGPS, SMART_RTL = 3, 4, 6, 9, 20, 21
NEEDS_POSITION = frozenset({3, 4, 5, 6, 7, 11, 16, 17, 21})
NOT_ARMABLE = frozenset({3, 6, 9, 14, 15, 17, 19, 21})
LOCAL_TARGET, ATTITUDE_TARGET = 84, 82
TAKEOFF, MODE_COMMANDS = 22, {21: LAND, 20: RTL, 17: 5}
LEG_US = 100_000
FALL = Brake(deceleration=1.0, down=10.0)  # on the ground: nothing
LEVEL = Tilt(0.0, 0.0)
SINKING = Tilt(0.0, 0.0, climb=-0.62)  # 5 m in 8 s


Target = BodyVelocity | EarthVelocity | GoTo | Tilt | Spin


class ArduCopter:
    """The copter's flight modes over an airframe; what GUIDED flies is one target and the time it came."""

    def __init__(self, config: VehicleConfig, say: Say) -> None:
        gps = config.vehicle.gps and config.vehicle.profile != "arducopter_nogps"
        sensed = Sensed(gps, config.vehicle.odometry)
        self._airspeed_sensor = config.vehicle.airspeed_sensor
        mode = MODES[config.start.mode or ("LOITER" if gps else "ALT_HOLD")]
        self.identity = COPTER
        self.params = copter_parameters(config)
        self._core = Core(COPTER, self.params, say, self, mode, config.start.armed, sensed)
        self._airframe: CopterAirframe = copter_airframe(config.vehicle)
        self._target: Target | None = None
        self._climbing_to: float | None = None
        self._since = self._leg_at = 0
        self._demand: Demand = self._idle() if config.start.armed else FALL
        if mode == GUIDED and config.start.speed_mps:
            self._target = self._demand = BodyVelocity(config.start.speed_mps)

    @property
    def mode(self) -> int:
        return self._core.mode

    @property
    def armed(self) -> bool:
        return self._core.armed

    # -- what is flown ------------------------------------------------------------------------------------------------

    def fly(self, body: Body, dt: float, wind: tuple[float, float]) -> Body:
        return self._airframe.step(body, self._demand, dt, wind)

    def wake_us(self) -> int:
        own = NEVER
        if self.armed and self._on_a_leg():
            own = self._leg_at
        elif self.armed and self._target is not None:
            own = self._since + round(self.params["GUID_TIMEOUT"] * 1e6)
        return min(own, self._core.wake_us())

    def wake(self, now: int, body: Body) -> None:
        self._core.wake(now)
        if not self.armed:
            return
        if self._on_a_leg():
            self._leg_at = now + LEG_US
            self._demand = self._leg(body)
        elif self._target is not None and now >= self._since + round(self.params["GUID_TIMEOUT"] * 1e6):
            self._rest(LEVEL if isinstance(self._target, (Tilt, Spin)) else Brake())  # without a word, in the same mode

    def _on_a_leg(self) -> bool:
        guided_leg = self.mode == GUIDED and (self._climbing_to is not None or isinstance(self._target, GoTo))
        return guided_leg or self.mode in (RTL, SMART_RTL, LAND)

    def _leg(self, body: Body) -> Demand:
        if self.mode == GUIDED and self._climbing_to is not None:
            demand = legs.climb_out(body, self._climbing_to, self.params)
            if demand is None:
                self._climbing_to = None
            return demand or Brake()
        if isinstance(self._target, GoTo):
            return legs.to_point(body, self._target, self.params)
        landing = self.mode == LAND or not self._core.position
        demand = (legs.descent if landing else legs.way_home)(body, self.params)
        if demand is None:
            self._core.disarm()
        return demand or Brake()

    def _rest(self, demand: Demand) -> None:
        self._target, self._demand = None, demand

    def _idle(self) -> Demand:
        return LEVEL if self.mode == GUIDED_NOGPS else Brake()

    # -- what is obeyed -----------------------------------------------------------------------------------------------

    def setpoint(self, message: Message, now: int, body: Body) -> bool:
        number = message.get_msgId()
        busy = self._climbing_to is not None
        if self.mode not in (GUIDED, GUIDED_NOGPS) or not self.armed or busy:
            return False
        target: Target | Stop | Poison | None = None
        if number == LOCAL_TARGET:
            target = read_local_target(message, body, self._airframe.turns_with_nose)
            if self.mode == GUIDED_NOGPS:  # taken, and it upsets the controller: stops and sinks
                self._rest(SINKING)
                return False
        elif number == ATTITUDE_TARGET:
            target = read_attitude_target(message, self.params)
        return self._take(target, now, body)

    def _take(self, target: Target | Stop | Poison | None, now: int, body: Body) -> bool:
        if target is None:
            return False
        if isinstance(target, Poison):
            self._crash()
            return False
        if isinstance(target, Stop):
            self._rest(self._idle())
            return False
        self._target, self._since, self._leg_at = target, now, now
        self._demand = legs.to_point(body, target, self.params) if isinstance(target, GoTo) else target
        return True

    def command(self, command: Command, now: int, body: Body) -> tuple[int, ...]:
        shared = self._core.command(command, now, body)
        if shared is not None:
            return (shared,)
        if command.number == TAKEOFF:
            return (self._take_off(command, now, body),)
        mode = MODE_COMMANDS.get(command.number)
        return (UNSUPPORTED if mode is None else self._core.change_mode(mode, now),)

    def heard(self, message: Message, now: int) -> None:
        self._core.heard(message, now)

    def happen(self, event: Event, now: int) -> None:
        self._core.happen(event, now)

    def _take_off(self, command: Command, now: int, body: Body) -> int:
        if self.mode != GUIDED or not self.armed or self.flying(body) or not command.z > 0:
            return FAILED
        self._climbing_to, self._leg_at = -command.z, now
        return ACCEPTED

    def _crash(self) -> None:
        self._core.say(EMERGENCY, "Crash: Disarming: AngErr=180>30, Accel=0.1<3.0")
        self._core.disarm()

    # -- the copter's own rules ---------------------------------------------------------------------------------------

    def obstacle(self, mode: int) -> str | None:
        if mode in NEEDS_POSITION and not self._core.position:
            return "requires position"
        return "missing mission" if mode == AUTO else None

    def entered(self, mode: int, now: int) -> None:
        self._climbing_to, self._leg_at = None, now
        self._rest(self._idle())

    def arming_refusal(self) -> str | None:
        if self.mode in NOT_ARMABLE:
            return "Mode not armable"
        return "Need Position Estimate" if self.mode in NEEDS_POSITION and not self._core.position else None

    def flying(self, body: Body) -> bool:
        return self.armed and (body.down < -0.1 or self._climbing_to is not None)

    def disarmed(self) -> None:
        self._climbing_to = None
        self._rest(FALL)

    def ground_station_lost(self, now: int) -> None:
        self._core.say(WARNING, "GCS Failsafe")
        self._core.force_mode(RTL if self._core.position else LAND, now)

    def estimator_lost(self, now: int) -> None:
        if self.mode in NEEDS_POSITION and self.params["FS_EKF_ACTION"] != 0:
            self._core.failsafe = True
            self._core.say(CRITICAL, "EKF Failsafe: changed to LAND Mode")
            self._core.force_mode(LAND, now)

    def radio_lost(self, now: int) -> None:
        self._core.failsafe = True
        self._core.force_mode(RTL if self._core.position else LAND, now)

    # -- what is reported ---------------------------------------------------------------------------------------------

    def base_mode(self) -> int:
        manual = 64 if self.mode in (0, 1, 2, 5, 11, 13, 16) else 0
        guided = 8 if self.mode in (3, 4, 6, 7, 9, 20) else 0
        return CUSTOM_MODE_ENABLED | 16 | manual | guided | (128 if self.armed else 0)

    def system_status(self, body: Body) -> int:
        if self._core.failsafe:
            return STATUS_CRITICAL
        return STATUS_ACTIVE if self.flying(body) else STATUS_STANDBY

    def flown(self) -> Demand | None:
        return self._demand if self._target is not None else None

    def wanted_roll(self) -> float | None:
        return None

    def intended_mode(self) -> int:
        return self._core.mode

    def landed_state(self, body: Body) -> int:
        if not self.flying(body):
            return ON_GROUND
        if self._climbing_to is not None:
            return TAKING_OFF
        return LANDING if self.mode == LAND else IN_AIR

    def shown_airspeed(self, body: Body, wind: tuple[float, float]) -> float:
        """A copter without an airspeed sensor shows its ground speed, if it knows it."""
        if self._airspeed_sensor:
            return body.airspeed(wind)
        return body.ground_speed if self.has_position() else 0.0

    def has_position(self) -> bool:
        return self._core.position

    def has_gps(self) -> bool:
        return self._core.gps
