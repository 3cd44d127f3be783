"""PX4's vehicles in OFFBOARD, and what they share with the one that is not: see `px4_plane_stick`.

Signs, masks and timeouts are those flown on PX4 main (2026-03) in its simulator. PX4 acknowledges a mode change
before it decides, and returns to OFFBOARD by itself when setpoints resume: the mode is read from HEARTBEAT and
CURRENT_MODE only, and giving control back always commands another mode.
"""

from math import cos
from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import VelocityLoop
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
    FAIL,
    PASS,
    WARN,
    Context,
    Verdict,
    at_least,
    least_airspeed,
    most_airspeed,
    one_of,
    rule,
    timeout,
    velocity_limit,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import body_from_level
from circnav_mav.mav.setpoint_guard import Steer

ALTCTL, POSCTL, AUTO, OFFBOARD, ALT_CRUISE = 2, 3, 4, 6, 11


def custom_mode(main: int, sub: int = 0) -> int:
    """HEARTBEAT.custom_mode of a PX4 main and sub mode."""
    return main << 16 | sub << 24


def main_and_sub(mode: int) -> tuple[int, int]:
    """And back: what MAV_CMD_DO_SET_MODE takes as p2 and p3."""
    return mode >> 16 & 0xFF, mode >> 24 & 0xFF


PX4 = Firmware(
    key="px4",
    autopilot=dialect.MAV_AUTOPILOT_PX4,
    flown="PX4 main of 2026-03",
    streams={
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
        dialect.MAVLINK_MSG_ID_ATTITUDE: 20.0,
        dialect.MAVLINK_MSG_ID_VFR_HUD: 10.0,
        dialect.MAVLINK_MSG_ID_HIGHRES_IMU: 25.0,
        dialect.MAVLINK_MSG_ID_CURRENT_MODE: 2.0,  # HEARTBEAT stays at 1 Hz whatever is asked
    },
    mode_numbers=main_and_sub,
    bytewise=True,
    echoes_ranges=True,
    why_must_leave="PX4 goes back to OFFBOARD by itself when setpoints resume",
)


class PX4Vehicle(Autopilot):
    """Modes, exits and OFFBOARD's hunger for setpoints."""

    firmware = PX4
    mode_names = MappingProxyType(
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
    exits = MappingProxyType(
        {"loiter": custom_mode(AUTO, 3), "rtl": custom_mode(AUTO, 5), "land": custom_mode(AUTO, 6)}
        | {"hold": custom_mode(ALTCTL)}
    )
    guided_mode = custom_mode(OFFBOARD)

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """OFFBOARD is refused without; every other mode ignores them."""
        return True


def _offboard_loss(value: float, context: Context) -> Verdict:
    modes = ("POSCTL", "ALTCTL", "STABILIZED", "RTL", "LAND", "LOITER")
    if not 0 <= value < len(modes):
        return FAIL, "when setpoints stop it is disarmed or terminated in the air"
    to_pilot = " for the pilot, RTL without a transmitter" if value < modes.index("RTL") else ""
    return PASS, f"when setpoints stop: {modes[int(value)]}{to_pilot}"


def _sticks_override(value: float, context: Context) -> Verdict:
    if int(value) & 1 << 1:
        return PASS, "in OFFBOARD the pilot takes over by moving the sticks, or by a mode"
    return PASS, "in OFFBOARD the pilot's sticks do nothing; a change of mode takes the vehicle"


OFFBOARD_RULES = (
    rule(
        "MAV_FWDEXTSP",
        one_of(
            {0: (FAIL, "setpoints from MAVLink are not passed to the controllers: set it to 1")},
            (PASS, "setpoints from MAVLink reach the controllers"),
        ),
    ),
    rule("COM_OF_LOSS_T", timeout("falls into its failsafe (and returns by itself when setpoints do)")),
    rule("COM_OBL_RC_ACT", _offboard_loss),
    rule(
        "COM_RC_IN_MODE",
        one_of(
            {1: (WARN, "the pilot's transmitter is ignored: the operator takes over from a ground station only")},
            (PASS, "0: transmitter, 2 and up: transmitter and ground station, 4: no sticks at all"),
        ),
    ),
    rule("COM_RC_OVERRIDE", _sticks_override),
    rule("COM_RC_LOSS_T", lambda value, context: (PASS, f"a transmitter silent for {value:g} s counts as lost")),
)
"""Of every vehicle flown in OFFBOARD."""


# --- copter -----------------------------------------------------------------------------------------------------------

_yaw_rate_limit = at_least(
    lambda mission: mission.max_turn_rate_deg,
    "the mission's limit of {:g} deg/s is within it",
    "the vehicle turns slower than the mission's limit of {:g} deg/s: lower it",
)


class PX4Copter(PX4Vehicle):
    """OFFBOARD (6): body velocity and yaw rate, height held by us through the climb rate.

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8; 7, 9, 12 and 20 are dropped), mask 0x407: all three velocities and
    accelerations must be used, masking one of them masks its kind. The acceleration is fed forward: without it the
    ground speed droops and the course lags the nose by 10 .. 40 degrees (guidance.velocity_loop). vz = 0 does not hold
    height (it wandered 15 m), so vz = gain (altitude - wanted), down positive. Turn rate true to 1 %. Without setpoints
    for COM_OF_LOSS_T (1 s): failsafe, RTL without RC.
    """

    MASK = 0x407
    name = "px4 copter"
    bundled = ("px4_copter",)
    vehicle_types = COPTER_TYPES
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    needs = frozenset({"altitude"})
    ground_speed_sigma = 0.05  # a drag that only the flight tells takes some of it
    velocity_loop = VelocityLoop(proportional=1.8, integral=0.4, derivative=0.2)  # MPC_XY_VEL_P_ACC, _I_, _D_
    parameters = (
        *OFFBOARD_RULES,
        rule("MC_YAWRATE_MAX", _yaw_rate_limit),
        rule("MPC_XY_VEL_MAX", velocity_limit, optional=True),
    )

    def setpoint(self, steer: Steer, to: Addressee, now: float) -> Message:
        """Forward speed and yaw rate at the height to hold, and the acceleration that both need."""
        push, right = self.velocity_loop.fed(steer.speed, steer.yaw_rate, to.drag)
        # PX4 turns velocities by the yaw alone, accelerations by the whole attitude: 10 % would be missing at 26 deg
        fed = body_from_level(push, right, to.motion.roll or 0.0, to.motion.pitch or 0.0)
        return body_velocity(self.MASK, to, now, steer, down=self._down(to), fed=fed)

    def _down(self, to: Addressee) -> float:
        """Descent rate that returns to the height to hold, m/s; 0 when one of the two heights is not known."""
        altitude, facts = to.motion.altitude, self._facts
        if altitude is None or to.height is None:
            return 0.0
        return min(max(facts.climb_gain * (altitude - to.height), -facts.max_climb), facts.max_climb)


# --- plane, by attitude -----------------------------------------------------------------------------------------------


class PX4PlaneAttitude(PX4Vehicle):
    """OFFBOARD (6) by attitude: roll for the turn, pitch and thrust from our own height and airspeed loops.

    SET_ATTITUDE_TARGET mask 7: all three rates ignored (bits 0..2), thrust used (bit 6 clear: ignoring it means thrust
    0), attitude used (bit 7 clear). The yaw in q is ignored on a fixed wing. PX4 holds neither height nor speed here.
    Without setpoints for COM_OF_LOSS_T (1 s): failsafe.
    """

    MASK = 0x07
    name = "px4 plane"
    bundled = ("px4_plane",)
    vehicle_types = PLANE_TYPES
    shapes = frozenset({("SET_ATTITUDE_TARGET", MASK)})
    needs = frozenset({"airspeed", "altitude", "climb"})
    banks = measures_airspeed = True
    least_turn_gain = 0.72  # as ArduPlane
    parameters = (*OFFBOARD_RULES, rule("FW_AIRSPD_MIN", least_airspeed), rule("FW_AIRSPD_MAX", most_airspeed))

    def setpoint(self, steer: Steer, to: Addressee, now: float) -> Message:
        """The bank of the coordinated turn, with the pitch and thrust that keep height and speed in it."""
        roll = self.bank(steer, to)
        loops, motion = self._facts.loops, to.motion
        pitch, thrust = 0.0, loops.trim_thrust + loops.thrust_per_bank * (1 / cos(roll) - 1)
        if motion.altitude is not None and motion.climb is not None and to.height is not None:
            rise = loops.pitch_per_height * (to.height - motion.altitude) - loops.pitch_per_climb * motion.climb
            pitch = min(max(rise, -loops.max_pitch), loops.max_pitch)
        thrust += loops.thrust_per_speed * (self._facts.speed - self.airspeed(motion.airspeed))
        return attitude(self.MASK, to, now, roll=roll, pitch=pitch, thrust=min(max(thrust, 0.0), 1.0))
