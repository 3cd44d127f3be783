"""ArduCopter 4.6.3. GUIDED flies velocity and attitude setpoints, GUIDED_NOGPS attitude setpoints,
each for at most 3 s."""

import math
from typing import ClassVar

from ..agenda import NEVER
from ..airframes.copter import CopterAirframe, copter_airframe
from ..body import Body
from ..config import VehicleConfig
from ..demands import BodyVelocity, Brake, Demand, EarthVelocity, Spin, Tilt, climb_rate
from ..ground import LandedState, standing
from ..links import Message
from .ardupilot import ArduPilot
from .contract import IN_AIR, LANDING, ON_GROUND, TAKING_OFF, Ack, Command, Say, Severity
from .copter_targets import (
    AT_HOME,
    GoTo,
    NotFinite,
    Speeds,
    Stop,
    climb_out,
    descent,
    read_attitude_target,
    read_local_target,
    to_point,
    way_home,
)  # fmt: skip
from .tables import COPTER, copter_parameters

ALT_HOLD = 2
GUIDED = 4
LOITER = 5
RTL = 6
LAND = 9
POSHOLD = 16
GUIDED_NOGPS = 20
SMART_RTL = 21
TAKEOFF = 22
DO_CHANGE_SPEED = 178
LEG_US = 100_000  # time between two decisions on a flight to a point
FALL = Brake(deceleration=1.0, down=10.0)  # descent after disarming; no effect on the ground
LEVEL = Tilt(0.0, 0.0)
CLIMBED_BY_STICK = frozenset({ALT_HOLD, LOITER, POSHOLD})
HUD_RELATIVE = 2  # DEV_OPTIONS, DevOptionVFR_HUDRelativeAlt
STICK_DEADZONE = 0.1  # THR_DZ, round the center of the stick
# Measured on 4.6.3: lift-off 1.4 to 1.5 s after the stick or the command (MOT_SPOOL_TIME, then
# TKOFF_SLEW_TIME), "landed" 1.5 s after the touchdown (LAND_DETECTOR_TRIGGER_SEC 1.0 after the
# throttle is down), disarmed 0.5 s later.
LIFT_OFF_US = 1_400_000
SETTLE_US = 1_500_000
LANDED_DISARM_US = 500_000
LANDING_TILT = math.radians(15)  # a larger commanded lean is no landing (land_detector.cpp)
SINKING = Tilt(0.0, 0.0, climb=-0.62)  # sinks 5 m in 8 s

Target = BodyVelocity | EarthVelocity | GoTo | Tilt | Spin


class ArduCopter(ArduPilot):
    """Flight modes of the copter. GUIDED flies one target until a timeout."""

    NEEDS_POSITION = frozenset({3, 4, 5, 6, 7, 11, 16, 17, 21})
    NOT_ARMABLE = frozenset({3, 6, 9, 14, 15, 17, 19, 21})
    MANUAL_MODES = frozenset({0, 1, 2, 5, 11, 13, 16})
    GUIDED_MODES = frozenset({3, 4, 6, 7, 9, 20})
    MODE_COMMANDS: ClassVar = {21: LAND, 20: RTL, 17: 5}

    def __init__(self, config: VehicleConfig, say: Say, start: Body) -> None:
        vehicle = config.vehicle
        gps = vehicle.gps and vehicle.profile != "arducopter_nogps"
        self.FIRST_MODE = "LOITER" if gps else "ALT_HOLD"
        super().__init__(COPTER, copter_parameters(config), config, say, start)
        self.gps = self.position = gps
        self._airspeed_sensor = vehicle.airspeed_sensor
        self._airframe: CopterAirframe = copter_airframe(vehicle)
        self._target: Target | None = None
        self._climbing_to: float | None = None
        self._leg_speeds = Speeds({}, self.params)
        self._since = 0
        self._landed = LandedState(start.down >= 0, LIFT_OFF_US, SETTLE_US)
        self._demand: Demand = self._idle() if self.armed else FALL
        if self.mode == GUIDED and config.start.speed_mps:
            self._target = self._demand = BodyVelocity(config.start.speed_mps)

    def fly(self, dt: float, wind: tuple[float, float]) -> Body:
        if self._landed.landed and self.body.down >= 0:
            return standing(self.body)
        return self._airframe.step(self.body, self._demand, dt, wind)

    def next_decision(self) -> int:
        if not self.armed:
            return NEVER
        due = super().next_decision() if self._on_a_leg() else self._target_until()
        return min(due, self._landed.next_check(self.body))

    def _target_until(self) -> int:
        return (
            NEVER
            if self._target is None
            else self._since + self.params.microseconds("GUID_TIMEOUT")
        )

    def wake(self, now: int) -> None:
        super().wake(now)
        if self.armed and self._on_a_leg():
            self._decide_at = now + LEG_US
            self._demand = self._leg()
        elif self.armed and now >= self._target_until():
            # The mode stays the same, and no STATUSTEXT is sent.
            self._rest(LEVEL if isinstance(self._target, (Tilt, Spin)) else Brake())
        if self.armed:
            self._watch_ground(now)

    def _watch_ground(self, now: int) -> None:
        """Lift off, land or disarm, as ArduCopter/land_detector.cpp, takeoff.cpp and motors.cpp
        do."""
        climb = climb_rate(self._demand)
        # On the ground, velocities are not flown (mode_guided.cpp, make_safe_ground_handling).
        lifts = self.mode in CLIMBED_BY_STICK or isinstance(self._demand, (Tilt, Spin))
        lean = (
            math.hypot(self._demand.roll, self._demand.pitch)
            if isinstance(self._demand, Tilt)
            else 0.0
        )
        disarm: int | None = None
        if self._lands():
            disarm = LANDED_DISARM_US
        elif climb < 0 and self.mode in CLIMBED_BY_STICK:
            disarm = self.params.microseconds("DISARM_DELAY")
        if self._landed.update(
            climbs=self._climbing_to is not None or (lifts and climb > 0),
            sinks=self.body.down >= 0 and climb < 0 and lean <= LANDING_TILT,
            disarm_us=disarm,
            now=now,
        ):
            self.set_armed(False, now)

    def _lands(self) -> bool:
        """True if the mode is in its final descent (is_landing in mode_land and mode_rtl)."""
        home = math.hypot(self.body.north, self.body.east) <= AT_HOME
        returns = self.mode in (RTL, SMART_RTL)
        return self.mode == LAND or (returns and (home or not self.position))

    def _on_a_leg(self) -> bool:
        guided_leg = self.mode == GUIDED and (
            self._climbing_to is not None or isinstance(self._target, GoTo)
        )
        return guided_leg or self.mode in (RTL, SMART_RTL, LAND)

    def _leg(self) -> Demand:
        body = self.body
        if self.mode == GUIDED and self._climbing_to is not None:
            demand = climb_out(body, self._climbing_to, self._leg_speeds)
            if demand is None:
                self._climbing_to = None
        elif isinstance(self._target, GoTo):
            demand = to_point(body, self._target, self._leg_speeds)
        elif not self._lands():
            demand = way_home(body, self._leg_speeds)
        else:
            demand = descent(body, self._leg_speeds, self.position)
        return demand or Brake()

    def _rest(self, demand: Demand) -> None:
        self._target = None
        self._demand = demand

    def _idle(self) -> Demand:
        if self.mode == GUIDED_NOGPS:
            return LEVEL
        climb = self._stick_climb()
        return Tilt(0.0, 0.0, climb=climb) if self.mode == ALT_HOLD else Brake(down=-climb)

    def _stick_climb(self) -> float:
        """Return the climb rate of the throttle stick (get_pilot_desired_climb_rate in mode.cpp),
        m/s."""
        if self.mode not in CLIMBED_BY_STICK or self.throttle is None:
            return 0.0
        half = 0.5 - STICK_DEADZONE
        share = max(0.0, abs(self.throttle - 0.5) - STICK_DEADZONE) / half
        return math.copysign(share * self.params["PILOT_SPEED_UP"] / 100, self.throttle - 0.5)

    def throttle_moved(self, now: int) -> None:
        if self.armed and self.mode in CLIMBED_BY_STICK:
            self._rest(self._idle())

    def setpoint(self, message: Message, now: int) -> bool:
        kind = message.get_type()
        if (
            self.mode not in (GUIDED, GUIDED_NOGPS)
            or not self.armed
            or self._climbing_to is not None
        ):
            return False
        if kind == "SET_ATTITUDE_TARGET":
            return self._take(read_attitude_target(message, self.params), now)
        if kind == "SET_POSITION_TARGET_LOCAL_NED" and self.mode == GUIDED:
            seen = self.body._replace(heading=self.body.heading + self.heading_error)
            return self._take(read_local_target(message, seen, self._airframe.turns_with_nose), now)
        # In GUIDED_NOGPS this message disturbs the controller: the copter levels and sinks.
        if kind == "SET_POSITION_TARGET_LOCAL_NED":
            self._rest(SINKING)
        return False

    def _take(self, target: Target | Stop | NotFinite | None, now: int) -> bool:
        # ArduCopter does not check that values are finite. The attitude controller loses control,
        # and the crash check disarms the vehicle in the air.
        if isinstance(target, NotFinite):
            self.say(Severity.EMERGENCY, "Crash: Disarming: AngErr=180>30, Accel=0.1<3.0")
            self.set_armed(False)
        elif isinstance(target, Stop):
            self._rest(self._idle())
        if target is None or isinstance(target, (NotFinite, Stop)):
            return False
        # The autopilot turns until the heading that it reports is the commanded one. With a compass
        # error, the true heading differs.
        if isinstance(target, Tilt) and target.heading is not None:
            target = target._replace(heading=target.heading - self.heading_error)
        self._target = target
        self._since = now
        self._decide_at = now
        self._demand = (
            to_point(self.body, target, self._leg_speeds) if isinstance(target, GoTo) else target
        )
        return True

    def go_to(self, north: float, east: float, down: float, now: int) -> None:
        self._take(GoTo(north, east, down), now)

    def own_command(self, command: Command, now: int) -> int:
        if command.number == DO_CHANGE_SPEED:
            return self._change_speed(command)
        return self._take_off(command, now) if command.number == TAKEOFF else Ack.UNSUPPORTED

    def _change_speed(self, command: Command) -> int:
        """Set the speed of flights to points, until the next DO_CHANGE_SPEED."""
        kind, speed = command.params[:2]
        names = {0: "WPNAV_SPEED", 1: "WPNAV_SPEED", 2: "WPNAV_SPEED_UP", 3: "WPNAV_SPEED_DN"}
        if kind not in names or not 0 < speed < 100:
            return Ack.FAILED
        self._leg_speeds[names[int(kind)]] = speed * 100
        return Ack.ACCEPTED

    def _take_off(self, command: Command, now: int) -> int:
        if self.mode != GUIDED or not self.armed or self.flying() or not command.z > 0:
            return Ack.FAILED
        self._climbing_to = -command.z
        self._decide_at = now
        return Ack.ACCEPTED

    def entered(self, mode: int, now: int) -> None:
        self._climbing_to = None
        self._decide_at = now
        self._rest(self._idle())

    def flying(self) -> bool:
        return self.armed and not self._landed.landed

    def set_armed(self, armed: bool, now: int = 0) -> None:
        super().set_armed(armed, now)
        self._landed.landed = not armed or self.body.down >= 0
        if armed:
            self._rest(self._idle())

    def disarmed(self) -> None:
        self._climbing_to = None
        self._rest(FALL)

    def failsafe_mode(self) -> int:
        return RTL if self.position else LAND

    def ground_station_lost(self, now: int) -> None:
        self.fail_to(self.failsafe_mode(), now, Severity.WARNING, "GCS Failsafe")

    def estimator_lost(self, now: int) -> None:
        if self.mode in self.NEEDS_POSITION and self.params["FS_EKF_ACTION"] != 0:
            self.fail_to(LAND, now, Severity.CRITICAL, "EKF Failsafe: changed to LAND Mode")

    def relative_hud(self) -> bool:
        return bool(int(self.params["DEV_OPTIONS"]) & HUD_RELATIVE)

    def flown(self) -> Demand | None:
        return self._demand if self._target is not None else None

    def landed_state(self) -> int:
        if not self.flying():
            return ON_GROUND
        if self._lands():
            return LANDING
        return TAKING_OFF if self._climbing_to is not None else IN_AIR

    def shown_airspeed(self, shown: Body, wind: tuple[float, float]) -> float:
        """Return the airspeed of the sensor, m/s. Without a sensor, return the ground speed if
        there is a position estimate, else 0."""
        if self._airspeed_sensor:
            return shown.airspeed(wind)
        return shown.ground_speed if self.position else 0.0
