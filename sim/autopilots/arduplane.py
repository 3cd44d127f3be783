"""ArduPlane 4.6.3: GUIDED takes a bank for three seconds, height and airspeed stay with the autopilot."""

import math

from sim.agenda import NEVER
from sim.airframes.fixedwing import FixedWing, falling
from sim.autopilots.ardupilot import CUSTOM_MODE_ENABLED, Core, Sensed
from sim.autopilots.ardupilot_tables import PLANE, plane_parameters
from sim.autopilots.circling import Loiter, bank_for_heading, bank_on_loiter
from sim.autopilots.contract import (
    ACCEPTED,
    DENIED,
    FAILED,
    IN_AIR,
    ON_GROUND,
    STATUS_ACTIVE,
    STATUS_CRITICAL,
    STATUS_STANDBY,
    UNSUPPORTED,
    WARNING,
    Command,
    Say,
)
from sim.autopilots.modes import PLANE as MODES
from sim.autopilots.plane_attitude import Forced, read_attitude_target
from sim.autopilots.sticks import Sticks
from sim.body import Body
from sim.config import Event, VehicleConfig
from sim.demands import Bank
from sim.wire import Message

CIRCLE, FBWA, FBWB, CRUISE, AUTO, RTL, LOITER, TAKEOFF, GUIDED = 1, 5, 6, 7, 10, 11, 12, 13, 15
STICK_MODES, LOITERING = frozenset({0, 2, 4, 5, 6, 7, 8}), frozenset({RTL, LOITER, TAKEOFF, GUIDED})
ATTITUDE_TARGET = 82
CHANGE_SPEED, CHANGE_ALTITUDE, CHANGE_HEADING, DO_CHANGE_SPEED, DO_CHANGE_ALTITUDE = 43000, 43001, 43002, 178, 186
THINK_US, LOOP_US, TIMEOUT_US = 100_000, 20_000, 3_000_000
CIRCLE_BANK = math.radians(20)
DEAD_TIME, ROLL_FREQUENCY, ROLL_DAMPING = 0.18, 5.3, 0.52  # s, rad/s: half of a bank after 0.36 .. 0.5 s, 15 % too far
NOSE_FREQUENCY = 7.5  # rad/s: the heading's rate follows the course's by 0.2 s, 2 deg of slip in a steady turn


class ArduPlane:
    """The plane's flight modes: every one comes down to a bank, a height and an airspeed."""

    def __init__(self, config: VehicleConfig, say: Say, start: Body) -> None:
        vehicle = config.vehicle
        self.identity = PLANE
        self.params = plane_parameters(config)
        mode = MODES[config.start.mode or "LOITER"]
        self._core = Core(PLANE, self.params, say, self, mode, config.start.armed, Sensed(vehicle.gps, True))
        ideal = vehicle.dynamics == "unicycle"
        self._airframe = FixedWing(
            effectiveness=vehicle.turn_effectiveness or (1.0 if ideal else 0.73),
            roll_lag=vehicle.turn_lag_s,
            roll_frequency=0.0 if ideal else ROLL_FREQUENCY,
            roll_damping=ROLL_DAMPING,
            dead_time=0.0 if ideal else DEAD_TIME,
            nose_frequency=0.0 if ideal else NOSE_FREQUENCY,
        )
        self._scale = vehicle.airspeed_scale or 1.065
        self._speed = self.params["AIRSPEED_CRUISE"]  # indicated
        self._height = start.down
        self._loiter = Loiter(start.north, start.east, self.params["WP_LOITER_RAD"])
        self._here = start
        self._forced: Forced | None = None
        self._heading: tuple[float, float] | None = None  # held by 43002: heading, bank limit
        self._since = self._think_at = 0
        self._sticks = Sticks(vehicle.system_id)
        self._bank = 0.0

    @property
    def mode(self) -> int:
        return self._core.mode

    @property
    def armed(self) -> bool:
        return self._core.armed

    # -- what is flown ------------------------------------------------------------------------------------------------

    def fly(self, body: Body, dt: float, wind: tuple[float, float]) -> Body:
        if not self.armed:
            return falling(body, dt)
        forced = self._forced or Forced(None, None, None)
        speed = self._speed * self._scale
        self._here = self._airframe.step(
            body, Bank(self._bank, speed, self._height, forced.pitch, forced.throttle), dt, wind
        )
        return self._here

    def wake_us(self) -> int:
        return min(self._think_at if self.armed else NEVER, self._core.wake_us())

    def wake(self, now: int, body: Body) -> None:
        self._core.wake(now)
        self._think_at = now + THINK_US
        if self._forced is not None and now - self._since >= TIMEOUT_US:
            self._forced = None  # without a word: back to the loiter
        self._bank = self._wanted_bank(now, body)

    def _wanted_bank(self, now: int, body: Body) -> float:
        limit = math.radians(self.params["ROLL_LIMIT_DEG"])
        if self.mode == GUIDED and self._forced is not None:
            return max(-limit, min(limit, self._forced.roll or 0.0))
        if self.mode == GUIDED and self._heading is not None:
            return bank_for_heading(body, self._heading[0], min(limit, self._heading[1]))
        if self.mode == CIRCLE:
            return CIRCLE_BANK
        if self.mode in LOITERING:
            return bank_on_loiter(body, self._loiter, min(limit, math.radians(58)), self._airframe.effectiveness)
        timeout = round(self.params["RC_OVERRIDE_TIME"] * 1e6)
        return self._sticks.roll(now, timeout) * limit if self.mode in STICK_MODES else 0.0

    # -- what is obeyed -----------------------------------------------------------------------------------------------

    def setpoint(self, message: Message, now: int, body: Body) -> bool:
        if message.get_msgId() != ATTITUDE_TARGET or self.mode != GUIDED or not self.armed:
            return self._sticks.heard(message, now, int(self.params["SYSID_MYGCS"]))
        forced = read_attitude_target(message)
        if forced is None:
            return False
        self._forced, self._since = forced, now
        if forced.pitch is not None:
            self._height = body.down
        self._think_at = now + -now % LOOP_US  # a setpoint waits for the main loop, 50 Hz
        return True

    def command(self, command: Command, now: int, body: Body) -> tuple[int, ...]:
        self._here = body
        shared = self._core.command(command, now, body)
        if shared is not None:
            return (shared,)
        if command.number == DO_CHANGE_SPEED:
            return (ACCEPTED,)
        if command.number in (DO_CHANGE_ALTITUDE, CHANGE_ALTITUDE):
            return (self._change_altitude(command),)
        if command.number == CHANGE_SPEED:
            return (self._change_speed(command),)
        if command.number == CHANGE_HEADING:
            return (self._change_heading(command),)
        mode = {20: RTL, 17: LOITER}.get(command.number)
        return (UNSUPPORTED if mode is None else self._core.change_mode(mode, now),)

    def _change_altitude(self, command: Command) -> int:
        height = command.params[0] if command.number == DO_CHANGE_ALTITUDE else command.z
        if self.mode != GUIDED or not 0 <= height < 10_000:
            return FAILED
        self._height = -height
        return ACCEPTED

    def _change_speed(self, command: Command) -> int:
        kind, speed = command.params[0], command.params[1]
        if self.mode != GUIDED:
            return FAILED
        if kind != 0 or not self.params["AIRSPEED_MIN"] <= speed <= self.params["AIRSPEED_MAX"]:
            return DENIED
        self._speed = speed
        return ACCEPTED

    def _change_heading(self, command: Command) -> int:
        kind, heading, acceleration = command.params[:3]
        if self.mode != GUIDED:
            return FAILED
        if kind not in (0, 1) or not 0 <= heading < 360 or math.isnan(acceleration):
            return DENIED
        self._heading = (math.radians(heading), math.atan(max(0.05, acceleration) / 9.80665))
        return ACCEPTED

    def heard(self, message: Message, now: int) -> None:
        self._core.heard(message, now)
        self._sticks.heard(message, now, int(self.params["SYSID_MYGCS"]))

    def happen(self, event: Event, now: int) -> None:
        self._core.happen(event, now)

    # -- the plane's own rules ----------------------------------------------------------------------------------------

    def obstacle(self, mode: int) -> str | None:
        return "missing mission" if mode == AUTO else None

    def entered(self, mode: int, now: int) -> None:
        self._forced = self._heading = None
        self._think_at = now
        home = mode == RTL
        place = (0.0, 0.0) if home else (self._here.north, self._here.east)
        self._loiter = Loiter(*place, self.params["WP_LOITER_RAD"])
        self._height = min(self._here.down, -100.0) if home else self._here.down

    def arming_refusal(self) -> str | None:
        return "Mode not armable" if self.mode in (AUTO, 16) else None

    def flying(self, body: Body) -> bool:
        return self.armed and body.down < -0.1

    def disarmed(self) -> None:
        self._forced = self._heading = None

    def ground_station_lost(self, now: int) -> None:
        self._core.say(WARNING, f"GCS Failsafe On: {self._name()}")  # FS_LONG_ACTN 0: and carries on

    def estimator_lost(self, now: int) -> None:
        """Never: a plane's estimator goes on by its airspeed."""

    def radio_lost(self, now: int) -> None:
        self._core.failsafe = True
        self._core.force_mode(RTL, now)

    def _name(self) -> str:
        return next(name for name, number in MODES.items() if number == self.mode)

    # -- what is reported ---------------------------------------------------------------------------------------------

    def base_mode(self) -> int:
        guided = 8 if self.mode in (AUTO, RTL, LOITER, GUIDED, CIRCLE, TAKEOFF) else 0
        manual = 64 if self.mode in STICK_MODES else 0
        return CUSTOM_MODE_ENABLED | 16 | manual | guided | (128 if self.armed else 0)

    def system_status(self, body: Body) -> int:
        if self._core.failsafe:
            return STATUS_CRITICAL
        return STATUS_ACTIVE if self.flying(body) else STATUS_STANDBY

    def intended_mode(self) -> int:
        return self._core.mode

    def landed_state(self, body: Body) -> int:
        return IN_AIR if self.flying(body) else ON_GROUND

    def shown_airspeed(self, body: Body, wind: tuple[float, float]) -> float:
        """Indicated: what the thin air leaves of the true airspeed."""
        return body.air_speed / self._scale

    def flown(self) -> None:
        return None

    def wanted_roll(self) -> float:
        """The bank asked for after the limit, rad (NAV_CONTROLLER_OUTPUT)."""
        return self._bank

    def has_position(self) -> bool:
        return self._core.position

    def has_gps(self) -> bool:
        return self._core.gps
