"""PX4 multicopter in OFFBOARD."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.autopilots.interface import COPTER_TYPES, Addressee, body_velocity
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
    "the mission's limit of {:g} deg/s is within it",
    "the vehicle turns slower than the mission's limit of {:g} deg/s: lower it",
)


def _enough_yaw_rate(context: Context) -> float:
    """Return the firmware's default of 200 deg/s, or the mission's limit."""
    return max(200.0, context.max_turn_rate_deg)


CLIMB_GAIN = 0.5
"""Climb rate, m/s, per m of missing height, as flown on PX4's simulated copter."""


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
    echo = dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
    ground_speed_sigma = 0.05  # a drag that only the flight tells takes some of it
    velocity_loop = VelocityLoop(proportional=1.8, integral=0.4, derivative=0.2)  # MPC_XY_VEL_P_ACC, _I_, _D_
    parameters = (
        *OFFBOARD_RULES,
        rule("MC_YAWRATE_MAX", _yaw_rate_limit, advised=_enough_yaw_rate),
        rule("MPC_XY_VEL_MAX", velocity_limit, optional=True, advised=enough_speed(12.0)),
        rule("MPC_TILTMAX_AIR", lean_limit, optional=True, advised=enough_lean(45.0)),
    )

    def setpoint(self, steer: Steer, to: Addressee, now: float) -> Message:
        """Forward speed and yaw rate at the height to hold, and the acceleration that both need."""
        push, right = self.velocity_loop.fed(steer.speed, steer.yaw_rate, to.drag)
        # PX4 turns velocities by the yaw alone, accelerations by the whole attitude: 10 % would be missing at 26 deg
        fed = body_from_level(push, right, to.motion.roll or 0.0, to.motion.pitch or 0.0)
        return body_velocity(self.MASK, to, now, steer, down=self._down(to), fed=fed)

    def _down(self, to: Addressee) -> float:
        """Descent rate that returns to the height to hold, m/s; 0 when one of the two heights is not known."""
        altitude = to.motion.altitude
        if altitude is None or to.height is None:
            return 0.0
        return min(max(CLIMB_GAIN * (altitude - to.height), -MAX_CLIMB), MAX_CLIMB)
