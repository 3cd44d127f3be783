"""PX4 fixed wing in ALTCTL with the roll stick."""

from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import FULL_STICK, PLANE_TYPES, SetpointContext
from circnav_mav.mav.autopilots.parameters import (
    FAIL,
    PASS,
    SHORT_TIMEOUT,
    WARN,
    Context,
    Verdict,
    always,
    bank_limit,
    held_airspeed,
    least_airspeed,
    mission_speed,
    most_airspeed,
    rule,
)
from circnav_mav.mav.autopilots.px4 import (
    ALTCTL,
    COMPASS,
    STICKS,
    PX4Vehicle,
    custom_mode,
)
from circnav_mav.mav.codec import Message
from circnav_mav.mav.setpoint_guard import Steer

_STICK_LOSS: dict[float, str] = {1: "stays in Hold", 2: "flies home (RTL)", 3: "lands where it is"}
_STOPS_MOTORS = {5: "terminates the flight", 6: "disarms"}
_STOCK_STICK_LOSS = 2.0
"""Default of NAV_RCL_ACT: RTL."""
_HOLD_EXCEPTED = 2
"""Bit 1 of COM_RCL_EXCEPT: in Hold, PX4 ignores lost manual control."""


def _stick_loss(value: float, context: Context) -> Verdict:
    words = f"{value:g} s after our last stick message, manual control counts as lost (NAV_RCL_ACT)"
    if value < 2 * context.tick:
        return FAIL, f"{words}: shorter than two steps (limits.tick_hz)"
    return (WARN if value < SHORT_TIMEOUT else PASS), words


def _stick_loss_action(value: float, context: Context) -> Verdict:
    """Judge NAV_RCL_ACT: PX4's action when our stick messages end.

    PX4 then detects lost manual control in any mode, because it has received stick messages before.
    """
    when = (
        "when our stick messages end (takeover, exit action), in any mode but those of"
        " COM_RCL_EXCEPT"
    )
    if stops := _STOPS_MOTORS.get(int(value)):
        return FAIL, f"{when}, PX4 {stops} in the air: set 2 (RTL) or 1 (Hold)"
    if follows := _STICK_LOSS.get(int(value)):
        return PASS, f"{when}, the plane stays in Hold for COM_FAIL_ACT_T, then {follows}"
    return WARN, f"{when}, the action is undefined: set 2 (RTL) or 1 (Hold)"


def _stick_loss_exceptions(value: float, context: Context) -> Verdict:
    if int(value) & _HOLD_EXCEPTED:
        return (
            PASS,
            (
                "a plane given back or taken over in Hold (LOITER) stays there without our stick"
                " messages"
            ),
        )
    follows = _STICK_LOSS.get(
        context.values.get("NAV_RCL_ACT", _STOCK_STICK_LOSS), "follows NAV_RCL_ACT"
    )
    if follows == _STICK_LOSS[1]:
        return PASS, "Hold is not excepted, but NAV_RCL_ACT commands Hold, too"
    return (
        WARN,
        (
            f"a plane given back or taken over in Hold (LOITER) does not stay there, but {follows}:"
            " add 2 (bit 1, Hold)"
        ),
    )


def _stick_bank(value: float, context: Context) -> Verdict:
    # 0.5: largest permitted difference between the bank at full stick and FULL_STICK, deg.
    if abs(value - FULL_STICK) > 0.5:
        return (
            FAIL,
            (
                f"full stick is {value:g} deg of bank, circnav assumes {FULL_STICK:g}: set it to"
                f" {FULL_STICK:g}"
            ),
        )
    return bank_limit(value, context)


class PX4PlaneStick(PX4Vehicle):
    """ALTCTL (2): roll stick by MANUAL_CONTROL. PX4 holds height and speed. Needs no position.

    MANUAL_CONTROL: y = 1000 roll/FW_R_LIM (right positive), x = 0 holds height, z = 500 is trim
    speed, r = 0 (PX4 coordinates turns). Set COM_RC_IN_MODE to 1, so that PX4 accepts these sticks.
    The pilot's own sticks then have no effect until the pilot takes over by changing the mode.
    After COM_RC_LOSS_T without stick messages, in any mode not listed in COM_RCL_EXCEPT, PX4 enters
    Hold and then executes NAV_RCL_ACT (RTL). PX4 does not return to ALTCTL by itself.
    """

    name = "px4 plane"
    bundled = ("px4_plane",)
    vehicle_types = PLANE_TYPES
    min_height = 30.0
    low_exit = "loiter"
    guided_mode = custom_mode(ALTCTL)
    exits = MappingProxyType(
        {name: mode for name, mode in PX4Vehicle.exits.items() if name != "hold"}
    )
    shapes = frozenset({("MANUAL_CONTROL", None)})
    needs = frozenset({"airspeed"})
    fixed_wing = True
    least_turn_gain = 0.72  # value of ArduPlane; too few flights of PX4 for a value of its own
    parameters = (
        STICKS,
        rule("COM_RC_LOSS_T", _stick_loss, advised=always(0.5)),
        rule("NAV_RCL_ACT", _stick_loss_action, advised=always(2)),
        rule("COM_RCL_EXCEPT", _stick_loss_exceptions, advised=always(_HOLD_EXCEPTED)),
        rule("FW_R_LIM", _stick_bank, advised=always(FULL_STICK)),
        rule("FW_AIRSPD_TRIM", held_airspeed, advised=mission_speed),
        rule("FW_AIRSPD_MIN", least_airspeed),
        rule("FW_AIRSPD_MAX", most_airspeed),
        COMPASS,
    )

    def setpoint(self, steer: Steer, to: SetpointContext, now: float) -> Message:
        """Return the stick position that holds the bank of the coordinated turn."""
        y = round(self._facts.stick(self.bank(steer, to)))
        return dialect.MAVLink_manual_control_message(to.target_system, 0, y, 500, 0, 0)
