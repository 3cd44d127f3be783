"""ArduCopter in GUIDED."""

from math import ceil, degrees, floor, radians
from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.ardupilot import ARDUPILOT, FENCE, GCS_SYSTEM, ekf_action, gcs_failsafe
from circnav_mav.mav.autopilots.interface import COPTER_TYPES, FOLLOWED, Autopilot, SetpointContext, body_velocity
from circnav_mav.mav.autopilots.parameters import (
    PASS,
    WARN,
    Context,
    Rule,
    Verdict,
    always,
    enough_lean,
    enough_speed,
    lean_limit,
    rule,
    timeout,
    velocity_limit,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.setpoint_guard import Steer


def _guided_options(value: float, context: Context) -> Verdict:
    bits = int(value)
    if bits & (1 << 4 | 1 << 5):
        return WARN, "bits 4 and 5 disable the position and velocity controllers: the copter may not hold the speed"
    yaw = "ignores the pilot's yaw stick" if bits & 1 << 2 else "follows the pilot's yaw stick: do not move it"
    return PASS, f"the copter holds the commanded velocity, and {yaw}"


def _acceleration(value: float, context: Context) -> Verdict:
    """Judge WPNAV_ACCEL, here in m/s^2: it must suffice for turns at the mission's turn-rate limit.

    At 5 m/s with 2.5 m/s^2, flights with a limit of 45 deg/s settled on the circle after 16 to 68 s, flights with a
    limit of 30 deg/s after 14 to 31 s.
    """
    asked = radians(context.max_turn_rate_deg) * context.speed
    words = f"turns at the mission's turn-rate limit need {asked:.1f} m/s^2"
    if asked <= FOLLOWED * value:
        return PASS, f"{words}: the copter reaches this"
    enough = floor(degrees(FOLLOWED * value / context.speed))
    return WARN, f"{words}, the copter reaches less: lower vehicle.max_turn_rate_deg_s to {enough} to settle sooner"


def _enough_acceleration(context: Context) -> float:
    """Return the larger of the firmware's default of 2.5 m/s^2 and the acceleration of turns at the turn-rate limit."""
    asked = radians(context.max_turn_rate_deg) * context.speed
    return float(max(ArduCopter.acceleration_limit[1], ceil(10 * asked / FOLLOWED) / 10))


class ArduCopter(Autopilot):
    """GUIDED (4): body velocity, lateral acceleration feed-forward and yaw rate. Needs a velocity estimate (GPS, flow).

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8): the velocity is rotated by the heading once, at receipt, so the
    message must be repeated. Mask 0x407: bits 0 to 2 ignore position (1). Bits 3 to 5 use velocity (0): masking any one
    masks all three, so vz is sent as 0, which holds height. Bits 6 to 8 use acceleration (0): speed times yaw rate, to
    the right. Without it the course is 10 degrees behind the nose, and the copter turns 1 to 6 % too fast. Bit 9: not
    a force (0). Bit 10 ignores yaw (1). Bit 11 uses yaw rate (0). A mask that ArduCopter does not list stops the
    vehicle (`mode_guided.init(true)`). Without setpoints for GUID_TIMEOUT (3 s) it brakes and hovers in GUIDED.
    """

    MASK = 0x407
    firmware = ARDUPILOT
    name = "ardupilot copter"
    bundled = ("arducopter", "arducopter_nogps")
    vehicle_types = COPTER_TYPES
    guided_mode = 4
    mode_names = MappingProxyType(
        {0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND", 16: "POSHOLD"}
        | {17: "BRAKE", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 27: "AUTO_RTL"}
    )
    exits = MappingProxyType({"loiter": 5, "rtl": 6, "land": 9, "brake": 17, "hold": 2})
    default_exit = "stop"
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    echo = dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
    ground_speed_sigma = 0.02
    acceleration_limit = "WPNAV_ACCEL", 2.5
    parameters = (
        rule("GUID_TIMEOUT", timeout("brakes and hovers in GUIDED"), advised=always(3.0)),
        rule("GUID_OPTIONS", _guided_options),
        rule("FS_GCS_ENABLE", gcs_failsafe("the copter leaves GUIDED after 5 s (1: RTL)")),
        GCS_SYSTEM,
        rule("FS_EKF_ACTION", ekf_action("lands (1) or holds height (2), some 8 s after GPS is gone")),
        Rule((("WP_SPD", 1.0), ("WPNAV_SPEED", 0.01)), velocity_limit, unit="m/s", advised=enough_speed(10.0)),
        Rule((("ANGLE_MAX", 0.01),), lean_limit, optional=True, unit="deg", advised=enough_lean(30.0)),
        Rule((("WPNAV_ACCEL", 0.01),), _acceleration, optional=True, unit="m/s^2", advised=_enough_acceleration),
        FENCE,
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the setpoint of forward speed, yaw rate and the resulting acceleration to the right."""
        return body_velocity(self.MASK, to, now, steer, fed=(0.0, steer.speed * steer.yaw_rate, 0.0))
