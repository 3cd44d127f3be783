"""PX4: multicopter in OFFBOARD, fixed wing in ALTCTL by stick or in OFFBOARD by attitude.

Signs, masks and timeouts are those flown on PX4 main (2026-03) in its simulator. PX4 acknowledges a mode change before
it decides, and returns to OFFBOARD by itself when setpoints resume: the mode is believed from HEARTBEAT and
CURRENT_MODE only, and giving control back always commands another mode.
"""

from collections.abc import Mapping
from math import cos
from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.autopilots.ardupilot import COPTER_TYPES, coordinated_bank
from circnav_mav.mav.autopilots.interface import Airspeed, VehicleFacts, VehicleState
from circnav_mav.mav.autopilots.targets import VELOCITY_AND_YAW_RATE, attitude, body_velocity, custom_mode_request
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.setpoint_guard import Steer


def custom_mode(main: int, sub: int = 0) -> int:
    """HEARTBEAT.custom_mode of a PX4 main and sub mode."""
    return main << 16 | sub << 24


ALTCTL, POSCTL, AUTO, OFFBOARD, ALT_CRUISE = 2, 3, 4, 6, 11
MODE_NAMES = MappingProxyType(
    {
        custom_mode(1): "MANUAL",
        custom_mode(ALTCTL): "ALTCTL",
        custom_mode(POSCTL): "POSCTL",
        custom_mode(AUTO, 2): "AUTO.TAKEOFF",
        custom_mode(AUTO, 3): "AUTO.LOITER",
        custom_mode(AUTO, 4): "AUTO.MISSION",
        custom_mode(AUTO, 5): "AUTO.RTL",
        custom_mode(AUTO, 6): "AUTO.LAND",
        custom_mode(OFFBOARD): "OFFBOARD",
        custom_mode(7): "STABILIZED",
        custom_mode(ALT_CRUISE): "ALT_CRUISE",
    }
)
EXITS = MappingProxyType(
    {
        "loiter": custom_mode(AUTO, 3),
        "rtl": custom_mode(AUTO, 5),
        "land": custom_mode(AUTO, 6),
        "hold": custom_mode(ALTCTL),
    }
)
STREAMS = MappingProxyType(
    {
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
        dialect.MAVLINK_MSG_ID_ATTITUDE: 20.0,
        dialect.MAVLINK_MSG_ID_VFR_HUD: 10.0,
        dialect.MAVLINK_MSG_ID_HIGHRES_IMU: 25.0,
        dialect.MAVLINK_MSG_ID_CURRENT_MODE: 2.0,  # HEARTBEAT stays at 1 Hz whatever is asked
    }
)


class _PX4:
    """What the vehicles share: modes as main and sub number."""

    autopilot = dialect.MAV_AUTOPILOT_PX4
    mode_names = MODE_NAMES
    exits: Mapping[str, int] = EXITS
    streams = STREAMS
    default_exit = "loiter"
    flies = True
    measures_airspeed = True
    velocity_loop: VelocityLoop | None = None

    def __init__(self, facts: VehicleFacts) -> None:
        self._facts = facts
        self.airspeed = Airspeed(facts.speed).believed

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """OFFBOARD is refused without; every other mode ignores them."""
        return True

    def request_mode(self, mode: int) -> Command:
        """MAV_CMD_DO_SET_MODE: p1 custom mode enabled, p2 main mode, p3 sub mode."""
        return custom_mode_request(mode >> 16 & 0xFF, mode >> 24 & 0xFF)


class PX4Copter(_PX4):
    """OFFBOARD (6): body velocity and yaw rate, height held by us through the climb rate.

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8; 7, 9, 12 and 20 are dropped), mask 0x5C7: all three velocities
    must be used, masking one of them makes the setpoint invalid. vz = 0 does not hold height (it wandered 15 m), so
    vz = gain (altitude - wanted), down positive. Turn rate true to 1 %, the ground speed droops and the course lags the
    nose by 10 .. 40 degrees. Without setpoints for COM_OF_LOSS_T (1 s): failsafe, RTL without RC.
    """

    MASK = VELOCITY_AND_YAW_RATE
    name = "px4 copter"
    vehicle_types = COPTER_TYPES
    guided_mode = custom_mode(OFFBOARD)
    shapes: frozenset[tuple[str, int | None]] = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    needs = frozenset({"altitude"})
    measures_airspeed = False
    velocity_loop = VelocityLoop(proportional=1.8, integral=0.4)
    """MPC_XY_VEL_P_ACC and MPC_XY_VEL_I_ACC as they come."""

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """Forward speed and yaw rate at the height to hold."""
        return self._target(steer.speed, steer.yaw_rate, state, now)

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """Stand still at the height to hold."""
        return self._target(0.0, 0.0, state, now)

    def _target(self, forward: float, yaw_rate: float, state: VehicleState, now: float) -> Message:
        down = self._down(state)
        return body_velocity(self.MASK, state, now, forward=forward, down=down, yaw_rate=yaw_rate)

    def _down(self, state: VehicleState) -> float:
        """Descent rate that returns to the height to hold, m/s; 0 when one of the two heights is not known."""
        altitude, facts = state.motion.altitude, self._facts
        if altitude is None or state.height is None:
            return 0.0
        return min(max(facts.climb_gain * (altitude - state.height), -facts.max_climb), facts.max_climb)


class PX4PlaneStick(_PX4):
    """ALTCTL (2): the roll stick by MANUAL_CONTROL; PX4 holds height and speed. Needs no position.

    MANUAL_CONTROL: y = 1000 roll/FW_R_LIM (right positive), x = 0 holds height, z = 500 is trim speed, r = 0 (PX4
    coordinates). Set COM_RC_IN_MODE so that PX4 listens to it; the pilot's own sticks then do nothing until the pilot
    changes the mode, which takes the vehicle. Silence for COM_RC_LOSS_T, in any mode that COM_RCL_EXCEPT does not name:
    Hold, then NAV_RCL_ACT (RTL), with no return.
    """

    name = "px4 plane"
    vehicle_types = frozenset((dialect.MAV_TYPE_FIXED_WING,))
    guided_mode = custom_mode(ALTCTL)
    shapes: frozenset[tuple[str, int | None]] = frozenset({("MANUAL_CONTROL", None)})
    needs = frozenset({"airspeed"})
    exits = MappingProxyType({name: mode for name, mode in EXITS.items() if name != "hold"})

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """ALTCTL is refused without a stick; the AUTO modes do not heed it, those flown by stick would."""
        return mode is not None and mode >> 16 & 0xFF == AUTO

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """The stick that holds the bank of the coordinated turn."""
        airspeed = self.airspeed(state.motion.airspeed)
        return self._stick(coordinated_bank(steer.yaw_rate, airspeed, self._facts.max_bank), state)

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """Stick in the middle: wings level."""
        return self._stick(0.0, state)

    def _stick(self, roll: float, state: VehicleState) -> Message:
        y = round(self._facts.stick(roll))
        return dialect.MAVLink_manual_control_message(state.target_system, 0, y, 500, 0, 0)


class PX4PlaneAttitude(_PX4):
    """OFFBOARD (6) by attitude: roll for the turn, pitch and thrust from our own height and airspeed loops.

    SET_ATTITUDE_TARGET mask 7: all three rates ignored (bits 0..2), thrust used (bit 6 clear: ignoring it means thrust
    0), attitude used (bit 7 clear). The yaw in q is ignored on a fixed wing. PX4 holds neither height nor speed here.
    Without setpoints for COM_OF_LOSS_T (1 s): failsafe.
    """

    MASK = 0x07
    name = "px4 plane"
    vehicle_types = frozenset((dialect.MAV_TYPE_FIXED_WING,))
    guided_mode = custom_mode(OFFBOARD)
    shapes: frozenset[tuple[str, int | None]] = frozenset({("SET_ATTITUDE_TARGET", MASK)})
    needs = frozenset({"airspeed", "altitude", "climb"})

    def setpoint(self, steer: Steer, state: VehicleState, now: float) -> Message:
        """The bank of the coordinated turn, with the pitch and thrust that keep height and speed in it."""
        airspeed = self.airspeed(state.motion.airspeed)
        return self._target(coordinated_bank(steer.yaw_rate, airspeed, self._facts.max_bank), state, now)

    def safe_setpoint(self, state: VehicleState, now: float) -> Message:
        """Wings level at this height and speed."""
        return self._target(0.0, state, now)

    def _target(self, roll: float, state: VehicleState, now: float) -> Message:
        loops, motion = self._facts.loops, state.motion
        pitch, thrust = 0.0, loops.trim_thrust + loops.thrust_per_bank * (1 / cos(roll) - 1)
        if motion.altitude is not None and motion.climb is not None and state.height is not None:
            rise = loops.pitch_per_height * (state.height - motion.altitude) - loops.pitch_per_climb * motion.climb
            pitch = min(max(rise, -loops.max_pitch), loops.max_pitch)
        thrust += loops.thrust_per_speed * (self._facts.speed - self.airspeed(motion.airspeed))
        return attitude(self.MASK, state, now, roll=roll, pitch=pitch, thrust=min(max(thrust, 0.0), 1.0))
