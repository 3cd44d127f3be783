"""PX4 fixed wing: sticks in ALTCTL with height and speed held, or OFFBOARD attitude and thrust with nothing held."""

import math
from dataclasses import replace

from sim.agenda import NEVER
from sim.airframes.fixedwing import FixedWing, falling
from sim.autopilots.circling import Loiter, bank_on_loiter
from sim.autopilots.contract import ERROR, IN_AIR, ON_GROUND, Command, Say
from sim.autopilots.modes import PX4 as MODES
from sim.autopilots.px4 import ALTCTL, LAND, OFFBOARD, POSCTL, RTL, Core
from sim.autopilots.px4_tables import px4_identity, px4_parameters
from sim.autopilots.px4_targets import Rejected, Trajectory, read_setpoint
from sim.body import GRAVITY, Body
from sim.config import Event, VehicleConfig
from sim.demands import Bank, Glide, Spin, Tilt
from sim.params import Parameter
from sim.wire import Message

MANUAL_CONTROL = 69
THINK_US = 50_000
DEAD_TIME, ROLL_FREQUENCY, ROLL_DAMPING = 0.08, 4.5, 1.0  # s, rad/s: 63 % of a bank after 0.5 s
STICK_DEAD_TIME = 0.12  # s: 63 % after 0.6 .. 0.7 s
NOSE_FREQUENCY = 10.0  # rad/s: the heading's rate follows the course's by 0.14 s
COURSE_GAIN = 0.835  # rad/s: turn rate towards a position setpoint, times the sine of the angle to it
BANKED_BY_STICKS = frozenset({ALTCTL, POSCTL, MODES["ALT_CRUISE"]})
IDENTITY = px4_identity(mav_type=1)


class Px4Plane:
    """PX4's fixed wing: a bank held for the sticks and its own modes, physics for attitude setpoints."""

    def __init__(self, config: VehicleConfig, say: Say, start: Body) -> None:
        vehicle = config.vehicle
        self.identity = IDENTITY
        own = (
            Parameter("FW_R_LIM", vehicle.max_bank_deg or 50.0),
            Parameter("FW_AIRSPD_TRIM", vehicle.cruise_speed_mps or 10.0),
            Parameter("FW_AIRSPD_MIN", (vehicle.cruise_speed_mps or 10.0) * 0.7),
            Parameter("FW_AIRSPD_MAX", (vehicle.cruise_speed_mps or 10.0) * 1.5),
            Parameter("NAV_LOITER_RAD", 80.0),
        )
        self.params = px4_parameters(config, *own)
        self._core = Core(IDENTITY, self.params, config, say, self)
        self._scale = vehicle.airspeed_scale or 1.0
        ideal = vehicle.dynamics == "unicycle"
        self._by_attitude = FixedWing(
            effectiveness=vehicle.turn_effectiveness or 1.0,
            roll_lag=vehicle.turn_lag_s,
            roll_frequency=0.0 if ideal else ROLL_FREQUENCY,
            roll_damping=ROLL_DAMPING,
            dead_time=0.0 if ideal else DEAD_TIME,
            nose_frequency=0.0 if ideal else NOSE_FREQUENCY,
            trim_speed=self.params["FW_AIRSPD_TRIM"] * self._scale,
        )
        self._by_stick = replace(self._by_attitude, dead_time=0.0 if ideal else STICK_DEAD_TIME)
        self._setpoint: Trajectory | Tilt | Spin | None = None
        self._here = start
        self._height = start.down
        self._loiter = Loiter(start.north, start.east, self.params["NAV_LOITER_RAD"])
        self._think_at = 0
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
        demand = self._demand()
        airframe = self._by_attitude if isinstance(demand, Glide) else self._by_stick
        self._here = airframe.step(body, demand, dt, wind)
        return self._here

    def _demand(self) -> Bank | Glide:
        setpoint = self._setpoint
        if self.mode == OFFBOARD and isinstance(setpoint, Tilt):
            limit = math.radians(self.params["FW_R_LIM"])
            return Glide(max(-limit, min(limit, setpoint.roll)), setpoint.pitch, setpoint.thrust or 0.0)
        return Bank(self._bank, self.params["FW_AIRSPD_TRIM"] * self._scale, self._height)

    def wake_us(self) -> int:
        return min(self._core.wake_us(), self._think_at if self.armed else NEVER)

    def wake(self, now: int, body: Body) -> None:
        self._core.wake(now)
        self._think_at = now + THINK_US
        self._bank = self._wanted_bank(now, body)

    def _wanted_bank(self, now: int, body: Body) -> float:
        limit = math.radians(self.params["FW_R_LIM"])
        if self.mode in BANKED_BY_STICKS:
            return self._core.sticks.roll(now, round(self.params["COM_RC_LOSS_T"] * 1e6)) * limit
        if self.mode == OFFBOARD:
            return self._bank_to_point(body, limit)
        if not self._core.position or self.mode == LAND:
            return 0.0
        return bank_on_loiter(body, self._loiter, limit, self._by_stick.effectiveness)

    def _bank_to_point(self, body: Body, limit: float) -> float:
        """A position setpoint is flown to; one of velocities alone is taken and has no effect."""
        setpoint = self._setpoint
        if not isinstance(setpoint, Trajectory) or setpoint.position[0] is None or setpoint.position[1] is None:
            return 0.0
        if setpoint.position[2] is not None:
            self._height = setpoint.position[2]
        angle = math.atan2(setpoint.position[1] - body.east, setpoint.position[0] - body.north) - body.course
        wrapped = math.remainder(angle, math.tau)
        rate = COURSE_GAIN * (math.sin(wrapped) if abs(wrapped) < math.pi / 2 else math.copysign(1.0, wrapped))
        return max(-limit, min(limit, math.atan(body.air_speed * rate / GRAVITY)))

    # -- what is obeyed -----------------------------------------------------------------------------------------------

    def setpoint(self, message: Message, now: int, body: Body) -> bool:
        if message.get_msgId() == MANUAL_CONTROL:
            return self._core.sticks.heard(message, now, None)
        taken = read_setpoint(message, body)
        if isinstance(taken, Rejected):
            self._core.say(ERROR, taken.text)
            return False
        if taken is None:
            return False
        self._setpoint, self._here = taken, body
        self._core.setpoint_taken(now)
        return True

    def command(self, command: Command, now: int, body: Body) -> tuple[int, ...]:
        self._here = body
        return self._core.command(command, now, body)

    def heard(self, message: Message, now: int) -> None:
        self._core.heard(message, now)

    def happen(self, event: Event, now: int) -> None:
        self._core.happen(event, now)

    # -- the plane's own rules ----------------------------------------------------------------------------------------

    def entered(self, mode: int, now: int) -> None:
        self._think_at = now
        place = (0.0, 0.0) if mode == RTL else (self._here.north, self._here.east)
        self._loiter = Loiter(*place, self.params["NAV_LOITER_RAD"])
        self._height = 0.0 if mode == LAND else self._here.down

    def needs_velocity(self) -> bool:
        return not isinstance(self._setpoint, (Tilt, Spin))

    def flying(self, body: Body) -> bool:
        return self.armed and body.down < -0.1

    # -- what is reported ---------------------------------------------------------------------------------------------

    def base_mode(self) -> int:
        return self._core.base_mode()

    def system_status(self, body: Body) -> int:
        return self._core.system_status()

    def flown(self) -> None:
        return None

    def wanted_roll(self) -> float | None:
        return None

    def intended_mode(self) -> int:
        return self._core.intended

    def landed_state(self, body: Body) -> int:
        return IN_AIR if self.flying(body) else ON_GROUND

    def shown_airspeed(self, body: Body, wind: tuple[float, float]) -> float:
        return body.air_speed / self._scale

    def has_position(self) -> bool:
        return self._core.position

    def has_gps(self) -> bool:
        return self._core.gps
