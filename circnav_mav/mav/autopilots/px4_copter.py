"""PX4 multicopter in OFFBOARD, and in ALTCTL by stick without any position."""

from math import copysign, radians
from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import VelocityLoop
from circnav_mav.mav.autopilots.interface import (
    AIRSPEED_FROM_DRAG,
    FULL_TILT,
    Copter,
    SetpointContext,
    body_velocity,
    ground_speed,
    level_acceleration,
)
from circnav_mav.mav.autopilots.parameters import (
    FAIL,
    PASS,
    Context,
    Judge,
    Name,
    Rule,
    Verdict,
    always,
    at_least,
    enough_lean,
    enough_speed,
    lean_limit,
    rule,
    timeout,
    velocity_limit,
)
from circnav_mav.mav.autopilots.px4 import (
    ALTCTL,
    COMPASS,
    OFFBOARD_RULES,
    STICKS,
    PX4Vehicle,
    custom_mode,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import body_from_level
from circnav_mav.mav.setpoint_guard import MAX_CLIMB, Steer

_yaw_rate_limit = at_least(
    lambda mission: mission.max_turn_rate_deg,
    "at least the mission's turn-rate limit of {:g} deg/s",
    "below the mission's turn-rate limit of {:g} deg/s, so the vehicle turns slower: lower"
    " vehicle.max_turn_rate_deg_s",
)


def _enough_yaw_rate(context: Context) -> float:
    """Return the larger of the firmware's default of 200 deg/s and the mission's turn-rate
    limit."""
    return max(200.0, context.max_turn_rate_deg)


class PX4Copter(Copter, PX4Vehicle):
    """OFFBOARD (6): body velocity and yaw rate. circnav holds the height by the climb rate.

    SET_POSITION_TARGET_LOCAL_NED, frame BODY_NED (8; PX4 drops 7, 9, 12 and 20), mask 0x407: all
    three velocities and all three accelerations must be used, because one ignored axis makes PX4
    ignore all three. Without feed-forward acceleration the ground speed drops and the course lags
    the nose by 10 to 40 degrees (guidance.velocity_loop). vz = 0 does not hold the height (drift of
    15 m), so vz = gain (altitude - height), down positive. The turn rate is accurate to 1 %. After
    COM_OF_LOSS_T (1 s) without setpoints PX4 enters its failsafe: RTL without a transmitter.
    """

    MASK = 0x407
    name = "px4 copter"
    bundled = ("px4_copter",)
    shapes = frozenset({("SET_POSITION_TARGET_LOCAL_NED", MASK)})
    needs = frozenset({"altitude"})
    echo = dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED
    holds_ground_speed = True
    estimation = ground_speed(0.05)  # the drag, unknown before a flight, reduces the speed
    velocity_loop = VelocityLoop(
        proportional=1.8, integral=0.4, derivative=0.2
    )  # MPC_XY_VEL_P_ACC, _I_, _D_
    parameters = (
        *OFFBOARD_RULES,
        rule("MC_YAWRATE_MAX", _yaw_rate_limit, advised=_enough_yaw_rate),
        rule("MPC_XY_VEL_MAX", velocity_limit, optional=True, advised=enough_speed(12.0)),
        rule("MPC_TILTMAX_AIR", lean_limit, optional=True, advised=enough_lean(45.0)),
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the setpoint of forward speed, yaw rate and climb rate, with the feed-forward
        acceleration."""
        forward, right = self.air.feed(steer.speed, steer.yaw_rate)
        # PX4 rotates velocities by the yaw alone, but accelerations by the whole attitude. Without
        # `body_from_level` the feed-forward has an error of 10 % at 26 deg of tilt.
        fed = body_from_level(forward, right, to.motion.roll or 0.0, to.motion.pitch or 0.0)
        return body_velocity(self.MASK, to, now, steer, down=self._down(to), fed=fed)

    def _down(self, to: SetpointContext) -> float:
        """Return the descent rate that corrects the height, m/s; 0 if the present or the held
        altitude is unknown."""
        altitude = to.motion.altitude
        if altitude is None or to.height is None:
            return 0.0
        # 0.5: climb rate, m/s, per m of height error, tuned on PX4's simulated copter.
        return min(max(0.5 * (altitude - to.height), -MAX_CLIMB), MAX_CLIMB)


FULL_YAW = 150.0
"""Yaw rate at full stick, deg/s: the default of MPC_MAN_Y_MAX."""
DEADZONE = 0.1
"""Share of the yaw stick around its center without effect: the default of MAN_DEADZONE (before PX4
1.17 MPC_HOLD_DZ)."""
CUBIC = 0.6
"""Cubic share of the yaw stick's curve: a constant of PX4 (Sticks::getYawExpo), before PX4 1.17 the
default of MPC_YAW_EXPO."""


def yaw_stick(yaw_rate: float) -> float:
    """Return the yaw stick of MANUAL_CONTROL, thousandths to the right, for a yaw rate, rad/s
    clockwise.

    PX4 removes a dead zone, then maps the deflection x to (1 - CUBIC) x + CUBIC x^3. This function
    is the inverse.
    """
    share = min(abs(yaw_rate) / radians(FULL_YAW), 1.0)
    x = share
    for _ in range(8):  # Newton's method: monotonic curve, a start inside [0, 1]
        x -= ((1 - CUBIC) * x + CUBIC * x**3 - share) / ((1 - CUBIC) + 3 * CUBIC * x**2)
    deflection = DEADZONE + (1 - DEADZONE) * x if share > 0 else 0.0
    return copysign(1000 * min(deflection, 1.0), yaw_rate)


def _equals(wanted: float) -> Judge:
    """Return a judge of a parameter that scales the sticks and must equal `wanted`."""

    def judge(value: float, context: Context) -> Verdict:
        words = f"circnav computes its sticks for {wanted:g}"
        if abs(value / wanted - 1) > 0.02:
            return FAIL, f"{words}: set it"
        return PASS, words

    return judge


class PX4CopterStick(Copter, PX4Vehicle):
    """ALTCTL (2): all sticks by MANUAL_CONTROL, for flights without any position. PX4 holds the
    height.

    MANUAL_CONTROL: x (forward) and y (right) command a horizontal acceleration by tilting the
    thrust. Full stick is a tilt of MPC_MAN_TILT_MAX. z = 500 holds the height, r commands a yaw
    rate. The copter drifts with the wind. After COM_RC_LOSS_T without stick messages PX4 treats the
    sticks as lost: without a position the copter descends where it is. LOITER and RTL require a
    position.
    """

    name = "px4 copter by stick"
    bundled = ("px4_copter",)
    guided_mode = custom_mode(ALTCTL)
    exits = MappingProxyType({"land": PX4Vehicle.exits["land"]})
    default_exit = "land"
    shapes = frozenset({("MANUAL_CONTROL", None)})
    airspeed_from_drag = True
    estimation = AIRSPEED_FROM_DRAG
    tilts_by_stick = True
    parameters = (
        STICKS,
        rule(
            "COM_RC_LOSS_T", timeout("counts the sticks as lost, and descends without a position")
        ),
        rule("MPC_MAN_TILT_MAX", _equals(FULL_TILT), advised=always(FULL_TILT)),
        rule("MPC_MAN_Y_MAX", _equals(FULL_YAW), advised=always(FULL_YAW)),
        Rule(
            (Name("MAN_DEADZONE", since="1.17"), Name("MPC_HOLD_DZ", until="1.16")),
            _equals(DEADZONE),
            advised=always(DEADZONE),
        ),
        Rule(
            (Name("MPC_YAW_EXPO", until="1.16"),),
            _equals(CUBIC),
            optional=True,
            advised=always(CUBIC),
        ),
        COMPASS,
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the sticks that turn in coordination and hold the airspeed."""
        forward, right = level_acceleration(
            steer, self.air.thrust_acceleration(steer.speed), self._facts.max_bank
        )
        x = round(self._facts.tilt_stick(forward))
        y = round(self._facts.tilt_stick(right))
        return dialect.MAVLink_manual_control_message(
            to.target_system, x, y, 500, round(yaw_stick(steer.yaw_rate)), 0
        )
