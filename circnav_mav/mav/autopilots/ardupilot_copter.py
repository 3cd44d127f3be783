"""ArduCopter in GUIDED, and in GUIDED_NOGPS without any position."""

from math import ceil, degrees, floor, radians, remainder, tau
from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.ardupilot import (
    ARDUPILOT,
    FENCE,
    GCS_SYSTEM,
    HEADING,
    ekf_action,
    gcs_failsafe,
    mode_names,
)
from circnav_mav.mav.autopilots.interface import (
    AIRSPEED_FROM_DRAG,
    FOLLOWED,
    Copter,
    SetpointContext,
    VehicleFacts,
    attitude,
    body_velocity,
    ground_speed,
    tilt,
)
from circnav_mav.mav.autopilots.parameters import (
    FAIL,
    FLIES_ON,
    PASS,
    WARN,
    Context,
    Name,
    Rule,
    Verdict,
    always,
    below,
    enough_lean,
    enough_speed,
    lean_limit,
    mission_bank,
    one_of,
    rule,
    timeout,
    velocity_limit,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.setpoint_guard import Steer

MODE_NAMES = mode_names("COPTER_MODE")
KEPT_MODES = frozenset((
    dialect.COPTER_MODE_RTL, dialect.COPTER_MODE_LAND, dialect.COPTER_MODE_THROW,
    dialect.COPTER_MODE_AVOID_ADSB, dialect.COPTER_MODE_SMART_RTL, dialect.COPTER_MODE_AUTO_RTL,
))  # fmt: skip
"""AUTO is not in this set, because the autopilot reports its take-off and landing in
EXTENDED_SYS_STATE."""
LEAN_LIMIT = Name("ATC_ANGLE_MAX", since="4.7"), Name("ANGLE_MAX", 0.01, until="4.6")
"""Names of the lean limit, with their factors to deg."""
THRUST_AS_THRUST = 1 << 3
"""Bit 3 of GUID_OPTIONS. If set, the thrust field of an attitude setpoint is a thrust, not a climb
rate."""


def _guided_options(value: float, context: Context) -> Verdict:
    bits = int(value)
    if bits & (1 << 4 | 1 << 5):
        return (
            WARN,
            (
                "bits 4 and 5 disable the position and velocity controllers: the copter may not"
                " hold the speed"
            ),
        )
    yaw = (
        "ignores the pilot's yaw stick"
        if bits & 1 << 2
        else "follows the pilot's yaw stick: do not move it"
    )
    return PASS, f"the copter holds the commanded velocity, and {yaw}"


def _acceleration(value: float, context: Context) -> Verdict:
    """Judge WP_ACC, m/s^2: it must suffice for turns at the mission's turn-rate limit.

    With a lower WP_ACC settling takes longer. With 2.5 m/s^2 at 5 m/s, flights settled on the
    circle after 16 to 68 s at a turn-rate limit of 45 deg/s. At 30 deg/s they settled after 14 to
    31 s.
    """
    asked = radians(context.max_turn_rate_deg) * context.speed
    words = f"turns at the mission's turn-rate limit need {asked:.1f} m/s^2"
    if asked <= FOLLOWED * value:
        return PASS, f"{words}: the copter reaches this"
    enough = floor(degrees(FOLLOWED * value / context.speed))
    return (
        WARN,
        (
            f"{words}, the copter reaches less: lower vehicle.max_turn_rate_deg_s to {enough} to"
            " settle sooner"
        ),
    )


def _enough_acceleration(context: Context) -> float:
    """Return the larger of the firmware's default of 2.5 m/s^2 and the acceleration of turns at the
    turn-rate limit."""
    asked = radians(context.max_turn_rate_deg) * context.speed
    return float(max(ArduCopter.acceleration_limit[1], ceil(10 * asked / FOLLOWED) / 10))


_DEAD_RECKONING = {
    1: "lands",
    2: "flies home (RTL)",
    3: "flies home (SMART_RTL)",
    4: "flies home (SMART_RTL) or lands",
    6: "flies the landing sequence of AUTO, or home (RTL)",
}


def _dead_reckoning(value: float, context: Context) -> Verdict:
    """Judge FS_DR_ENABLE. The autopilot navigates by dead reckoning without GPS only if its EKF
    estimates the wind, which a copter does with EK3_DRAG_BCOEF_X and EK3_DRAG_BCOEF_Y."""
    if value <= 0:
        return PASS, "no action when dead reckoning begins"
    action = _DEAD_RECKONING.get(int(value), "follows this action")
    return (
        PASS,
        f"if dead reckoning begins in GUIDED (GPS lost, EK3_DRAG_BCOEF_X set), the copter {action}:"
        " the flight ends as a takeover",
    )


YAW_LEAD = radians(20)
"""Largest lead of the yaw target over the reported yaw, rad. With a larger lead the copter would
turn faster than commanded until it has reached the target."""


def _transmitter_lost(value: float, context: Context) -> Verdict:
    """Judge FS_THR_ENABLE. With bit 2 of FS_OPTIONS, GUIDED continues without the transmitter."""
    if value <= 0 or int(context.values.get("FS_OPTIONS", 0)) & 1 << 2:
        return FLIES_ON
    home = "RTL" if value in (1, 2) else "LAND" if value == 3 else "the parameter's action"
    return PASS, f"if the transmitter is lost: {home}, LAND without a position"


TRANSMITTER = Rule((Name("FS_THR_ENABLE"),), _transmitter_lost, optional=True, also=("FS_OPTIONS",))
"""Rule for the loss of the transmitter."""

_LANDS_ALWAYS = (FAIL, "lands even in modes that need no position: set 1 or 2")


def _options_without_gps(value: float, context: Context) -> Verdict:
    if int(value) & THRUST_AS_THRUST:
        return (
            FAIL,
            "bit 3: thrust 0.5 would be half of the full thrust, not a held height: clear it",
        )
    return PASS, "the copter holds its height at thrust 0.5"


def _tilt_limit(degrees_: float, context: Context) -> Verdict:
    """Judge the lean limit, deg, which also limits the tilt commanded by attitude setpoints."""
    if below(degrees_, context.max_bank_deg):
        words = (
            f"the copter tilts {degrees_:g} deg at most, vehicle.max_bank_deg ="
            f" {context.max_bank_deg:g}"
        )
        return FAIL, f"{words}: lower vehicle.max_bank_deg, or raise the parameter"
    return PASS, f"the copter may tilt {degrees_:g} deg, the mission needs {context.max_bank_deg:g}"


class ArduCopterAttitude(Copter):
    """GUIDED_NOGPS (20): attitude, for flights without any position. The autopilot holds the
    height.

    SET_ATTITUDE_TARGET mask 7: bits 0 to 2 ignore the body rates. If only some of the three are
    set, ArduCopter rejects the message and levels. Bits 6 and 7 are clear, so that thrust and
    attitude are used. Thrust 0.5 holds the height. Another thrust is a climb rate, unless bit 3 of
    GUID_OPTIONS is set. The copter follows the yaw of the quaternion with a delay of 0.25 s. At a
    constant forward tilt it has a constant airspeed and drifts with the wind. Without setpoints for
    GUID_TIMEOUT (3 s) it levels, holds yaw and height, and drifts with the wind. LOITER, BRAKE and
    RTL require a position, so the copter refuses them. The mode GUIDED follows the same messages.
    """

    MASK = 0x07
    firmware = ARDUPILOT
    name = "ardupilot copter without GPS"
    bundled = ("arducopter_nogps", "arducopter")
    guided_mode = dialect.COPTER_MODE_GUIDED_NOGPS
    mode_names = MODE_NAMES
    exits = MappingProxyType(
        {"hold": dialect.COPTER_MODE_ALT_HOLD, "land": dialect.COPTER_MODE_LAND}
    )
    default_exit = "land"
    kept_modes = KEPT_MODES
    shapes = frozenset({("SET_ATTITUDE_TARGET", MASK)})
    echo = dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET
    airspeed_from_drag = True
    estimation = AIRSPEED_FROM_DRAG
    parameters = (
        rule("GUID_TIMEOUT", timeout("levels and drifts with the wind"), advised=always(3.0)),
        rule("GUID_OPTIONS", _options_without_gps, advised=always(0.0)),
        rule(
            "FS_GCS_ENABLE",
            gcs_failsafe("the copter leaves GUIDED_NOGPS after 5 s (without a position it lands)"),
        ),
        GCS_SYSTEM,
        TRANSMITTER,
        rule(
            "FS_EKF_ACTION",
            one_of({3: _LANDS_ALWAYS}, (PASS, "no action in GUIDED_NOGPS")),
            advised=always(1.0),
        ),
        rule(
            "FS_DR_ENABLE",
            lambda value, context: (PASS, "no action in GUIDED_NOGPS"),
            optional=True,
        ),
        Rule(LEAN_LIMIT, _tilt_limit, optional=True, unit="deg", advised=mission_bank),
        *HEADING,
        FENCE,
    )

    def __init__(self, facts: VehicleFacts) -> None:
        super().__init__(facts)
        self._yaw: float | None = None
        """Yaw target, rad, NED, None before the first setpoint."""
        self._sent_at = float("-inf")

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the attitude that turns in coordination and holds the airspeed. The yaw target
        moves at the commanded yaw rate."""
        roll, pitch = tilt(steer, self.air.thrust_acceleration(steer.speed), self._facts.max_bank)
        return attitude(
            self.MASK, to, now, roll=roll, pitch=pitch, yaw=self._turned(steer, to, now), thrust=0.5
        )

    def _turned(self, steer: Steer, to: SetpointContext, now: float) -> float:
        """Advance the yaw target to now, and return it, rad."""
        reported = to.motion.yaw
        step = now - self._sent_at
        self._sent_at = now
        # 0.5: gap between two setpoints, s, after which the yaw target restarts at the reported
        # yaw.
        if self._yaw is None or step > 0.5:
            self._yaw = self._yaw if reported is None else reported
            self._yaw = self._yaw or 0.0
            return self._yaw
        self._yaw += steer.yaw_rate * max(step, 0.0)
        if reported is not None:
            lead = min(max(remainder(self._yaw - reported, tau), -YAW_LEAD), YAW_LEAD)
            self._yaw = reported + lead
        return self._yaw


class ArduCopter(Copter):
    """GUIDED (4): body velocity, lateral acceleration feed-forward and yaw rate. Needs a velocity
    estimate (GPS, flow).

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8): the velocity is rotated by the heading once,
    at receipt, so the message must be repeated. Mask 0x407: bits 0 to 2 ignore position (1). Bits 3
    to 5 use velocity (0). Any of these bits masks all three velocities, so vz is sent as 0, which
    holds the height. Bits 6 to 8 use acceleration (0): speed times yaw rate, to the right. Without
    the acceleration, the course lags the nose by 10 degrees and the copter turns 1 to 6 % too fast.
    Bit 9 (0): the acceleration is not a force. Bit 10 ignores yaw (1). Bit 11 uses yaw rate (0). A
    mask that ArduCopter does not list stops the vehicle (`mode_guided.init(true)`). Without
    setpoints for GUID_TIMEOUT (3 s) it brakes and hovers in GUIDED.
    """

    MASK = 0x407
    firmware = ARDUPILOT
    name = "ardupilot copter"
    bundled = ("arducopter",)
    guided_mode = dialect.COPTER_MODE_GUIDED
    mode_names = MODE_NAMES
    exits = MappingProxyType({
        "loiter": dialect.COPTER_MODE_LOITER, "rtl": dialect.COPTER_MODE_RTL,
        "land": dialect.COPTER_MODE_LAND, "brake": dialect.COPTER_MODE_BRAKE,
        "hold": dialect.COPTER_MODE_ALT_HOLD,
    })  # fmt: skip
    default_exit = "stop"
    kept_modes = KEPT_MODES
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    echo = dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
    holds_ground_speed = True
    estimation = ground_speed(0.02)
    replacement = ArduCopterAttitude
    acceleration_limit = "WP_ACC (before 4.7: WPNAV_ACCEL)", 2.5
    parameters = (
        rule("GUID_TIMEOUT", timeout("brakes and hovers in GUIDED"), advised=always(3.0)),
        rule("GUID_OPTIONS", _guided_options),
        rule("FS_GCS_ENABLE", gcs_failsafe("the copter leaves GUIDED after 5 s (1: RTL)")),
        GCS_SYSTEM,
        TRANSMITTER,
        rule(
            "FS_EKF_ACTION",
            ekf_action("lands (1, 3) or holds height (2), some 8 s after GPS is gone"),
        ),
        rule("FS_DR_ENABLE", _dead_reckoning, optional=True),
        Rule(
            (Name("WP_SPD", since="4.7"), Name("WPNAV_SPEED", 0.01, until="4.6")),
            velocity_limit,
            unit="m/s",
            advised=enough_speed(10.0),
        ),
        Rule(LEAN_LIMIT, lean_limit, optional=True, unit="deg", advised=enough_lean(30.0)),
        Rule(
            (Name("WP_ACC", since="4.7"), Name("WPNAV_ACCEL", 0.01, until="4.6")),
            _acceleration,
            optional=True,
            unit="m/s^2",
            advised=_enough_acceleration,
        ),
        *HEADING,
        FENCE,
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the setpoint of forward speed, yaw rate and the resulting acceleration to the
        right."""
        return body_velocity(
            self.MASK, to, now, steer, fed=(0.0, steer.speed * steer.yaw_rate, 0.0)
        )
