"""ArduPilot's vehicles in GUIDED. Signs, masks and timeouts are those flown on ArduPilot 4.6.3 in its simulator."""

from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import (
    COPTER_TYPES,
    PLANE_TYPES,
    Addressee,
    Autopilot,
    Firmware,
    attitude,
    body_velocity,
)
from circnav_mav.mav.autopilots.parameters import (
    PASS,
    WARN,
    Context,
    Judge,
    Rule,
    Verdict,
    at_least,
    bank_limit,
    held_airspeed,
    least_airspeed,
    most_airspeed,
    one_of,
    rule,
    timeout,
    velocity_limit,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.setpoint_guard import Steer

ARDUPILOT = Firmware(
    key="ardupilot",
    autopilot=dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
    flown="ArduPilot 4.6.3",
    streams={
        dialect.MAVLINK_MSG_ID_HEARTBEAT: 4.0,  # a takeover is seen sooner; ArduPilot allows the rate
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
        dialect.MAVLINK_MSG_ID_ATTITUDE: 20.0,  # plane and rover refuse more than about 40 Hz
        dialect.MAVLINK_MSG_ID_VFR_HUD: 5.0,
        dialect.MAVLINK_MSG_ID_RAW_IMU: 25.0,
    },
    mode_numbers=lambda mode: (mode,),
)


def _gcs_failsafe(what_follows: str) -> Judge:
    """FS_GCS_ENABLE."""
    lost = f"without a ground station's heartbeat {what_follows}; ours does not count as one, so keep yours connected"
    return one_of({0: (PASS, "no ground-station failsafe")}, (WARN, lost))


def _ekf_action(what_follows: str) -> Judge:
    """FS_EKF_ACTION."""
    none = "no action when the position estimate fails: it may go on without knowing its speed"
    leaves = f"when the position estimate fails it leaves GUIDED and {what_follows}: the flight ends as a takeover"
    return one_of({0: (WARN, none)}, (PASS, leaves))


def _gcs_system(value: float, context: Context) -> Verdict:
    if value == context.system:
        hides = "our heartbeat would hide the loss of the ground station"
        return WARN, f"the system id of the vehicle, and so ours: {hides}"
    return PASS, "the system id of the ground station; ours is the vehicle's, so its failsafe ignores our heartbeat"


_FENCE_ON = (WARN, "a fence is on: a circle that reaches it ends by the fence's own action")
_GCS_SYSTEM = Rule((("MAV_GCS_SYSID", 1.0), ("SYSID_MYGCS", 1.0)), _gcs_system)
_FENCE = rule("FENCE_ENABLE", one_of({0: (PASS, "no fence")}, _FENCE_ON), optional=True)


# --- copter -----------------------------------------------------------------------------------------------------------


def _guided_options(value: float, context: Context) -> Verdict:
    bits = int(value)
    if bits & (1 << 4 | 1 << 5):
        return WARN, "bits 4 and 5 switch the stabilising of position and velocity off: it may not hold the speed"
    yaw = "ignored" if bits & 1 << 2 else "not ignored: keep off it"
    return PASS, f"velocity is held; the pilot's yaw stick is {yaw}"


class ArduCopter(Autopilot):
    """GUIDED (4): body velocity, lateral acceleration feed-forward and yaw rate. Needs a velocity estimate (GPS, flow).

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8): the velocity is rotated by the heading once, at receipt, so the
    message must repeat. Mask 0x407: bits 0..2 ignore position (1); bits 3..5 use velocity (0; masking any one masks
    all three, so vz goes out as 0, which holds height); bits 6..8 use acceleration (0): V w to the right, without it
    the course slips 10 degrees behind the nose and turns 1..6 % too fast; bit 9 not a force (0); bit 10 ignore yaw
    (1); bit 11 use yaw rate (0). A mask outside its table stops the vehicle (`mode_guided.init(true)`).
    Without setpoints for GUID_TIMEOUT (3 s) it brakes and hovers in GUIDED.
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
    ground_speed_sigma = 0.02
    parameters = (
        rule("GUID_TIMEOUT", timeout("brakes and hovers in GUIDED")),
        rule("GUID_OPTIONS", _guided_options),
        rule("FS_GCS_ENABLE", _gcs_failsafe("it leaves GUIDED after 5 s (1: RTL)")),
        _GCS_SYSTEM,
        rule("FS_EKF_ACTION", _ekf_action("lands (1) or holds height (2), some 8 s after GPS is gone")),
        Rule((("WP_SPD", 1.0), ("WPNAV_SPEED", 0.01)), velocity_limit, unit="m/s"),
        _FENCE,
    )

    def setpoint(self, steer: Steer, to: Addressee, now: float) -> Message:
        """Forward speed, yaw rate, and the acceleration to the right that the two imply."""
        return body_velocity(self.MASK, to, now, steer, fed=(0.0, steer.speed * steer.yaw_rate, 0.0))


# --- plane ------------------------------------------------------------------------------------------------------------


class ArduPlane(Autopilot):
    """GUIDED (15): roll only; the autopilot keeps holding height and airspeed. Works without GPS.

    SET_ATTITUDE_TARGET mask 0xC6: bit 0 (roll rate ignore) CLEAR selects "roll" on Plane, bits 1 and 2 ignore pitch
    and yaw, bit 6 ignore throttle (TECS keeps it), bit 7 ignore attitude SET: cleared, it would force pitch and rudder
    as well. Body rates are never used. The roll of a coordinated turn is atan(w V/g); the airframe realises .70 .. 1.0
    of it, which the turn-rate gain makes up for. Without setpoints for 3 s (fixed in 4.6) it loiters round the point
    where GUIDED was entered, banking hard at once.
    """

    MASK = 0xC6
    firmware = ARDUPILOT
    name = "ardupilot plane"
    bundled = ("arduplane",)
    vehicle_types = PLANE_TYPES
    guided_mode = 15
    mode_names = MappingProxyType(
        {0: "MANUAL", 1: "CIRCLE", 2: "STABILIZE", 5: "FBWA", 6: "FBWB", 7: "CRUISE", 10: "AUTO", 11: "RTL"}
        | {12: "LOITER", 13: "TAKEOFF", 15: "GUIDED", 16: "INITIALISING"}
    )
    exits = MappingProxyType({"loiter": 12, "rtl": 11, "hold": 7})
    why_no_stop = "a plane left in its mode loiters 3 s later, banking hard at once"
    shapes = frozenset({("SET_ATTITUDE_TARGET", MASK)})
    needs = frozenset({"airspeed"})
    banks = measures_airspeed = cruises = slips = True
    least_turn_gain = 0.72  # it slips in its turns (flown: .70 .. .75)
    parameters = (
        Rule((("ROLL_LIMIT_DEG", 1.0), ("LIM_ROLL_CD", 0.01)), bank_limit, unit="deg"),
        Rule((("AIRSPEED_CRUISE", 1.0), ("TRIM_ARSPD_CM", 0.01)), held_airspeed, unit="m/s"),
        Rule((("AIRSPEED_MIN", 1.0), ("ARSPD_FBW_MIN", 1.0)), least_airspeed),
        Rule((("AIRSPEED_MAX", 1.0), ("ARSPD_FBW_MAX", 1.0)), most_airspeed),
        rule("GUID_TIMEOUT", timeout("loiters round the point where GUIDED was entered"), optional=True),
        rule("FS_GCS_ENABL", _gcs_failsafe("FS_LONG_ACTN decides (0: it stays in GUIDED)")),
        _GCS_SYSTEM,
        _FENCE,
    )

    def setpoint(self, steer: Steer, to: Addressee, now: float) -> Message:
        """The bank of the coordinated turn."""
        return attitude(self.MASK, to, now, roll=self.bank(steer, to))


# --- rover ------------------------------------------------------------------------------------------------------------


_clips = at_least(
    lambda mission: mission.speed,
    "the mission's {:g} m/s is within it",
    "the rover clips the mission's {:g} m/s to this: lower vehicle.speed_mps or raise it",
)


def _wp_speed(value: float, context: Context) -> Verdict:
    return (PASS, "0: CRUISE_SPEED counts") if value == 0 else _clips(value, context)


def _cruise_speed(value: float, context: Context) -> Verdict:
    limit = context.values.get("WP_SPEED", 0.0)
    return (PASS, f"WP_SPEED = {limit:g} m/s counts instead") if limit > 0 else _wp_speed(value, context)


class ArduRover(Autopilot):
    """GUIDED (15): speed and yaw rate; needs an EKF origin and a speed (GPS or wheel encoders).

    SET_POSITION_TARGET_LOCAL_NED mask 0x5C7: as the copter's, but bits 6..8 (acceleration) must be set; the frame is
    irrelevant to Rover. Without setpoints for 3 s (fixed) it stops, says so and stays in GUIDED.
    """

    MASK = 0x5C7
    firmware = ARDUPILOT
    name = "ardupilot rover"
    bundled = ("ardurover",)
    vehicle_types = frozenset((dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_TYPE_SURFACE_BOAT))
    guided_mode = 15
    mode_names = MappingProxyType(
        {0: "MANUAL", 1: "ACRO", 3: "STEERING", 4: "HOLD", 5: "LOITER", 10: "AUTO", 11: "RTL", 15: "GUIDED"}
        | {16: "INITIALISING"}
    )
    exits = MappingProxyType({"hold": 4, "loiter": 5, "rtl": 11})
    default_exit = "stop"
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    flies = False
    ground_speed_sigma = 0.02
    parameters = (
        rule("WP_SPEED", _wp_speed),
        rule("CRUISE_SPEED", _cruise_speed),
        rule("FS_GCS_ENABLE", _gcs_failsafe("it goes to HOLD after 5 to 7 s")),
        _GCS_SYSTEM,
        rule("FS_EKF_ACTION", _ekf_action("stops in HOLD, some 8 s after GPS is gone")),
        _FENCE,
    )

    def setpoint(self, steer: Steer, to: Addressee, now: float) -> Message:
        """Forward speed and yaw rate."""
        return body_velocity(self.MASK, to, now, steer)
