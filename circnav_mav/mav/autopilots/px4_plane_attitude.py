"""PX4 fixed wing in OFFBOARD with attitude and thrust setpoints."""

from math import cos

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import PLANE_TYPES, SetpointContext, attitude
from circnav_mav.mav.autopilots.parameters import least_airspeed, most_airspeed, rule
from circnav_mav.mav.autopilots.px4 import OFFBOARD_RULES, PX4Vehicle
from circnav_mav.mav.codec import Message
from circnav_mav.mav.setpoint_guard import MAX_PITCH, Steer

THRUST_PER_SPEED, THRUST_PER_BANK = 0.08, 0.25
"""Thrust (0 to 1) per m/s of airspeed error, and per 1/cos(roll) - 1. Tuned on PX4's simulated plane at 10 m/s, like
the next two gains."""
PITCH_PER_HEIGHT, PITCH_PER_CLIMB = 0.02, 0.04
"""Pitch, rad, per m of height error, and its reduction per m/s of climb."""


class PX4PlaneAttitude(PX4Vehicle):
    """OFFBOARD (6) with attitude setpoints: roll for the turn, pitch and thrust from our height and airspeed loops.

    SET_ATTITUDE_TARGET mask 7: all three rates ignored (bits 0 to 2), thrust used (bit 6 clear, because ignored thrust
    means 0), attitude used (bit 7 clear). The yaw in q is ignored on a fixed wing. PX4 holds neither height nor speed
    in this mode. Without setpoints for COM_OF_LOSS_T (1 s): failsafe.
    """

    MASK = 0x07
    name = "px4 plane"
    bundled = ("px4_plane",)
    vehicle_types = PLANE_TYPES
    shapes = frozenset({("SET_ATTITUDE_TARGET", MASK)})
    needs = frozenset({"airspeed", "altitude", "climb"})
    echo = dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET
    banks = measures_airspeed = True
    least_turn_gain = 0.72  # as ArduPlane
    parameters = (*OFFBOARD_RULES, rule("FW_AIRSPD_MIN", least_airspeed), rule("FW_AIRSPD_MAX", most_airspeed))

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the bank of the coordinated turn, with the pitch and thrust that hold height and speed."""
        roll = self.bank(steer, to)
        motion = to.motion
        pitch, thrust = 0.0, self._facts.trim_thrust + THRUST_PER_BANK * (1 / cos(roll) - 1)
        if motion.altitude is not None and motion.climb is not None and to.height is not None:
            rise = PITCH_PER_HEIGHT * (to.height - motion.altitude) - PITCH_PER_CLIMB * motion.climb
            pitch = min(max(rise, -MAX_PITCH), MAX_PITCH)
        thrust += THRUST_PER_SPEED * (self._facts.speed - self.airspeed(motion.airspeed))
        return attitude(self.MASK, to, now, roll=roll, pitch=pitch, thrust=min(max(thrust, 0.0), 1.0))
