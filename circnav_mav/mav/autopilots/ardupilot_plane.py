"""ArduPlane in GUIDED."""

from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.ardupilot import (
    ARDUPILOT,
    FENCE,
    GCS_SYSTEM,
    HEADING,
    gcs_failsafe,
    mode_names,
)
from circnav_mav.mav.autopilots.interface import PLANE_TYPES, Autopilot, SetpointContext, attitude
from circnav_mav.mav.autopilots.parameters import (
    FAIL,
    FLIES_ON,
    PASS,
    Context,
    Name,
    Rule,
    Verdict,
    bank_limit,
    held_airspeed,
    least_airspeed,
    mission_bank,
    mission_speed,
    most_airspeed,
    one_of,
    rule,
    timeout,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.setpoint_guard import Steer

_LOST = "after the loss of the transmitter"
_NO_CHANGE = (PASS, f"no other mode soon {_LOST}")
_SHORT = {
    value: (PASS, f"{mode} 1.5 s {_LOST}, which ends the flight; GUIDED when it returns")
    for value, mode in {1: "CIRCLE", 2: "FBWA", 4: "FBWB"}.items()
}
_LONG = {
    value: (PASS, f"{action} 5 s {_LOST}, which ends the flight")
    for value, action in {1: "RTL", 2: "gliding in FBWA", 3: "parachute", 4: "AUTO"}.items()
}


def _fence_action(value: float, context: Context) -> Verdict:
    """Judge FENCE_ACTION. In GUIDED, actions 6 and 7 change only the place that the plane flies to,
    and setpoints replace it."""
    if value not in (6, 7) or not (
        context.values.get("FENCE_ENABLE") or context.values.get("FENCE_AUTOENABLE")
    ):
        return PASS, "the fence works as without circnav"
    return (
        FAIL,
        "while circnav steers, the fence has no effect, because GUIDED is its action: set 1",
    )


class ArduPlane(Autopilot):
    """GUIDED (15): roll only. The autopilot holds height and airspeed. Works without GPS.

    The airspeed is AIRSPEED_CRUISE until MAV_CMD_GUIDED_CHANGE_SPEED sets another airspeed between
    AIRSPEED_MIN and AIRSPEED_MAX. A mode change restores AIRSPEED_CRUISE. DO_CHANGE_SPEED does the
    same, but causes a STATUSTEXT each time.

    SET_ATTITUDE_TARGET mask 0xC6: bit 0 (roll rate ignore) CLEAR selects "roll" on Plane. Bits 1
    and 2 ignore pitch and yaw. Bit 6 ignores throttle (TECS controls it). Bit 7 (attitude ignore)
    is SET: if it were clear, the message would command pitch and rudder as well. Body rates are
    never used. The roll of a coordinated turn is atan(w V/g). The airframe achieves 0.70 to 1.0 of
    that turn rate w, which the turn-rate gain compensates. After 3 s without setpoints the plane
    banks hard at once and loiters around the point where it entered GUIDED. This time is a constant
    in 4.6, GUIDED_TIMEOUT in later versions.
    """

    MASK = 0xC6
    firmware = ARDUPILOT
    name = "ardupilot plane"
    bundled = ("arduplane",)
    vehicle_types = PLANE_TYPES
    guided_mode = dialect.PLANE_MODE_GUIDED
    mode_names = mode_names("PLANE_MODE")
    # ArduPlane does not report a landing in AUTO, which its battery failsafe may begin
    # (DO_LAND_START).
    kept_modes = frozenset((
        dialect.PLANE_MODE_AUTO, dialect.PLANE_MODE_RTL, dialect.PLANE_MODE_TAKEOFF,
        dialect.PLANE_MODE_AVOID_ADSB, dialect.PLANE_MODE_QLAND, dialect.PLANE_MODE_QRTL,
        dialect.PLANE_MODE_LOITER_ALT_QLAND, dialect.PLANE_MODE_AUTOLAND,
    ))  # fmt: skip
    min_height = 30.0
    low_exit = "loiter"
    exits = MappingProxyType({
        "loiter": dialect.PLANE_MODE_LOITER, "rtl": dialect.PLANE_MODE_RTL,
        "hold": dialect.PLANE_MODE_CRUISE,
    })  # fmt: skip
    why_no_stop = "a plane left in GUIDED loiters after 3 s, with a sudden hard bank"
    shapes = frozenset({("SET_ATTITUDE_TARGET", MASK)})
    echo = dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT
    needs = frozenset({"airspeed"})
    fixed_wing = True
    airspeed_command = dialect.MAV_CMD_GUIDED_CHANGE_SPEED
    least_turn_gain = 0.72  # the plane slips in turns (measured in flight: 0.70 to 0.75)
    parameters = (
        Rule(
            (Name("ROLL_LIMIT_DEG", since="4.5"), Name("LIM_ROLL_CD", 0.01, until="4.4")),
            bank_limit,
            unit="deg",
            advised=mission_bank,
        ),
        Rule(
            (Name("AIRSPEED_CRUISE", since="4.5"), Name("TRIM_ARSPD_CM", 0.01, until="4.4")),
            held_airspeed,
            unit="m/s",
            advised=mission_speed,
        ),
        Rule(
            (Name("AIRSPEED_MIN", since="4.5"), Name("ARSPD_FBW_MIN", until="4.4")), least_airspeed
        ),
        Rule(
            (Name("AIRSPEED_MAX", since="4.5"), Name("ARSPD_FBW_MAX", until="4.4")), most_airspeed
        ),
        Rule(
            (Name("GUIDED_TIMEOUT", since="4.7"),),
            timeout("loiters round the point where GUIDED was entered"),
            optional=True,
        ),
        rule("FS_GCS_ENABL", gcs_failsafe("FS_LONG_ACTN applies (0: the plane stays in GUIDED)")),
        rule("FS_SHORT_ACTN", one_of(_SHORT, _NO_CHANGE), optional=True),
        rule("FS_LONG_ACTN", one_of(_LONG, FLIES_ON), optional=True),
        GCS_SYSTEM,
        *HEADING,
        FENCE,
        Rule(
            (Name("FENCE_ACTION"),),
            _fence_action,
            optional=True,
            also=("FENCE_ENABLE", "FENCE_AUTOENABLE"),
        ),
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the bank of the coordinated turn."""
        return attitude(self.MASK, to, now, roll=self.bank(steer, to))
