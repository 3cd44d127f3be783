"""ArduPilot: Copter, Plane and Rover in GUIDED.

Signs, masks and timeouts are those flown on ArduPilot 4.6.3 in its simulator.
"""

from math import atan
from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.autopilots.interface import Airspeed, VehicleFacts, VehicleState
from circnav_mav.mav.autopilots.targets import VELOCITY_AND_YAW_RATE, attitude, body_velocity, custom_mode_request
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.frames import GRAVITY
from circnav_mav.mav.setpoint_guard import Steer

COPTER_TYPES = frozenset(
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
STREAMS = MappingProxyType(
    {
        dialect.MAVLINK_MSG_ID_HEARTBEAT: 4.0,  # a takeover is seen sooner; ArduPilot allows the rate
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
        dialect.MAVLINK_MSG_ID_ATTITUDE: 20.0,  # plane and rover refuse more than about 40 Hz
        dialect.MAVLINK_MSG_ID_VFR_HUD: 5.0,
        dialect.MAVLINK_MSG_ID_RAW_IMU: 25.0,
    }
)


class _ArduPilot:
    """What the three vehicles share: mode requests by number, and streams that may be asked for."""

    autopilot = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    streams = STREAMS
    default_exit = "stop"
    measures_airspeed = False
    velocity_loop: VelocityLoop | None = None
    flies = True
    needs: frozenset[str] = frozenset()

    def __init__(self, facts: VehicleFacts) -> None:
        self._facts = facts
        self.airspeed = Airspeed(facts.speed).believed

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """GUIDED can be entered without."""
        return False

    def request_mode(self, mode: int) -> Command:
        """MAV_CMD_DO_SET_MODE: p1 custom mode enabled, p2 the mode number."""
        return custom_mode_request(mode)


class ArduCopter(_ArduPilot):
    """GUIDED (4): body velocity, lateral acceleration feed-forward and yaw rate. Needs a velocity estimate (GPS, flow).

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8): the velocity is rotated by the heading once, at receipt, so the
    message must repeat. Mask 0x407: bits 0..2 ignore position (1); bits 3..5 use velocity (0; masking any one masks
    all three, so vz goes out as 0, which holds height); bits 6..8 use acceleration (0): V w to the right, without it
    the course slips 10 degrees behind the nose and turns 1..6 % too fast; bit 9 not a force (0); bit 10 ignore yaw
    (1); bit 11 use yaw rate (0). A mask outside its table stops the vehicle (`mode_guided.init(true)`).
    Without setpoints for GUID_TIMEOUT (3 s) it brakes and hovers in GUIDED.
    """

    MASK = 0x407
    name = "ardupilot copter"
    vehicle_types = COPTER_TYPES
    guided_mode = 4
    mode_names = MappingProxyType(
        {0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND", 16: "POSHOLD"}
        | {17: "BRAKE", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 27: "AUTO_RTL"}
    )
    exits = MappingProxyType({"loiter": 5, "rtl": 6, "land": 9, "brake": 17, "hold": 2})
    shapes: frozenset[tuple[str, int | None]] = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """Forward speed, yaw rate, and the acceleration to the right that the two imply."""
        right = steer.speed * steer.yaw_rate
        return body_velocity(self.MASK, state, now, forward=steer.speed, yaw_rate=steer.yaw_rate, right=right)

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """Brake and hover at this height."""
        return body_velocity(self.MASK, state, now, forward=0.0, yaw_rate=0.0)


class ArduPlane(_ArduPilot):
    """GUIDED (15): roll only; the autopilot keeps holding height and airspeed. Works without GPS.

    SET_ATTITUDE_TARGET mask 0xC6: bit 0 (roll rate ignore) CLEAR selects "roll" on Plane, bits 1 and 2 ignore pitch
    and yaw, bit 6 ignore throttle (TECS keeps it), bit 7 ignore attitude SET: cleared, it would force pitch and rudder
    as well. Body rates are never used. The roll of a coordinated turn is atan(w V/g); the airframe realises .70 .. 1.0
    of it, which the turn-rate gain makes up for. Without setpoints for 3 s it loiters round the point where GUIDED was
    entered, banking hard at once.
    """

    MASK = 0xC6
    name = "ardupilot plane"
    vehicle_types = frozenset((dialect.MAV_TYPE_FIXED_WING,))
    guided_mode = 15
    mode_names = MappingProxyType(
        {0: "MANUAL", 1: "CIRCLE", 2: "STABILIZE", 5: "FBWA", 6: "FBWB", 7: "CRUISE", 10: "AUTO", 11: "RTL"}
        | {12: "LOITER", 13: "TAKEOFF", 15: "GUIDED", 16: "INITIALISING"}
    )
    exits = MappingProxyType({"loiter": 12, "rtl": 11, "hold": 7})
    shapes: frozenset[tuple[str, int | None]] = frozenset({("SET_ATTITUDE_TARGET", MASK)})
    needs = frozenset({"airspeed"})
    default_exit = "loiter"
    measures_airspeed = True

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """The bank of the coordinated turn, within the mission's bank limit."""
        airspeed = self.airspeed(state.motion.airspeed)
        roll = coordinated_bank(steer.yaw_rate, airspeed, self._facts.max_bank)
        return attitude(self.MASK, state, now, roll=roll, pitch=0.0, thrust=0.0)

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """Wings level."""
        return attitude(self.MASK, state, now, roll=0.0, pitch=0.0, thrust=0.0)


class ArduRover(_ArduPilot):
    """GUIDED (15): speed and yaw rate; needs an EKF origin and a speed (GPS or wheel encoders).

    SET_POSITION_TARGET_LOCAL_NED mask 0x5C7 (velocity and yaw rate); the frame is irrelevant to Rover and the bits 6
    and 7 (acceleration) must be set. Without setpoints for 3 s it stops, says so and stays in GUIDED.
    """

    MASK = VELOCITY_AND_YAW_RATE
    name = "ardupilot rover"
    vehicle_types = frozenset((dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_TYPE_SURFACE_BOAT))
    guided_mode = 15
    flies = False
    mode_names = MappingProxyType(
        {0: "MANUAL", 1: "ACRO", 3: "STEERING", 4: "HOLD", 5: "LOITER", 10: "AUTO", 11: "RTL", 15: "GUIDED"}
        | {16: "INITIALISING"}
    )
    exits = MappingProxyType({"hold": 4, "loiter": 5, "rtl": 11})
    shapes: frozenset[tuple[str, int | None]] = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """Forward speed and yaw rate."""
        return body_velocity(self.MASK, state, now, forward=steer.speed, yaw_rate=steer.yaw_rate)

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """Stop."""
        return body_velocity(self.MASK, state, now, forward=0.0, yaw_rate=0.0)


def coordinated_bank(yaw_rate: float, airspeed: float, max_bank: float) -> float:
    """Bank of a coordinated turn, rad, right positive: atan(w V/g), cut to +-max_bank."""
    return min(max(atan(yaw_rate * airspeed / GRAVITY), -max_bank), max_bank)
