"""ArduPilot Rover in GUIDED."""

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
    Autopilot,
    SetpointContext,
    body_velocity,
    ground_speed,
)
from circnav_mav.mav.autopilots.parameters import (
    FLIES_ON,
    PASS,
    Context,
    Name,
    Rule,
    Verdict,
    at_least,
    mission_speed,
    rule,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.setpoint_guard import Steer

_clips = at_least(
    lambda mission: mission.speed,
    "enough for the mission's {:g} m/s",
    "below the mission's {:g} m/s, and the rover drives no faster: raise it, or lower"
    " vehicle.speed_mps",
)


def _wp_speed(value: float, context: Context) -> Verdict:
    return (PASS, "0: CRUISE_SPEED is the limit") if value == 0 else _clips(value, context)


def _cruise_speed(value: float, context: Context) -> Verdict:
    limit = context.values.get("WP_SPEED", 0.0)
    return (
        (PASS, f"WP_SPEED = {limit:g} m/s is the limit") if limit > 0 else _wp_speed(value, context)
    )


def _transmitter_lost(value: float, context: Context) -> Verdict:
    action = context.values.get("FS_ACTION", 2)
    if value == 0 or action == 0:
        return FLIES_ON
    return PASS, f"if the transmitter is lost: FS_ACTION = {action:g} (1: RTL, 2: HOLD)"


class ArduRover(Autopilot):
    """GUIDED (15): speed and yaw rate. Needs an EKF origin and a speed (GPS or wheel encoders).

    SET_POSITION_TARGET_LOCAL_NED mask 0x5C7: the copter's mask with bits 6 to 8 (ignore
    acceleration) set, which Rover requires. Rover ignores the frame. After 3 s without setpoints (a
    constant, not a parameter) the rover stops, sends a STATUSTEXT and stays in GUIDED.
    """

    MASK = 0x5C7
    firmware = ARDUPILOT
    name = "ardupilot rover"
    bundled = ("ardurover",)
    vehicle_types = frozenset((dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_TYPE_SURFACE_BOAT))
    guided_mode = dialect.ROVER_MODE_GUIDED
    mode_names = mode_names("ROVER_MODE")
    exits = MappingProxyType({
        "hold": dialect.ROVER_MODE_HOLD, "loiter": dialect.ROVER_MODE_LOITER,
        "rtl": dialect.ROVER_MODE_RTL,
    })  # fmt: skip
    kept_modes = frozenset((dialect.ROVER_MODE_RTL, dialect.ROVER_MODE_SMART_RTL))
    default_exit = "stop"
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    flies = False
    holds_ground_speed = True
    estimation = ground_speed(0.02)
    parameters = (
        rule("WP_SPEED", _wp_speed, advised=mission_speed),
        rule("CRUISE_SPEED", _cruise_speed, advised=mission_speed),
        Rule((Name("FS_THR_ENABLE"),), _transmitter_lost, optional=True, also=("FS_ACTION",)),
        rule("FS_GCS_ENABLE", gcs_failsafe("the rover enters HOLD after 5 to 7 s")),
        GCS_SYSTEM,
        rule("FS_EKF_ACTION", ekf_action("stops in HOLD, some 8 s after GPS is gone")),
        *HEADING,
        FENCE,
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the setpoint of forward speed and yaw rate."""
        return body_velocity(self.MASK, to, now, steer)
