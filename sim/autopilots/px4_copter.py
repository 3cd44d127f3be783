"""PX4 multicopter. OFFBOARD flies velocity and attitude setpoints, each for at most 1 s. After a
timeout, a new setpoint returns the vehicle to OFFBOARD."""

import math

from ..airframes.copter import PX4_LEAN_DEG, CopterAirframe, TiltingCopter
from ..airframes.multicopter import DraggedCopter, YawLoop
from ..airframes.unicycle import Unicycle
from ..body import Body, at_most
from ..config import VehicleConfig
from ..demands import BodyVelocity, Brake, Demand, EarthVelocity, Spin, Tilt, climb_rate
from ..ground import LandedState, standing
from ..links import Message
from ..params import Parameter
from ..world import HOME_AMSL_M
from .contract import IN_AIR, LANDING, ON_GROUND, TAKING_OFF, Command, Say
from .px4 import ALTCTL, LAND, LOITER, NEEDS_STICKS, OFFBOARD, RTL, TAKEOFF, Px4
from .px4_targets import NOTHING, Trajectory
from .tables import px4_identity, px4_parameters

DECIDE_US = 20_000
IDLE_US = 500_000
MOST_YAW_RATE = 2.25  # as flown with MC_YAWRATE_MAX 200 deg/s, rad/s
POSITION_GAIN = 0.95  # velocity per position error, 1/s
YAW_GAIN = 2.8  # turn rate per heading error, 1/s
HEIGHT_GAIN = 1.0  # climb rate per height error, 1/s
FASTEST = 12.0  # MPC_XY_VEL_MAX, m/s
AT_HOME = 2.0  # arrival radius, m
CLIMB = 3.0  # largest climb rate, m/s
SINK = 1.5  # largest sink rate, m/s
DEADZONE = 0.1  # MAN_DEADZONE of the yaw stick
CUBIC = 0.6  # cubic share of the curve of the yaw stick
UNHELD_SINK = 0.7  # sink rate in ALTCTL without sticks or position, as flown, m/s
# COM_SPOOLUP_TIME 1.0 s, then half of MPC_TKO_RAMP_T 3.0 s until the thrust lifts the copter
LIFT_OFF_US = 2_500_000
SETTLE_US = 1_000_000  # three stages of 1/3 s (MulticopterLandDetector.cpp)
LANDED_SINK = 0.25  # LNDMC_Z_VEL_MAX: a landing commands at least 1.1 times this sink rate, m/s
IDENTITY = px4_identity(mav_type=2)


class Px4Copter(Px4):
    """PX4's multicopter. OFFBOARD flies the last accepted setpoint."""

    def __init__(self, config: VehicleConfig, say: Say, start: Body) -> None:
        vehicle = config.vehicle
        own = (
            Parameter("MC_YAWRATE_MAX", 200.0),
            Parameter("MPC_XY_VEL_MAX", FASTEST),
            Parameter("MPC_TILTMAX_AIR", vehicle.max_lean_deg or PX4_LEAN_DEG),
            Parameter("MPC_MAN_TILT_MAX", 35.0),
            Parameter("MPC_MAN_Y_MAX", 150.0),
            Parameter("MAN_DEADZONE", DEADZONE),
            Parameter("MIS_TAKEOFF_ALT", 2.5),
            Parameter("COM_DISARM_LAND", 2.0),
            Parameter("COM_DISARM_PRFLT", 10.0),
            Parameter("RTL_RETURN_ALT", 60.0),
        )
        super().__init__(IDENTITY, px4_parameters(config, *own), config, say, start)
        limit = min(MOST_YAW_RATE, math.radians(vehicle.max_turn_rate_deg_s))
        drag = 1.0 if vehicle.drag_per_s is None else vehicle.drag_per_s
        lean = vehicle.max_lean_deg or PX4_LEAN_DEG
        # Measured: 63 % of a step after 0.45 to 0.5 s.
        yaw_loop = YawLoop(limit, dead_time=0.12, frequency=5.0, damping=0.7)
        real = DraggedCopter(yaw_loop.configured(vehicle), drag, math.radians(lean))
        ideal = Unicycle(limit, vehicle.turn_lag_s, vehicle.speed_lag_s)
        by_velocity = ideal if vehicle.dynamics == "unicycle" else real
        self._airframe = CopterAirframe(by_velocity, TiltingCopter(limit, drag, quadratic=False))
        self._hold = (start.north, start.east, start.down)
        self._demand: Demand = Brake()
        self._landed = LandedState(start.down >= 0, LIFT_OFF_US, SETTLE_US)

    def fly(self, dt: float, wind: tuple[float, float]) -> Body:
        if not self.armed:
            return _at_rest(self.body, dt)
        if self._landed.landed and self.body.down >= 0:
            return standing(self.body)
        return self._airframe.step(self.body, self._demand, dt, wind)

    def wake(self, now: int) -> None:
        super().wake(now)
        if now >= self._decide_at:
            self._decide(now)
        if self.armed:
            self._watch_ground(now)

    def next_decision(self) -> int:
        due = super().next_decision()
        return min(due, self._landed.next_check(self.body)) if self.armed else due

    def _watch_ground(self, now: int) -> None:
        """Lift off, land or disarm, as MulticopterLandDetector.cpp and Commander.cpp do."""
        climb = climb_rate(self._demand)
        returned = self.mode in (LAND, RTL)
        name = "COM_DISARM_LAND" if returned else "COM_DISARM_PRFLT"
        if self._landed.update(
            climbs=climb > 0 and self.mode in (TAKEOFF, OFFBOARD, ALTCTL),
            sinks=self.body.down >= 0 and climb <= -1.1 * LANDED_SINK,
            disarm_us=self.params.microseconds(name),
            now=now,
        ):
            self.set_armed(False, now)

    def flying(self) -> bool:
        return self.armed and not self._landed.landed

    def set_armed(self, armed: bool, now: int) -> None:
        super().set_armed(armed, now)
        self._landed.landed = not armed or self.body.down >= 0

    def _decide(self, now: int) -> None:
        self._decide_at = now + (IDLE_US if self._steady() else DECIDE_US)
        self._demand = self._wanted()

    def _steady(self) -> bool:
        """True if the demand is constant until the next setpoint."""
        if self.mode != OFFBOARD or self._setpoint is None:
            return False
        if isinstance(self._setpoint, Trajectory):
            return self._setpoint.position == NOTHING and self._setpoint.heading is None
        return True

    def _wanted(self) -> Demand:
        mode = self.mode
        body = self.body
        if mode == OFFBOARD:
            if isinstance(self._setpoint, (Tilt, Spin)):
                return self._setpoint
            return self._from_trajectory(self._setpoint)
        if mode == ALTCTL and self.sticks_alive(self._decide_at):
            return self._by_sticks(self._decide_at)
        if mode in NEEDS_STICKS and not self.position:
            return EarthVelocity(body.velocity_north * 0.9, body.velocity_east * 0.9, UNHELD_SINK)
        if mode == LAND or not self.position:
            return self._landing()
        if mode == RTL:
            return self._going_home()
        if mode == TAKEOFF:
            return self._taking_off()
        return _towards(body, *self._hold, min(FASTEST, self.cruise or FASTEST))

    def _by_sticks(self, now: int) -> Tilt:
        """Return the tilt in ALTCTL. The sticks tilt the copter, and the autopilot holds the
        height."""
        timeout = self.params.microseconds("COM_RC_LOSS_T")
        most = math.tan(math.radians(self.params["MPC_MAN_TILT_MAX"]))
        forward, right = at_most(
            self.sticks.forward(now, timeout), self.sticks.roll(now, timeout), 1.0
        )
        deflection = self.sticks.yaw(now, timeout)
        free = max(0.0, abs(deflection) - DEADZONE) / (1 - DEADZONE)
        curved = math.copysign((1 - CUBIC) * free + CUBIC * free**3, deflection)
        yaw_rate = curved * math.radians(self.params["MPC_MAN_Y_MAX"])
        roll = math.atan(right * most)
        pitch = -math.atan(forward * most)
        return Tilt(roll, pitch, yaw_rate=yaw_rate, climb=self._stick_climb(now))

    def _stick_climb(self, now: int) -> float:
        """Return the climb rate of the pilot's throttle stick, m/s. Sticks over MAVLink replace
        it and hold the height."""
        if self.throttle is None or super().sticks_alive(now):
            return 0.0
        stick = 2 * self.throttle - 1
        free = max(0.0, abs(stick) - DEADZONE) / (1 - DEADZONE)
        return math.copysign(free, stick) * (CLIMB if stick > 0 else SINK)

    def sticks_alive(self, now: int) -> bool:
        return self.throttle is not None or super().sticks_alive(now)

    def throttle_moved(self, now: int) -> None:
        self._decide_at = now

    def _from_trajectory(self, setpoint: Trajectory | None) -> Demand:
        """Return the demand: the setpoint's velocity plus the output of the position loop. With an
        incomplete setpoint, brake."""
        body = self.body
        if setpoint is None:
            return _towards(body, *self._hold)
        here = (body.north, body.east, body.down)
        wanted = []
        for place, velocity, acceleration, now in zip(
            setpoint.position, setpoint.velocity, setpoint.acceleration, here, strict=True
        ):
            if place is None and velocity is None and acceleration is None:
                return Brake()
            to_place = POSITION_GAIN * (place - now) if place is not None else 0.0
            wanted.append((velocity or 0.0) + to_place)
        yaw_rate = self._yaw_rate(setpoint)
        north, east = at_most(wanted[0], wanted[1], FASTEST)
        down = max(-CLIMB, min(SINK, wanted[2]))
        if setpoint.along_nose is not None and self._airframe.turns_with_nose:
            return BodyVelocity(*at_most(*setpoint.along_nose, FASTEST), down, yaw_rate)
        return EarthVelocity(
            north, east, down, yaw_rate, *(fed or 0.0 for fed in setpoint.acceleration[:2])
        )

    def _yaw_rate(self, setpoint: Trajectory) -> float:
        if setpoint.heading is None:
            return setpoint.yaw_rate or 0.0
        error = math.remainder(setpoint.heading - self.body.heading, math.tau)
        return (setpoint.yaw_rate or 0.0) + YAW_GAIN * error

    def _at_home(self) -> bool:
        return math.hypot(self.body.north, self.body.east) < AT_HOME

    def _landing(self) -> EarthVelocity:
        return EarthVelocity(0.0, 0.0, 0.7)

    def _going_home(self) -> Demand:
        body = self.body
        if self._at_home():
            north, east = -POSITION_GAIN * body.north, -POSITION_GAIN * body.east
            return self._landing()._replace(north=north, east=east)
        cruise = min(body.down, -self.params["RTL_RETURN_ALT"])
        if body.down > cruise + 1.0:
            return EarthVelocity(0.0, 0.0, -CLIMB)
        return _towards(body, 0.0, 0.0, cruise, 5.0)

    def _taking_off(self) -> Demand:
        asked = self.take_off_to
        body = self.body
        height = (
            asked - HOME_AMSL_M
            if asked is not None and math.isfinite(asked)
            else self.params["MIS_TAKEOFF_ALT"]
        )
        if body.down <= -height + 0.2:
            self._hold = (body.north, body.east, -height)
            self.change_mode(LOITER, self._decide_at)
        return EarthVelocity(0.0, 0.0, max(-1.5, min(0.0, -height - body.down - 0.1)))

    def setpoint(self, message: Message, now: int) -> bool:
        taken = super().setpoint(message, now)
        if (
            taken
            and message.get_type() != "MANUAL_CONTROL"
            and self.mode == OFFBOARD
            and self.armed
        ):
            self._decide(now)
        return taken

    def command(self, command: Command, now: int) -> tuple[int, ...]:
        self._hold = (self.body.north, self.body.east, self.body.down)
        return super().command(command, now)

    def hold_at(self, place: tuple[float, float] | None, down: float | None) -> None:
        north, east = place or self._hold[:2]
        self._hold = (north, east, self._hold[2] if down is None else down)

    def entered(self, mode: int, now: int) -> None:
        self._decide_at = now

    def flown(self) -> Demand | None:
        return self._demand if self.mode == OFFBOARD else None

    def landed_state(self) -> int:
        if not self.flying():
            return ON_GROUND
        landing = self.mode == LAND or (self.mode == RTL and self._at_home())
        return LANDING if landing else TAKING_OFF if self.mode == TAKEOFF else IN_AIR

    def shown_airspeed(self, shown: Body, wind: tuple[float, float]) -> float:
        return math.nan


def _towards(
    body: Body, north: float, east: float, down: float, speed: float = FASTEST
) -> EarthVelocity:
    vn, ve = at_most(
        POSITION_GAIN * (north - body.north), POSITION_GAIN * (east - body.east), speed
    )
    return EarthVelocity(vn, ve, max(-CLIMB, min(SINK, HEIGHT_GAIN * (down - body.down))))


def _at_rest(body: Body, dt: float) -> Body:
    down = min(0.0, body.down + 10.0 * dt)
    return body._replace(
        down=down,
        velocity_north=0.0,
        velocity_east=0.0,
        velocity_down=10.0 if down < 0 else 0.0,
        turn_rate=0.0,
    )
