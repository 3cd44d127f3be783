"""Interface of the vehicle adapters: their properties, the inputs of a setpoint, and the setpoint
messages."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from math import atan, hypot, radians, tan
from typing import ClassVar, NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.copter_air import SCALE_BOUNDS, SCALE_SIGMA, CopterAir
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.types import GRAVITY
from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.autopilots.parameters import Name, Rule
from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.frames import (
    YawRate,
    euler_from_quaternion,
    pitch_from_thrust,
    quaternion_from_euler,
    roll_from_thrust,
)
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.setpoint_guard import Steer

PLAUSIBLE_AIRSPEED = (0.5, 1.6)
"""Least and largest plausible measured airspeed, as shares of the commanded airspeed. Outside, the
sensor is faulty (a blocked pitot tube): circnav then uses the commanded airspeed for bank and
thrust."""
TRUSTED_AGAIN = (0.6, 1.5)
"""Least and largest measured airspeed, as shares of the commanded airspeed, at which a rejected
sensor is used again. The hysteresis prevents steps of thrust and bank when noise crosses the
bound."""
FULL_STICK = 50.0
"""Bank at full stick, deg: the default of PX4's FW_R_LIM."""
FULL_TILT = 35.0
"""Tilt of a copter at full stick, deg: the default of PX4's MPC_MAN_TILT_MAX."""
FOLLOWED = 1.1
"""Largest ratio of the commanded acceleration to the vehicle's acceleration limit at which the
vehicle is assumed to follow its commands. In flight, ArduCopter followed at a ratio of 1.05."""
VELOCITY_IGNORED = (
    dialect.POSITION_TARGET_TYPEMASK_VX_IGNORE | dialect.POSITION_TARGET_TYPEMASK_AX_IGNORE
)
COPTER_KINDS = (
    "QUADROTOR COAXIAL HELICOPTER HEXAROTOR OCTOROTOR TRICOPTER DECAROTOR DODECAROTOR"
    " GENERIC_MULTIROTOR"
)
COPTER_TYPES = frozenset(getattr(dialect, f"MAV_TYPE_{kind}") for kind in COPTER_KINDS.split())
PLANE_TYPES = frozenset((dialect.MAV_TYPE_FIXED_WING,))


@dataclass(frozen=True, slots=True)
class VehicleFacts:
    """Vehicle data from the mission.

    speed: V, m/s.
    max_bank: rad, for vehicles that turn by banking, and for copters flown by attitude.
    drag: coefficient of `guidance.copter_air`, 1/s.
    """

    speed: float
    max_bank: float
    drag: float

    def stick(self, bank: float) -> float:
        """Return the roll stick of MANUAL_CONTROL, thousandths to the right, for a bank (rad, right
        positive)."""
        return 1000 * min(max(bank / radians(FULL_STICK), -1.0), 1.0)

    def tilt_stick(self, thrust_acceleration: float) -> float:
        """Return the pitch or roll stick of a copter, thousandths, for a thrust acceleration,
        m/s^2. Stick and thrust acceleration have the same sign."""
        return 1000 * min(max(thrust_acceleration / (GRAVITY * tan(radians(FULL_TILT))), -1.0), 1.0)


class SetpointContext(NamedTuple):
    """Target ids and vehicle state that a setpoint may use.

    target_system, target_component: ids of the vehicle.
    motion: the vehicle's own motion.
    height: altitude to hold, m above sea level; None if the altitude is unknown or the vehicle
        holds its own.
    """

    target_system: int
    target_component: int
    motion: Motion
    height: float | None


@dataclass(frozen=True, slots=True)
class Firmware:
    """Common properties of the vehicles of one autopilot.

    key: name of the autopilot in mission files.
    autopilot: MAV_AUTOPILOT in its HEARTBEAT.
    flown: firmware version with which our messages were tested in flight.
    streams: message id -> Hz to request.
    mode_numbers: custom_mode -> parameters 2 and 3 of MAV_CMD_DO_SET_MODE.
    bytewise: True if PARAM_VALUE contains the bytes of an integer instead of a float of the same
        value.
    why_must_leave: human-readable reason why a flight must end with a mode change and is not
        resumed after a takeover. Empty if neither applies.
    """

    key: str
    autopilot: int
    flown: str
    streams: Mapping[int, float]
    mode_numbers: Callable[[int], tuple[int, ...]]
    bytewise: bool = False
    why_must_leave: str = ""


MakeSettings = partial[EstimatorSettings]
"""Function from the speed V (m/s) and the largest turn rate (rad/s) to settings."""
# 0.5: error of the measured accelerations of a copter without GPS, m/s^2. In turns its estimated
# attitude is wrong by 3 deg.
AIRSPEED_FROM_DRAG = partial(
    EstimatorSettings,
    scale_sigma=SCALE_SIGMA,
    scale_bounds=SCALE_BOUNDS,
    acceleration_bias=0.5,
)
"""Settings for a copter whose accelerometer measures its airspeed."""


def ground_speed(sigma: float) -> MakeSettings:
    """Return the settings for a vehicle that holds its speed over the ground. sigma: standard
    deviation of this speed, as a share of the commanded speed."""
    return partial(EstimatorSettings, drift_sigma=0.1, scale_sigma=sigma)


class Autopilot(ABC):
    """Adapter of one steering method of a vehicle: its guided mode, its setpoint message, the
    source of its motion and the settings of an estimator of this motion. A loss of the position in
    flight replaces the adapter, and with it the method."""

    firmware: ClassVar[Firmware]
    name: ClassVar[str]
    """Human-readable name."""
    bundled: ClassVar[tuple[str, ...]]
    """Names of the profiles of the bundled emulator that emulate this vehicle."""
    vehicle_types: ClassVar[frozenset[int]]
    """MAV_TYPE values in the vehicle's HEARTBEAT."""
    guided_mode: ClassVar[int]
    """custom_mode in which the vehicle follows setpoints."""
    mode_names: ClassVar[Mapping[int, str]]
    """custom_mode -> human-readable name."""
    exits: ClassVar[Mapping[str, int]]
    """Exit action -> commanded custom_mode."""
    low_exit: ClassVar[str] = "land"
    """Exit action near the ground and without a position: it neither climbs nor needs a
    position."""
    default_exit: ClassVar[str] = "loiter"
    """Exit action if the mission does not specify an exit action. "stop" keeps the mode and only
    ends the setpoints."""
    why_no_stop: ClassVar[str] = ""
    """Human-readable reason why the exit action "stop" is not permitted, or empty."""
    shapes: ClassVar[frozenset[tuple[str, int | None]]]
    """(message type, type_mask or None) pairs that may be sent."""
    needs: ClassVar[frozenset[str]] = frozenset()
    """Names of the `Motion` fields that are required for a flight."""
    parameters: ClassVar[tuple[Rule, ...]]
    """Rules for the autopilot's parameters that affect a flight."""
    flies: ClassVar[bool] = True
    """True if the vehicle must be in the air before it is engaged."""
    min_height: ClassVar[float] = 5.0
    """Least height above the place of arming at which a flight begins, m, unless the mission gives
    another one."""
    kept_modes: ClassVar[frozenset[int]] = frozenset()
    """custom_mode values of the modes that circnav does not end: take-off, landing, return and
    avoidance. The operator or a failsafe has chosen them."""
    tilts_by_stick: ClassVar[bool] = False
    """True for a copter flown by the sticks."""
    airspeed_from_drag: ClassVar[bool] = False
    """True for a copter flown by attitude: circnav holds its airspeed, which the accelerometer
    measures. The mission must limit the tilt (vehicle.max_bank_deg)."""
    fixed_wing: ClassVar[bool] = False
    """True if the vehicle turns by banking, measures VFR_HUD.airspeed and holds the airspeed of a
    parameter. The mission must limit the bank. A copter sends its ground speed as airspeed."""
    airspeed_command: ClassVar[int | None] = None
    """MAV_CMD that changes the airspeed that the autopilot holds, or None."""
    holds_ground_speed: ClassVar[bool] = False
    """True if the vehicle holds the commanded speed over the ground. Otherwise it drifts with the
    wind."""
    estimation: ClassVar[MakeSettings] = partial(EstimatorSettings)
    """Settings of an estimator of the vehicle's motion."""
    least_turn_gain: ClassVar[float] = 1.0
    """Smallest expected ratio of realized to commanded turn rate."""
    acceleration_limit: ClassVar[tuple[str, float] | None] = None
    """Parameter that limits the acceleration across the path, and its default, m/s^2; None without
    such a limit."""
    replacement: ClassVar["type[Autopilot] | None"] = None
    """Adapter of another steering method of the same vehicle, which needs no position, or None."""
    echo: ClassVar[int | None] = None
    """Id of the message in which the autopilot reports the setpoint that it uses, or None."""

    def __init__(self, facts: VehicleFacts) -> None:
        self._facts = facts
        self._doubts_airspeed = False
        self.air: CopterAir | None = None
        """Air of a copter, None for other vehicles."""
        self.our_modes: frozenset[int] = frozenset((self.guided_mode,))
        """Modes in which the vehicle is under our control: the guided mode. During a change of the
        steering method, the guided modes of the old and of the new method."""

    @property
    def speed_share(self) -> float:
        """Factor on the speed of the mission: below 1 at the lean limit of a copter."""
        return 1.0

    @property
    def guided_name(self) -> str:
        """Human-readable name of the guided mode."""
        return self.mode_names[self.guided_mode]

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """True if setpoints must already arrive in this mode before the guided mode can be entered.

        The vehicle does not follow them yet.
        """
        return False

    def request_mode(self, mode: int) -> Command:
        """Return the command that requests a mode, with the autopilot's own numbers."""
        numbers = self.firmware.mode_numbers(mode)
        return Command(
            dialect.MAV_CMD_DO_SET_MODE, (dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, *numbers)
        )

    @abstractmethod
    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the setpoint message for a command."""

    def safe_setpoint(self, to: SetpointContext, now: float) -> Message:
        """Return the final setpoint before the stream ends: stop, or fly straight with level
        wings."""
        return self.setpoint(Steer(YawRate(0.0), 0.0), to, now)

    def airspeed(self, measured: float | None) -> float:
        """Return the indicated airspeed to use, m/s: the measured airspeed if it is plausible, else
        the commanded airspeed.

        Repeated calls with the same measurement give the same result.
        """
        commanded = self._facts.speed
        if measured is None:
            return commanded
        least, most = (
            share * commanded
            for share in (TRUSTED_AGAIN if self._doubts_airspeed else PLAUSIBLE_AIRSPEED)
        )
        self._doubts_airspeed = not least <= measured <= most
        return commanded if self._doubts_airspeed else measured

    def bank(self, steer: Steer, to: SetpointContext) -> float:
        """Return the bank of the coordinated turn, atan(w V/g) with the yaw rate w, limited to
        `max_bank`: rad, right positive."""
        airspeed = to.motion.true_airspeed(self.airspeed(to.motion.airspeed))
        most = self._facts.max_bank
        return min(max(atan(steer.yaw_rate * airspeed / GRAVITY), -most), most)


class Copter(Autopilot):
    """Adapter of a multicopter."""

    vehicle_types = COPTER_TYPES
    velocity_loop: ClassVar[VelocityLoop | None] = None
    """Gains of the autopilot's velocity loop, from which circnav computes the lag of the velocity.
    None if the copter flies along its nose."""
    air: CopterAir

    def __init__(self, facts: VehicleFacts) -> None:
        super().__init__(facts)
        self.air = CopterAir(facts.drag, facts.speed, self.velocity_loop)

    @property
    def speed_share(self) -> float:
        return self.air.lean.share


def rules_by_parameter(
    methods: Iterable[type[Autopilot]],
) -> Mapping[tuple[Name, ...], Mapping[Rule, type[Autopilot]]]:
    """Return, for each parameter, its rules of all these methods. Each rule is listed with the
    first method that has it. The names of a parameter are its key."""
    rules: dict[tuple[Name, ...], dict[Rule, type[Autopilot]]] = {}
    for method in methods:
        for rule in method.parameters:
            rules.setdefault(rule.names, {}).setdefault(rule, method)
    return rules


def turn_in(message: Message) -> float | None:
    """Return the turn command in a setpoint or in the vehicle's report of its setpoint. Return None
    for other messages.

    Right positive: yaw rate (rad/s), or bank (rad) for attitude setpoints.
    """
    kind = message.get_type()
    mask = getattr(message, "type_mask", 0)
    if kind in ("SET_ATTITUDE_TARGET", "ATTITUDE_TARGET"):
        return euler_from_quaternion(message.q)[0]
    if kind == "NAV_CONTROLLER_OUTPUT":
        return radians(message.nav_roll)
    if not mask & dialect.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE and hasattr(message, "yaw_rate"):
        return float(message.yaw_rate)
    if kind != "POSITION_TARGET_LOCAL_NED" or mask & VELOCITY_IGNORED:
        return None
    # ArduCopter reports no yaw rate, but the velocity and our feed-forward acceleration, which is
    # V*w to the right of the velocity. After a timeout of our setpoints velocity and acceleration
    # are 0, which is read as straight flight.
    speed2 = message.vx**2 + message.vy**2
    # 0.3: speed, m/s, below which the direction of a reported velocity is not used.
    return (
        float((message.vx * message.afy - message.vy * message.afx) / speed2)
        if speed2 > 0.3**2
        else 0.0
    )


def body_velocity(
    mask: int,
    to: SetpointContext,
    now: float,
    steer: Steer,
    *,
    down: float = 0.0,
    fed: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Message:
    """Return a SET_POSITION_TARGET_LOCAL_NED in BODY_NED.

    down: descent rate, m/s. fed: feed-forward acceleration in the body frame (forward, right,
    down), m/s^2. Ignored fields are 0.
    """
    where = our_boot_ms(now), to.target_system, to.target_component, dialect.MAV_FRAME_BODY_NED
    position = (0.0, 0.0, 0.0)
    velocity = (steer.speed, 0.0, down)
    return dialect.MAVLink_set_position_target_local_ned_message(
        *where, mask, *position, *velocity, *fed, 0.0, steer.yaw_rate
    )


def attitude(
    mask: int,
    to: SetpointContext,
    now: float,
    *,
    roll: float,
    pitch: float = 0.0,
    yaw: float = 0.0,
    thrust: float = 0.0,
) -> Message:
    """Return a SET_ATTITUDE_TARGET. roll, pitch, yaw: rad, NED (right, nose up, clockwise from
    north). thrust: 0 to 1. Body rates are 0."""
    q = quaternion_from_euler(roll, pitch, yaw)
    rates = (0.0, 0.0, 0.0)
    return dialect.MAVLink_set_attitude_target_message(
        our_boot_ms(now), to.target_system, to.target_component, mask, q, *rates, thrust
    )


def tilt(steer: Steer, thrust_acceleration: complex, most: float) -> tuple[float, float]:
    """Return roll and pitch, rad, of a copter that accelerates by `thrust_acceleration` and banks
    into its turn.

    thrust_acceleration: acceleration by the thrust, forward + j left, m/s^2. most: limit of the
        total tilt, rad.
    """
    forward, right = level_acceleration(steer, thrust_acceleration, most)
    pitch = pitch_from_thrust(forward)
    return roll_from_thrust(right, pitch), pitch


def level_acceleration(
    steer: Steer, thrust_acceleration: complex, most: float
) -> tuple[float, float]:
    """Return the acceleration by the thrust, forward and to the right, m/s^2, of a copter that
    accelerates by `thrust_acceleration` and turns. (0, 0) at a commanded speed of 0.

    most: largest total tilt, rad. Roll and pitch that are limited one by one add up: 25 deg each
    are 34.8 deg, at which a copter sinks.
    """
    if steer.speed == 0:
        return 0.0, 0.0
    right = steer.yaw_rate * steer.speed - thrust_acceleration.imag
    share = min(GRAVITY * tan(most) / max(hypot(thrust_acceleration.real, right), 1e-9), 1.0)
    return share * thrust_acceleration.real, share * right
