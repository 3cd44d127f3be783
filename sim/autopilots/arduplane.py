"""ArduPlane 4.6.3. GUIDED flies a commanded bank for at most 3 s. The autopilot controls height and
airspeed."""

import math
from typing import ClassVar, NamedTuple

from ..agenda import NEVER
from ..airframes.fixedwing import FixedWing, Loiter, bank_on_loiter, falling, rolling
from ..body import GRAVITY, Body, euler, to_earth, within
from ..config import VehicleConfig
from ..demands import Bank
from ..ground import plane_touches
from ..links import Message
from ..starting import AIRSPEED_SCALE
from ..world import from_degrees
from .ardupilot import ArduPilot
from .contract import LAST_ITEM, TRANSITION_TO_WINGS, Ack, Command, Say, Severity
from .sticks import Sticks
from .tables import PLANE, plane_parameters

CIRCLE = 1
AUTO = 10
RTL = 11
LOITER = 12
TAKEOFF = 13
GUIDED = 15
LOITERING = frozenset({RTL, LOITER, TAKEOFF, GUIDED})
# bits of SET_ATTITUDE_TARGET.type_mask
ROLL_RATE = 0x01
PITCH_RATE = 0x02
THROTTLE = 0x40
ATTITUDE = 0x80
EXTERNAL_POSITION = 43003
CHANGE_SPEED = 43000
CHANGE_ALTITUDE = 43001
CHANGE_HEADING = 43002
DO_CHANGE_SPEED = 178
DO_CHANGE_ALTITUDE = 186
DECIDE_US = 100_000
LOOP_US = 20_000
TIMEOUT_US = 3_000_000
HEADING_GAIN = 2.0
CIRCLE_BANK = math.radians(20)
# Fitted to measurements. A bank reaches half its value after 0.36 to 0.5 s and overshoots by 15 %.
# The side-slip is 1 deg at 14 deg of bank, 2.2 deg at 26 deg, and 3.7 deg at 42 deg.
# is_flying.cpp: the probability of flight is a low-pass of the condition "the plane moves", updated
# at 5 Hz. Above 0.1 the plane is flying.
FLYING_US = 200_000
FLYING_SHARE = 0.15
FLYING_ABOVE = 0.1
MOVES_MPS = 1.5  # GPS_IS_FLYING_SPEED_CMS
# AP_Airspeed_Health.cpp at 5 Hz. The gate is fitted to a sensor stuck at 27 m/s on 4.6.3, which was
# disabled after 13 s.
AIRSPEED_GATE = 9.5  # inconsistency of reading and ground speed, m/s
AIRSPEED_DECAY = 0.9
AIRSPEED_GROWTH = 0.98
AIRSPEED_DISABLE = 0.1
AIRSPEED_ENABLE = 0.95
# Measured on 4.6.3 at a commanded airspeed of 22 m/s, which is 23.6 m/s true airspeed there: with a
# sensor stuck at 27 m/s the throttle closed, and the true airspeed was 16.5 m/s on average. Without
# the sensor, the cruise throttle gave 25.5 m/s.
SPEED_PER_ERROR = 1.2
UNAIDED_SPEED = 1.08
# Take-off in mode TAKEOFF, measured on 4.6.3: the throttle opens within 1 s (THR_SLEWRATE). The
# plane lifts off at 0.84 of AIRSPEED_CRUISE, and then climbs with 18 deg of pitch (9 m/s).
SPOOL_US = 700_000
ROTATION = 0.84
CLIMB_PITCH = math.radians(22)
LEVEL_ROLL = math.radians(5)  # LEVEL_ROLL_LIMIT, up to TKOFF_LVL_ALT, and in a transition
APPROACH_SINK = 2.0  # sink rate on the approach of AUTO, m/s
# In another mode, a plane that rolls on the ground lifts off at this share of AIRSPEED_CRUISE.
UNINTENDED_LIFT = 0.94
UNSUPPRESSED_MPS = 5.0  # speed above which the throttle works on the ground (suppress_throttle)
LIFT = (-0.067, 0.044)
FIN = (0.0173, -0.0346)
HELD = 0.994  # 4.6.3: 26.61 deg of bank at a command of 26.77 deg
AIRFRAME = FixedWing(
    0.747, 0.0, 5.3, 0.52, dead_time=0.18, nose_frequency=13.6, pitch=LIFT, fin=FIN, held=HELD
)


class ArduPlane(ArduPilot):
    """Flight modes of the plane. Each mode gives a bank, a height and an airspeed."""

    FIRST_MODE = "LOITER"
    touches = staticmethod(plane_touches)
    POSITION_LOSS_US = 10_000_000  # NavEKF3's posRetryTimeUseVel_ms
    NOT_ARMABLE = frozenset({10, 16})
    MANUAL_MODES = frozenset({0, 2, 4, 5, 6, 7, 8})
    GUIDED_MODES = frozenset({1, 10, 11, 12, 13, 15})
    MODE_COMMANDS: ClassVar = {20: RTL, 17: LOITER}

    def __init__(self, config: VehicleConfig, say: Say, start: Body) -> None:
        vehicle = config.vehicle
        super().__init__(PLANE, plane_parameters(config), config, say, start)
        self._odometry = True  # the estimator continues with airspeed
        self._airframe = AIRFRAME.configured(vehicle)
        self._scale = vehicle.airspeed_scale or AIRSPEED_SCALE[vehicle.profile]
        self._speed = self.params["AIRSPEED_CRUISE"]  # indicated
        self._height = start.down
        self._loiter = Loiter(start.north, start.east, self.params["WP_LOITER_RAD"])
        self._forced: Forced | None = None
        self._heading: tuple[float, float] | None = None  # heading and bank limit of command 43002
        self._since = 0
        self._sticks = Sticks(vehicle.system_id)
        self._bank = 0.0
        self._flying = 0.0 if start.down >= 0 else 1.0  # isFlyingProbability
        self._flying_at = 0
        self._airspeed_health = 1.0
        self._airspeed_disabled = False  # by the health check, not by the operator
        self._thrust_at = NEVER  # time of full throttle in a take-off

    def fly(self, dt: float, wind: tuple[float, float]) -> Body:
        if not self.armed:
            return falling(self.body, dt)
        if self.body.down >= 0 and not self._lifts_off():
            aim = self._speed * self._scale if self._thrusts() else None
            return rolling(self.body, dt, wind, aim)
        _, pitch, throttle = self._forced or Forced(None, None, None)
        if self._taking_off():
            pitch = CLIMB_PITCH
            throttle = 0.5
        demand = Bank(self._bank, self._aim() * self._scale, self._height, pitch, throttle)
        return self._airframe.step(self.body, demand, dt, wind)

    def wake(self, now: int) -> None:
        super().wake(now)
        self._decide_at = now + DECIDE_US
        self._update_flying(now)
        if self._forced is not None and now - self._since >= TIMEOUT_US:
            self._forced = None  # the plane loiters again, without a STATUSTEXT
        if self.mode == AUTO and self.waypoint == LAST_ITEM:
            self._height = min(0.0, self._height + APPROACH_SINK * DECIDE_US * 1e-6)
        self._bank = self._bank_command(now)

    def _update_flying(self, now: int) -> None:
        """Update the probability that the plane is flying (update_is_flying_5Hz). It rises above
        the threshold with the first sample of a moving plane."""
        if now < self._flying_at:
            return
        self._flying_at = now + FLYING_US
        self._check_airspeed()
        body = self.body
        slow = 0.75 * self.params["AIRSPEED_MIN"]
        moves = self._reading() >= slow and body.ground_speed > 0
        moves = moves or (self.gps and body.ground_speed >= MOVES_MPS)
        self._flying += (moves - self._flying) * FLYING_SHARE
        if self.mode == TAKEOFF and self._thrust_at == NEVER and body.down >= 0:
            self._thrust_at = now + SPOOL_US
            north, east = to_earth(self.params["TKOFF_DIST"], 0.0, body.heading)
            radius = self.params["WP_LOITER_RAD"]
            self._loiter = Loiter(body.north + north, body.east + east, radius)
            self._height = -self.params["TKOFF_ALT"]
        # 2.0: the climb ends this far below TKOFF_ALT, m (mode_takeoff.cpp).
        elif self._taking_off() and body.down <= self._height + 2.0:
            self._thrust_at = NEVER

    def _aim(self) -> float:
        """Return the indicated airspeed that the throttle holds. A wrong reading opens or closes
        the throttle."""
        if self.params["ARSPD_USE"] != 1:
            return UNAIDED_SPEED * self._speed
        if self.stuck_airspeed is None:
            return self._speed
        wrong = self._speed - SPEED_PER_ERROR * (self.stuck_airspeed - self._speed)
        return max(self.params["AIRSPEED_MIN"], min(self.params["AIRSPEED_MAX"], wrong))

    def _check_airspeed(self) -> None:
        """Disable or re-enable the airspeed sensor. The check needs GPS; without GPS the sensor is
        used again."""
        used = self.params["ARSPD_USE"] == 1
        if not self.gps:
            if self._airspeed_disabled:
                self._use_airspeed(True, "Airspeed sensor 1, Re-enabled as GPS fall-back")
            return
        true = self.body.air_speed / self._scale
        good = abs(self._reading() - true) <= AIRSPEED_GATE * (1.0 if used else 0.7)
        kept = AIRSPEED_GROWTH if good else AIRSPEED_DECAY
        self._airspeed_health = kept * self._airspeed_health + (1 - kept) * good
        if used and self._airspeed_health < AIRSPEED_DISABLE:
            self._use_airspeed(False, "Airspeed sensor 1 failure. Disabling")
        elif self._airspeed_disabled and self._airspeed_health > AIRSPEED_ENABLE:
            self._use_airspeed(True, "Airspeed sensor 1 now OK. Re-enabled")

    def _reading(self) -> float:
        """Return the indicated airspeed of the sensor, m/s."""
        true = self.body.air_speed / self._scale
        return true if self.stuck_airspeed is None else self.stuck_airspeed

    def _use_airspeed(self, used: bool, text: str) -> None:
        self.params["ARSPD_USE"] = float(used)
        self._airspeed_disabled = not used
        self.say(Severity.NOTICE if used else Severity.ERROR, text)

    def _taking_off(self) -> bool:
        """True in the flight stage TAKEOFF."""
        return self.mode == TAKEOFF and self._thrust_at != NEVER

    def _thrusts(self) -> bool:
        """True if the throttle of a plane on the ground is open."""
        if self.mode == TAKEOFF:
            return self._flying_at - FLYING_US >= self._thrust_at
        if self.mode in self.MANUAL_MODES:
            return (self.throttle or 0.0) > 0.5
        return self.body.ground_speed >= UNSUPPRESSED_MPS

    def _lifts_off(self) -> bool:
        share = ROTATION if self._taking_off() else UNINTENDED_LIFT
        return self._thrusts() and self.body.air_speed / self._scale >= share * self._speed

    def flying(self) -> bool:
        return self.armed and self._flying >= FLYING_ABOVE

    def _bank_command(self, now: int) -> float:
        limit = math.radians(self.params["ROLL_LIMIT_DEG"])
        if self.vtol_state == TRANSITION_TO_WINGS:
            limit = LEVEL_ROLL
        if self.mode == GUIDED and self._forced is not None:
            return within(self._forced.roll or 0.0, limit)
        if self.mode == GUIDED and self._heading is not None:
            heading = self._heading[0]
            limit = min(limit, self._heading[1])
            return within(
                HEADING_GAIN * math.remainder(heading - self.body.heading, math.tau), limit
            )
        if self.mode == CIRCLE:
            return CIRCLE_BANK
        if self._taking_off():
            limit = LEVEL_ROLL
        if self.mode in LOITERING:
            return bank_on_loiter(
                self.body, self._loiter, min(limit, math.radians(58)), self._airframe.effectiveness
            )
        held = self.mode in self.MANUAL_MODES
        return (
            self._sticks.roll(now, self.params.microseconds("RC_OVERRIDE_TIME")) * limit
            if held
            else 0.0
        )

    def setpoint(self, message: Message, now: int) -> bool:
        if message.get_type() != "SET_ATTITUDE_TARGET" or self.mode != GUIDED or not self.armed:
            return self._sticks.receive(message, now, int(self.params["SYSID_MYGCS"]))
        forced = read_attitude_target(message)
        if forced is None:
            return False
        self._forced = forced
        self._since = now
        if forced.pitch is not None:
            self._height = self.body.down
        self._decide_at = now + -now % LOOP_US  # a setpoint waits for the main loop, 50 Hz
        return True

    def go_to(self, north: float, east: float, down: float, now: int) -> None:
        self._forced = self._heading = None
        self._loiter = Loiter(north, east, self.params["WP_LOITER_RAD"])
        self._height = down

    def own_command(self, command: Command, now: int) -> int:
        if command.number == EXTERNAL_POSITION:
            return self._set_external_position(command)
        if command.number in (DO_CHANGE_ALTITUDE, CHANGE_ALTITUDE):
            return self._change_altitude(command)
        if command.number in (CHANGE_SPEED, DO_CHANGE_SPEED):
            return self._change_speed(command)
        return (
            self._change_heading(command) if command.number == CHANGE_HEADING else Ack.UNSUPPORTED
        )

    def _set_external_position(self, command: Command) -> int:
        """Accept an external position as NavEKF3 does: only without GPS and only without an
        altitude."""
        if not math.isnan(command.z) or not (abs(command.x) <= 90 and abs(command.y) <= 180):
            return Ack.DENIED
        if self.gps:
            return Ack.FAILED
        self._external_position = from_degrees(command.x, command.y)
        return Ack.ACCEPTED

    def _change_altitude(self, command: Command) -> int:
        height = command.params[0] if command.number == DO_CHANGE_ALTITUDE else command.z
        if self.mode != GUIDED or not 0 <= height < 10_000:
            return Ack.FAILED
        self._height = -height
        return Ack.ACCEPTED

    def _change_speed(self, command: Command) -> int:
        kind = command.params[0]
        speed = command.params[1]
        # This mission item is accepted in all modes without pilot input.
        mission = command.number == DO_CHANGE_SPEED
        if self.mode != GUIDED and not (mission and self.mode in self.GUIDED_MODES):
            return Ack.FAILED
        if kind != 0 or not self.params["AIRSPEED_MIN"] <= speed <= self.params["AIRSPEED_MAX"]:
            return Ack.FAILED if mission else Ack.DENIED
        self._speed = speed
        return Ack.ACCEPTED

    def _change_heading(self, command: Command) -> int:
        kind, heading, acceleration = command.params[:3]
        if self.mode != GUIDED:
            return Ack.FAILED
        if kind not in (0, 1) or not 0 <= heading < 360 or math.isnan(acceleration):
            return Ack.DENIED
        self._heading = (math.radians(heading), math.atan(max(0.05, acceleration) / GRAVITY))
        return Ack.ACCEPTED

    def on_message(self, message: Message, now: int) -> None:
        super().on_message(message, now)
        self._sticks.receive(message, now, int(self.params["SYSID_MYGCS"]))

    def entered(self, mode: int, now: int) -> None:
        self._forced = self._heading = None
        self._decide_at = now
        home = mode == RTL
        place = (0.0, 0.0) if home else (self.body.north, self.body.east)
        self._loiter = Loiter(*place, self.params["WP_LOITER_RAD"])
        self._height = min(self.body.down, -100.0) if home else self.body.down
        self._thrust_at = NEVER
        if mode == TAKEOFF:
            self._height = min(self.body.down, -self.params["TKOFF_ALT"])

    def disarmed(self) -> None:
        self._forced = self._heading = None

    def failsafe_mode(self) -> int:
        return RTL

    def ground_station_lost(self, now: int) -> None:
        self.say(
            Severity.WARNING, f"GCS Failsafe On: {self.mode_name(self.mode)}"
        )  # FS_LONG_ACTN 0: the mode stays

    def shown_airspeed(self, shown: Body, wind: tuple[float, float]) -> float:
        """Return the indicated airspeed."""
        return shown.air_speed / self._scale

    def commanded_roll(self) -> float:
        return self._bank


class Forced(NamedTuple):
    """Values forced by a companion computer. None: controlled by the autopilot."""

    roll: float | None
    pitch: float | None
    throttle: float | None


def read_attitude_target(message: Message) -> Forced | None:
    """Read SET_ATTITUDE_TARGET as handle_set_attitude_target in GCS_Mavlink.cpp does.

    The ignore bits only select the forced values: roll if its rate bit or the attitude bit is
    clear, pitch likewise, throttle if its bit is clear. Body rates are never used. Return None for
    throttle alone and for invalid values.
    """
    mask = message.type_mask
    q = tuple(message.q)
    size = sum(v * v for v in q)
    if not math.isfinite(size) or size <= 0 or not math.isfinite(message.thrust):
        return None
    roll, pitch, _ = euler(tuple(v / math.sqrt(size) for v in q))
    whole = not mask & ATTITUDE
    forced = Forced(
        roll=roll if whole or not mask & ROLL_RATE else None,
        pitch=pitch if whole or not mask & PITCH_RATE else None,
        throttle=message.thrust if not mask & THROTTLE else None,
    )
    return forced if forced.roll is not None or forced.pitch is not None else None
