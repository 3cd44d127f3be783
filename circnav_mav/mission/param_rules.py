"""The autopilots' parameters that matter to a flight, by their names in each version, and what their values imply."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees

from circnav_mav.mav.autopilots.ardupilot import ArduCopter, ArduPlane, ArduRover
from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.autopilots.px4 import PX4Copter, PX4PlaneAttitude, PX4PlaneStick
from circnav_mav.mission.check_result import Check, Grade
from circnav_mav.mission.mission import Mission

PASS, WARN, FAIL = Grade.PASS, Grade.WARN, Grade.FAIL
SHORT_TIMEOUT, LONG_TIMEOUT = 0.5, 5.0
"""Seconds of silence before the vehicle's own answer: shorter trips over a hiccup, longer flies on blind."""
SPEED_NEAR, SPEED_FAR = 0.05, 0.2
"""Fractions by which the speed that the autopilot holds may differ from the mission's: PASS, then WARN, then FAIL."""
STICK_SCALE = 0.5
"""Degrees by which the bank at full stick may differ from the mission's."""

ROUNDING = 1e-6
"""Fraction by which the vehicle's 2.3, told in 32 bits, and the mission's may differ."""


@dataclass(frozen=True, slots=True)
class Context:
    """What a rule may know besides its value: the mission, the vehicle's system id, and every parameter read."""

    mission: Mission
    system: int
    values: Mapping[str, float]


Verdict = tuple[Grade, str]
Judge = Callable[[float, Context], Verdict]


@dataclass(frozen=True, slots=True)
class Rule:
    """names: of one parameter in different versions, newest first, each with the factor to the unit that `judge` takes.
    optional: not every vehicle has it, say nothing when it is missing. unit: that `judge` takes."""

    names: tuple[tuple[str, float], ...]
    judge: Judge
    optional: bool = False
    unit: str = ""

    def told(self, value: float, factor: float) -> str:
        """The value as the vehicle told it, and what it means where that is another number."""
        return f"{value:g}" if factor == 1 else f"{value:g} ({value * factor:g} {self.unit})"


def names_for(adapter: Autopilot) -> tuple[str, ...]:
    """Every name to ask a vehicle for."""
    return tuple(name for rule in RULES[type(adapter)] for name, _ in rule.names)


def judge_parameters(adapter: Autopilot, context: Context) -> list[Check]:
    """A line for each parameter that matters to this vehicle, also for one that it does not know."""
    lines = []
    for rule in RULES[type(adapter)]:
        known = [(name, factor) for name, factor in rule.names if name in context.values]
        if known:
            name, factor = known[0]
            grade, words = rule.judge(context.values[name] * factor, context)
            told = rule.told(context.values[name], factor)
            lines.append(Check(grade, "parameter", f"{name} = {told}: {words}"))
        elif not rule.optional:
            either = " or ".join(name for name, _ in rule.names)
            lines.append(Check(WARN, "parameter", f"{either}: no answer, this version may not have it"))
    return lines


def _one(name: str, judge: Judge, *, optional: bool = False) -> Rule:
    return Rule(((name, 1.0),), judge, optional)


def _timeout(what_follows: str) -> Judge:
    def judge(seconds: float, context: Context) -> Verdict:
        words = f"{seconds:g} s after the last setpoint it {what_follows}"
        if seconds < 2 / context.mission.file.limits.tick_hz:
            return FAIL, f"{words}: shorter than two of our ticks"
        if seconds < SHORT_TIMEOUT:
            return WARN, f"{words}: a short hiccup of the link is enough"
        if seconds > LONG_TIMEOUT:
            return WARN, f"{words}: it flies on blind for long"
        return PASS, words

    return judge


def _gcs_failsafe(what_follows: str) -> Judge:
    def judge(value: float, context: Context) -> Verdict:
        if value == 0:
            return PASS, "no ground-station failsafe"
        return WARN, (
            f"without a ground station's heartbeat {what_follows}; ours does not count as one, so keep yours connected"
        )

    return judge


def _gcs_system(value: float, context: Context) -> Verdict:
    if value == context.system:
        return (
            WARN,
            "the system id of the vehicle, and so ours: our heartbeat would hide the loss of the ground station",
        )
    return PASS, "the system id of the ground station; ours is the vehicle's, so its failsafe ignores our heartbeat"


def _guided_options(value: float, context: Context) -> Verdict:
    bits = int(value)
    if bits & (1 << 4 | 1 << 5):
        return WARN, "bits 4 and 5 switch the stabilising of position and velocity off: it may not hold the speed"
    yaw = "ignored" if bits & 1 << 2 else "still heard: keep off it"
    return PASS, f"velocity is held; the pilot's yaw stick is {yaw}"


def _ekf_action(what_follows: str) -> Judge:
    def judge(value: float, context: Context) -> Verdict:
        if value == 0:
            return WARN, "no action when the position estimate fails: it may go on without knowing its speed"
        return (
            PASS,
            f"when the position estimate fails it leaves GUIDED and {what_follows}: the flight ends as a takeover",
        )

    return judge


def _below(value: float, other: float) -> bool:
    """Whether a value is below another by more than what 32 bits and a change of units leave of equal ones."""
    return value < other - ROUNDING * abs(other)


def _velocity_limit(value: float, context: Context) -> Verdict:
    speed = context.mission.orbit.speed
    if _below(value, speed):
        return WARN, f"slower than the mission's {speed:g} m/s: the autopilot may not fly it"
    return PASS, f"the mission's {speed:g} m/s is within it"


def _rover_speed(value: float, context: Context) -> Verdict:
    speed = context.mission.orbit.speed
    if value == 0:
        return PASS, "0: CRUISE_SPEED counts"
    if _below(value, speed):
        return FAIL, f"the rover clips the mission's {speed:g} m/s to this: lower vehicle.speed_mps or raise it"
    return PASS, f"the mission's {speed:g} m/s is within it"


def _rover_cruise(value: float, context: Context) -> Verdict:
    limit = context.values.get("WP_SPEED", 0.0)
    if limit > 0:
        return PASS, f"WP_SPEED = {limit:g} m/s counts instead"
    return _rover_speed(value, context)


def _bank_limit(value: float, context: Context) -> Verdict:
    bank = context.mission.file.vehicle.max_bank_deg or 0.0
    if _below(value, bank):
        return FAIL, (
            f"the autopilot banks less than the {bank:g} deg that the mission counts on: lower vehicle.max_bank_deg"
        )
    return PASS, f"the mission's bank limit of {bank:g} deg is within it"


def _stick_bank(value: float, context: Context) -> Verdict:
    told = context.mission.file.vehicle.full_stick_bank_deg
    if abs(value - told) > STICK_SCALE:
        return FAIL, f"full stick is {value:g} deg of bank, the mission says {told:g}: set vehicle.full_stick_bank_deg"
    return _bank_limit(value, context)


def _held_airspeed(value: float, context: Context) -> Verdict:
    speed = context.mission.orbit.speed
    off = abs(value / speed - 1)
    grade = PASS if off <= SPEED_NEAR else WARN if off <= SPEED_FAR else FAIL
    words = f"the autopilot holds {value:g} m/s, the mission counts on {speed:g}"
    return grade, words if grade is PASS else f"{words}: set vehicle.speed_mps to what is flown"


def _least_airspeed(value: float, context: Context) -> Verdict:
    speed = context.mission.orbit.speed
    return (
        (FAIL, f"above the mission's {speed:g} m/s")
        if _below(speed, value)
        else (PASS, f"below the mission's {speed:g} m/s")
    )


def _most_airspeed(value: float, context: Context) -> Verdict:
    speed = context.mission.orbit.speed
    return (
        (FAIL, f"below the mission's {speed:g} m/s")
        if _below(value, speed)
        else (PASS, f"above the mission's {speed:g} m/s")
    )


def _yaw_rate_limit(value: float, context: Context) -> Verdict:
    most = degrees(context.mission.orbit.max_turn_rate)
    if _below(value, most):
        return FAIL, f"the vehicle turns slower than the mission's limit of {most:g} deg/s: lower it"
    return PASS, f"the mission's limit of {most:g} deg/s is within it"


def _forwards_setpoints(value: float, context: Context) -> Verdict:
    if value == 0:
        return FAIL, "setpoints from MAVLink are not passed to the controllers: set it to 1"
    return PASS, "setpoints from MAVLink reach the controllers"


_OFFBOARD_LOSS = {0: "POSCTL", 1: "ALTCTL", 2: "STABILIZED", 3: "RTL", 4: "LAND", 5: "LOITER"}


def _offboard_loss(value: float, context: Context) -> Verdict:
    mode = _OFFBOARD_LOSS.get(int(value))
    if mode is None:
        return FAIL, "when setpoints stop it is disarmed or terminated in the air"
    if int(value) < 3:
        return PASS, f"when setpoints stop: {mode} for the pilot, RTL without a transmitter"
    return PASS, f"when setpoints stop: {mode}"


def _offboard_input(value: float, context: Context) -> Verdict:
    if value == 1:
        return WARN, "the pilot's transmitter is not listened to: the operator takes over from a ground station only"
    return PASS, "0: transmitter, 2 and up: transmitter and ground station, 4: no sticks at all"


def _offboard_sticks(value: float, context: Context) -> Verdict:
    if int(value) & 2:
        return PASS, "in OFFBOARD the pilot takes over by moving the sticks, or by a mode"
    return PASS, "in OFFBOARD the pilot's sticks do nothing; a change of mode takes the vehicle"


def _stick_source(value: float, context: Context) -> Verdict:
    if value in (0, 4):
        return FAIL, "sticks from MAVLink are not listened to: set it to 1 (MAVLink only)"
    if value == 1:
        return PASS, "only sticks from MAVLink are listened to: the pilot's own do nothing, changing the mode does"
    return WARN, "the pilot's transmitter may be listened to instead of us: 1 (MAVLink only) is sure"


def _stick_loss(value: float, context: Context) -> Verdict:
    words = f"{value:g} s after our last stick manual control counts as lost (NAV_RCL_ACT)"
    if value < 2 / context.mission.file.limits.tick_hz:
        return FAIL, f"{words}: shorter than two of our ticks"
    return (WARN if value < SHORT_TIMEOUT else PASS), words


_STICK_LOSS = {1: "stays in Hold", 2: "flies home (RTL)", 3: "lands where it is"}
_STOPS_MOTORS = {5: "terminates the flight", 6: "disarms"}
_STOCK_STICK_LOSS = 2.0
_HOLD_EXCEPTED = 2
"""COM_RCL_EXCEPT, bit 1."""


def _stick_loss_action(value: float, context: Context) -> Verdict:
    """What PX4 does in whatever mode it is when our stick ends, for it has then heard manual control."""
    when = "when our sticks end (takeover, end of the mission, our exit), in any mode but those of COM_RCL_EXCEPT"
    if stops := _STOPS_MOTORS.get(int(value)):
        return FAIL, f"{when}, it {stops} in the air: set it to 2 (RTL) or 1 (Hold)"
    if follows := _STICK_LOSS.get(int(value)):
        return PASS, f"{when}, it holds for COM_FAIL_ACT_T, then {follows}"
    return WARN, f"{when}, nobody knows what it does: set it to 2 (RTL) or 1 (Hold)"


def _stick_loss_exceptions(value: float, context: Context) -> Verdict:
    if int(value) & _HOLD_EXCEPTED:
        return PASS, "a plane given back or taken over in Hold (LOITER) stays there without our sticks"
    follows = _STICK_LOSS.get(int(context.values.get("NAV_RCL_ACT", _STOCK_STICK_LOSS)), "does what NAV_RCL_ACT says")
    if follows == _STICK_LOSS[1]:
        return PASS, "Hold is not excepted, but Hold is also what NAV_RCL_ACT asks for"
    return WARN, (
        f"a plane given back or taken over in Hold (LOITER) does not stay there, it {follows}: add 2 (bit 1, Hold)"
    )


def _manual_loss(value: float, context: Context) -> Verdict:
    return PASS, f"a transmitter silent for {value:g} s counts as lost"


def _fence(value: float, context: Context) -> Verdict:
    if value == 0:
        return PASS, "no fence"
    return WARN, "a fence is on: a circle that reaches it ends by the fence's own action"


_GCS_SYSTEM = Rule((("MAV_GCS_SYSID", 1.0), ("SYSID_MYGCS", 1.0)), _gcs_system)
_FENCE = _one("FENCE_ENABLE", _fence, optional=True)
_OFFBOARD = (
    _one("MAV_FWDEXTSP", _forwards_setpoints),
    _one("COM_OF_LOSS_T", _timeout("falls into its failsafe (and returns by itself when setpoints do)")),
    _one("COM_OBL_RC_ACT", _offboard_loss),
    _one("COM_RC_IN_MODE", _offboard_input),
    _one("COM_RC_OVERRIDE", _offboard_sticks),
    _one("COM_RC_LOSS_T", _manual_loss),
)

RULES: Mapping[type, tuple[Rule, ...]] = {
    ArduCopter: (
        _one("GUID_TIMEOUT", _timeout("brakes and hovers in GUIDED")),
        _one("GUID_OPTIONS", _guided_options),
        _one("FS_GCS_ENABLE", _gcs_failsafe("it leaves GUIDED after 5 s (1: RTL)")),
        _GCS_SYSTEM,
        _one("FS_EKF_ACTION", _ekf_action("lands (1) or holds height (2), some 8 s after GPS is gone")),
        Rule((("WP_SPD", 1.0), ("WPNAV_SPEED", 0.01)), _velocity_limit, unit="m/s"),
        _FENCE,
    ),
    ArduPlane: (
        Rule((("ROLL_LIMIT_DEG", 1.0), ("LIM_ROLL_CD", 0.01)), _bank_limit, unit="deg"),
        Rule((("AIRSPEED_CRUISE", 1.0), ("TRIM_ARSPD_CM", 0.01)), _held_airspeed, unit="m/s"),
        Rule((("AIRSPEED_MIN", 1.0), ("ARSPD_FBW_MIN", 1.0)), _least_airspeed),
        Rule((("AIRSPEED_MAX", 1.0), ("ARSPD_FBW_MAX", 1.0)), _most_airspeed),
        _one("GUID_TIMEOUT", _timeout("loiters round the point where GUIDED was entered"), optional=True),
        _one("FS_GCS_ENABL", _gcs_failsafe("FS_LONG_ACTN decides (0: it stays in GUIDED)")),
        _GCS_SYSTEM,
        _FENCE,
    ),
    ArduRover: (
        _one("WP_SPEED", _rover_speed),
        _one("CRUISE_SPEED", _rover_cruise),
        _one("FS_GCS_ENABLE", _gcs_failsafe("it goes to HOLD after 5 to 7 s")),
        _GCS_SYSTEM,
        _one("FS_EKF_ACTION", _ekf_action("stops in HOLD, some 8 s after GPS is gone")),
        _FENCE,
    ),
    PX4Copter: (
        *_OFFBOARD,
        _one("MC_YAWRATE_MAX", _yaw_rate_limit),
        _one("MPC_XY_VEL_MAX", _velocity_limit, optional=True),
    ),
    PX4PlaneStick: (
        _one("COM_RC_IN_MODE", _stick_source),
        _one("COM_RC_LOSS_T", _stick_loss),
        _one("NAV_RCL_ACT", _stick_loss_action),
        _one("COM_RCL_EXCEPT", _stick_loss_exceptions),
        _one("FW_R_LIM", _stick_bank),
        _one("FW_AIRSPD_TRIM", _held_airspeed),
        _one("FW_AIRSPD_MIN", _least_airspeed),
        _one("FW_AIRSPD_MAX", _most_airspeed),
    ),
    PX4PlaneAttitude: (
        *_OFFBOARD,
        _one("FW_AIRSPD_MIN", _least_airspeed),
        _one("FW_AIRSPD_MAX", _most_airspeed),
    ),
}
"""By the class of the adapter. ArduPlane 4.6 and Rover time out after a fixed 3 s."""
