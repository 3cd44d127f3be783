"""PX4 multicopter in OFFBOARD."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.autopilots.interface import COPTER_TYPES, SetpointContext, body_velocity
from circnav_mav.mav.autopilots.parameters import (
    Context,
    at_least,
    enough_lean,
    enough_speed,
    lean_limit,
    rule,
    velocity_limit,
)
from circnav_mav.mav.autopilots.px4 import OFFBOARD_RULES, PX4Vehicle
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import body_from_level
from circnav_mav.mav.setpoint_guard import MAX_CLIMB, Steer

_yaw_rate_limit = at_least(
    lambda mission: mission.max_turn_rate_deg,
    "at least the mission's turn-rate limit of {:g} deg/s",
    "below the mission's turn-rate limit of {:g} deg/s, so the vehicle turns slower: lower vehicle.max_turn_rate_deg_s",
)


def _enough_yaw_rate(context: Context) -> float:
    """Return the larger of the firmware's default of 200 deg/s and the mission's turn-rate limit."""
    return max(200.0, context.max_turn_rate_deg)


CLIMB_GAIN = 0.5
"""Climb rate, m/s, per m of height error, tuned on PX4's simulated copter."""


class PX4Copter(PX4Vehicle):
    """OFFBOARD (6): body velocity and yaw rate. circnav holds the height by the climb rate.

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8; PX4 drops 7, 9, 12 and 20), mask 0x407: all three velocities and
    accelerations must be used, because one mask bit masks all three of its kind. Without feed-forward acceleration the
    ground speed drops and the course lags the nose by 10 to 40 degrees (guidance.velocity_loop). vz = 0 does not hold
    height (drift of 15 m), so vz = gain (altitude - height), down positive. The turn rate is accurate to 1 %. Without
    setpoints for COM_OF_LOSS_T (1 s): failsafe, RTL without RC.
    """

    MASK = 0x407
    name = "px4 copter"
    bundled = ("px4_copter",)
    vehicle_types = COPTER_TYPES
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    needs = frozenset({"altitude"})
    echo = dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
    ground_speed_sigma = 0.05  # the drag, unknown before a flight, reduces the speed
    velocity_loop = VelocityLoop(proportional=1.8, integral=0.4, derivative=0.2)  # MPC_XY_VEL_P_ACC, _I_, _D_
    parameters = (
        *OFFBOARD_RULES,
        rule("MC_YAWRATE_MAX", _yaw_rate_limit, advised=_enough_yaw_rate),
        rule("MPC_XY_VEL_MAX", velocity_limit, optional=True, advised=enough_speed(12.0)),
        rule("MPC_TILTMAX_AIR", lean_limit, optional=True, advised=enough_lean(45.0)),
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the setpoint of forward speed, yaw rate and climb rate, with the feed-forward acceleration."""
        push, right = self.velocity_loop.fed(steer.speed, steer.yaw_rate, to.drag)
        # PX4 rotates velocities by the yaw alone, accelerations by the whole attitude: 10 % error at 26 deg of tilt
        fed = body_from_level(push, right, to.motion.roll or 0.0, to.motion.pitch or 0.0)
        return body_velocity(self.MASK, to, now, steer, down=self._down(to), fed=fed)

    def _down(self, to: SetpointContext) -> float:
        """Return the descent rate that corrects the height, m/s; 0 if one of the two heights is unknown."""
        altitude = to.motion.altitude
        if altitude is None or to.height is None:
            return 0.0
        return min(max(CLIMB_GAIN * (altitude - to.height), -MAX_CLIMB), MAX_CLIMB)
