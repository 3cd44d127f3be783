"""ArduCopter in GUIDED: body velocity, lateral acceleration feed-forward and yaw rate."""

from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import VehicleState
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.frames import YawRate
from circnav_mav.mav.gate import Steer

MASK = 0x407
"""SET_POSITION_TARGET_LOCAL_NED: bits 0..2 ignore position (1), bits 3..5 velocity used (0: masking any one masks all
three, so vz is sent as 0, which holds height), bits 6..8 acceleration used (0: the centripetal V w feed-forward;
without it the course slips 10 degrees behind the nose and turns 1..6 % too fast), bit 9 not a force (0), bit 10 ignore
yaw (1), bit 11 yaw rate used (0). Flown on ArduCopter 4.6.3; any mask that it does not know stops the vehicle
(`mode_guided.init(true)`)."""

GUIDED = 4


class ArduCopter:
    """GUIDED (4). Frame BODY_NED: the velocity is rotated by the heading once, at receipt, so the message must repeat.

    Without setpoints for GUID_TIMEOUT (3 s) the vehicle brakes and hovers in GUIDED.
    """

    name = "ardupilot copter"
    autopilot = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    vehicle_types = frozenset(
        (
            dialect.MAV_TYPE_QUADROTOR,
            dialect.MAV_TYPE_COAXIAL,
            dialect.MAV_TYPE_HELICOPTER,
            dialect.MAV_TYPE_HEXAROTOR,
            dialect.MAV_TYPE_OCTOROTOR,
            dialect.MAV_TYPE_TRICOPTER,
            dialect.MAV_TYPE_DODECAROTOR,
        )
    )
    guided_mode = GUIDED
    mode_names = MappingProxyType(
        {0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", GUIDED: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND"}
        | {16: "POSHOLD", 17: "BRAKE", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 27: "AUTO_RTL"}
    )
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    streams = MappingProxyType(
        {
            dialect.MAVLINK_MSG_ID_HEARTBEAT: 4.0,  # a takeover is seen sooner; ArduPilot allows the rate
            dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
            dialect.MAVLINK_MSG_ID_ATTITUDE: 10.0,
            dialect.MAVLINK_MSG_ID_VFR_HUD: 4.0,
        }
    )

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """Forward speed, yaw rate, and the sideways acceleration that the two imply (right positive)."""
        return _target(steer.speed, steer.yaw_rate, steer.speed * steer.yaw_rate, state, now)

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """Brake and hover at this height."""
        return _target(0.0, YawRate(0.0), 0.0, state, now)

    def request_mode(self, mode: int) -> Command:
        """MAV_CMD_DO_SET_MODE: p1 custom mode enabled, p2 the mode number."""
        return Command(dialect.MAV_CMD_DO_SET_MODE, (dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode))


def _target(speed: float, yaw_rate: float, sideways: float, state: VehicleState, now: float) -> Message:
    position, yaw = (0.0, 0.0, 0.0), 0.0
    velocity, acceleration = (speed, 0.0, 0.0), (0.0, sideways, 0.0)
    return dialect.MAVLink_set_position_target_local_ned_message(
        int(now * 1000) & 0xFFFFFFFF,
        state.target_system,
        state.target_component,
        dialect.MAV_FRAME_BODY_NED,
        MASK,
        *position,
        *velocity,
        *acceleration,
        yaw,
        yaw_rate,
    )
