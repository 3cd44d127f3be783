"""PX4 fixed wing. ALTCTL flies the sticks, and holds height and airspeed. OFFBOARD flies to
positions."""

import math

from ..airframes.fixedwing import FixedWing, Loiter, bank_on_loiter, falling
from ..body import GRAVITY, Body, within
from ..config import VehicleConfig
from ..demands import Bank
from ..ground import plane_touches
from ..params import Parameter
from ..starting import AIRSPEED_SCALE
from .contract import Say
from .modes import PX4 as MODES
from .px4 import ALTCTL, LAND, OFFBOARD, POSCTL, RTL, Px4
from .px4_targets import Trajectory
from .tables import px4_identity, px4_parameters

DECIDE_US = 50_000
# Fitted to measurements: 63 % of a bank after 0.6 to 0.7 s. The rate of the heading lags 0.14 s
# behind the rate of the course.
AIRFRAME = FixedWing(1.0, roll_frequency=4.5, roll_damping=1.0, dead_time=0.12, nose_frequency=10.0)
# turn rate towards a position setpoint, rad/s per sine of the angle to the position
COURSE_GAIN = 0.835
BANKED_BY_STICKS = frozenset({ALTCTL, POSCTL, MODES["ALT_CRUISE"]})
IDENTITY = px4_identity(mav_type=1)


class Px4Plane(Px4):
    """PX4's fixed wing: it flies a bank, and holds height and airspeed. Attitude setpoints are
    accepted, but not flown."""

    touches = staticmethod(plane_touches)

    def __init__(self, config: VehicleConfig, say: Say, start: Body) -> None:
        vehicle = config.vehicle
        cruise = vehicle.cruise_speed_mps or 10.0
        own = (
            Parameter("FW_R_LIM", vehicle.max_bank_deg or 50.0),
            Parameter("FW_AIRSPD_TRIM", cruise),
            Parameter("FW_AIRSPD_MIN", cruise * 0.7),
            Parameter("FW_AIRSPD_MAX", cruise * 1.5),
            Parameter("NAV_LOITER_RAD", 80.0),
        )
        super().__init__(IDENTITY, px4_parameters(config, *own), config, say, start)
        self._scale = vehicle.airspeed_scale or AIRSPEED_SCALE[vehicle.profile]
        self._airframe = AIRFRAME.configured(vehicle)
        self._height = start.down
        self._loiter = Loiter(start.north, start.east, self.params["NAV_LOITER_RAD"])
        self._bank = 0.0

    def fly(self, dt: float, wind: tuple[float, float]) -> Body:
        if not self.armed:
            return falling(self.body, dt)
        return self._airframe.step(self.body, self.flown(), dt, wind)

    def flown(self) -> Bank:
        speed = self.params["FW_AIRSPD_TRIM"]
        if self.cruise is not None and self.mode not in BANKED_BY_STICKS:
            speed = max(
                self.params["FW_AIRSPD_MIN"], min(self.params["FW_AIRSPD_MAX"], self.cruise)
            )
        return Bank(self._bank, speed * self._scale, self._height)

    def wake(self, now: int) -> None:
        super().wake(now)
        self._decide_at = now + DECIDE_US
        self._bank = self._bank_command(now)

    def _bank_command(self, now: int) -> float:
        limit = math.radians(self.params["FW_R_LIM"])
        if self.mode in BANKED_BY_STICKS:
            return self.sticks.roll(now, self.params.microseconds("COM_RC_LOSS_T")) * limit
        if self.mode == OFFBOARD:
            return self._bank_to_point(limit)
        if not self.position or self.mode == LAND:
            return 0.0
        return bank_on_loiter(self.body, self._loiter, limit, self._airframe.effectiveness)

    def _bank_to_point(self, limit: float) -> float:
        """Return the bank towards a position setpoint. A setpoint of velocities alone is accepted
        without effect."""
        setpoint = self._setpoint
        body = self.body
        if (
            not isinstance(setpoint, Trajectory)
            or setpoint.position[0] is None
            or setpoint.position[1] is None
        ):
            return 0.0
        if setpoint.position[2] is not None:
            self._height = setpoint.position[2]
        angle = (
            math.atan2(setpoint.position[1] - body.east, setpoint.position[0] - body.north)
            - body.course
        )
        wrapped = math.remainder(angle, math.tau)
        rate = COURSE_GAIN * (
            math.sin(wrapped) if abs(wrapped) < math.pi / 2 else math.copysign(1.0, wrapped)
        )
        return within(math.atan(body.air_speed * rate / GRAVITY), limit)

    def hold_at(self, place: tuple[float, float] | None, down: float | None) -> None:
        if place is not None:
            self._loiter = Loiter(*place, self.params["NAV_LOITER_RAD"])
        self._height = self._height if down is None else down

    def entered(self, mode: int, now: int) -> None:
        self._decide_at = now
        place = (0.0, 0.0) if mode == RTL else (self.body.north, self.body.east)
        self._loiter = Loiter(*place, self.params["NAV_LOITER_RAD"])
        self._height = 0.0 if mode == LAND else self.body.down

    def shown_airspeed(self, shown: Body, wind: tuple[float, float]) -> float:
        return shown.air_speed / self._scale
