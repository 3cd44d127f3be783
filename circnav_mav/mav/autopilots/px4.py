"""Common parts of PX4's vehicles, and parameter rules for the vehicles flown in OFFBOARD.

Signs, masks and timeouts were tested on PX4 main (2026-03) in its simulator. PX4 acknowledges a
mode change before it accepts or rejects the change, so the mode is read from HEARTBEAT and
CURRENT_MODE only. PX4 returns to OFFBOARD by itself when setpoints resume, so circnav always ends a
flight by commanding another mode.
"""

from types import MappingProxyType

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import Autopilot, Firmware
from circnav_mav.mav.autopilots.parameters import (
    FAIL,
    FLIES_ON,
    PASS,
    WARN,
    Context,
    Name,
    Rule,
    Verdict,
    always,
    one_of,
    rule,
    timeout,
)

# Numbers of PX4's main modes (px4_custom_mode.h).
ALTCTL = 2
POSCTL = 3
AUTO = 4
OFFBOARD = 6
ALT_CRUISE = 11


def custom_mode(main: int, sub: int = 0) -> int:
    """Return HEARTBEAT.custom_mode for a PX4 main and sub mode."""
    return main << 16 | sub << 24


def main_and_sub(mode: int) -> tuple[int, int]:
    """Return main and sub mode of a custom_mode: parameters 2 and 3 of MAV_CMD_DO_SET_MODE."""
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
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
        dialect.MAVLINK_MSG_ID_HIGHRES_IMU: 25.0,
        dialect.MAVLINK_MSG_ID_CURRENT_MODE: 2.0,  # the rate of HEARTBEAT is fixed at 1 Hz
    },
    mode_numbers=main_and_sub,
    bytewise=True,
    why_must_leave="PX4 goes back to OFFBOARD by itself when setpoints resume",
)


class PX4Vehicle(Autopilot):
    """Modes and exit actions of PX4, and its requirement for setpoints before OFFBOARD."""

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
            custom_mode(AUTO, 9): "AUTO.PRECLAND",
            custom_mode(AUTO, 10): "AUTO.VTOL_TAKEOFF",
            custom_mode(OFFBOARD): "OFFBOARD",
            custom_mode(7): "STABILIZED",
            custom_mode(ALT_CRUISE): "ALT_CRUISE",
        }
    )
    exits = MappingProxyType(
        {"loiter": custom_mode(AUTO, 3), "rtl": custom_mode(AUTO, 5), "land": custom_mode(AUTO, 6)}
        | {"hold": custom_mode(ALTCTL)}
    )
    # take-off, RTL, landing, precision landing, VTOL take-off
    kept_modes = frozenset(custom_mode(AUTO, sub) for sub in (2, 5, 6, 9, 10))
    guided_mode = custom_mode(OFFBOARD)

    def wants_setpoints_in(self, mode: int | None) -> bool:
        """True if the mode ignores our messages: PX4 rejects OFFBOARD and ALTCTL without a stream
        of them. Every other mode ignores setpoints. AUTO modes ignore the sticks, manual modes
        would follow them."""
        if self.guided_mode == custom_mode(OFFBOARD):
            return True
        return mode is not None and main_and_sub(mode)[0] == AUTO


def _offboard_loss(value: float, context: Context) -> Verdict:
    modes = ("POSCTL", "ALTCTL", "STABILIZED", "RTL", "LAND", "LOITER")
    if not 0 <= value < len(modes):
        return FAIL, "when setpoints stop, the vehicle is disarmed or terminated in the air"
    to_pilot = " for the pilot, RTL without a transmitter" if value < modes.index("RTL") else ""
    return PASS, f"when setpoints stop: {modes[int(value)]}{to_pilot}"


def _transmitter_lost(value: float, context: Context) -> Verdict:
    """Judge NAV_RCL_ACT. With bit 2 of COM_RCL_EXCEPT, OFFBOARD continues without the
    transmitter."""
    action = {1: "Hold", 2: "RTL", 3: "LAND", 5: "motors off", 6: "motors off"}.get(int(value))
    if action is None or int(context.values.get("COM_RCL_EXCEPT", 0)) & 1 << 2:
        return FLIES_ON
    grade = FAIL if value > 3 else PASS
    return grade, f"if the transmitter is lost: Hold for COM_FAIL_ACT_T, then {action}"


def _sticks_override(value: float, context: Context) -> Verdict:
    if int(value) & 1 << 1:
        return PASS, "in OFFBOARD the pilot takes over by moving the sticks, or by a mode"
    return (
        PASS,
        "in OFFBOARD the pilot's sticks do nothing; the pilot takes over by changing the mode",
    )


_NO_COMPASS = (
    WARN,
    "the compass is not used, so the heading drifts without GPS, and the flight may end early:"
    " set 0",
)
COMPASS = rule(
    "EKF2_MAG_TYPE",
    one_of({5: _NO_COMPASS, 6: _NO_COMPASS}, (PASS, "the heading uses the compass")),
    optional=True,
)
_NO_STICKS = (FAIL, "sticks from MAVLink are ignored: set it to 1 (MAVLink only)")
_OUR_STICKS = (
    PASS,
    (
        "only sticks from MAVLink are used: the pilot takes over by changing the mode, not by the"
        " sticks"
    ),
)
_OTHER_STICKS = (WARN, "the pilot's transmitter may replace our sticks: set it to 1 (MAVLink only)")
STICKS = rule(
    "COM_RC_IN_MODE",
    one_of({0: _NO_STICKS, 1: _OUR_STICKS, 4: _NO_STICKS}, _OTHER_STICKS),
    advised=always(1),
)
"""Rule for the source of the sticks of vehicles flown by stick."""
_NOT_PASSED = (FAIL, "setpoints from MAVLink are not passed to the controllers: set it to 1")
_MAVLINK_ONLY = (WARN, "the pilot's transmitter is ignored: only a ground station can take over")
_TRANSMITTER = (PASS, "0: transmitter, 4: no sticks at all, others: transmitter and ground station")
OFFBOARD_RULES = (
    rule(
        "MAV_FWDEXTSP",
        one_of({0: _NOT_PASSED}, (PASS, "setpoints from MAVLink reach the controllers")),
        advised=always(1),
    ),
    rule(
        "COM_OF_LOSS_T",
        timeout("enters its failsafe (and OFFBOARD again when setpoints resume)"),
        advised=always(1.0),
    ),
    rule("COM_OBL_RC_ACT", _offboard_loss),
    rule("COM_RC_IN_MODE", one_of({1: _MAVLINK_ONLY}, _TRANSMITTER)),
    rule("COM_RC_OVERRIDE", _sticks_override),
    rule(
        "COM_RC_LOSS_T",
        lambda value, context: (PASS, f"a transmitter silent for {value:g} s counts as lost"),
    ),
    Rule((Name("NAV_RCL_ACT"),), _transmitter_lost, optional=True, also=("COM_RCL_EXCEPT",)),
    COMPASS,
)
"""Parameter rules for all vehicles flown in OFFBOARD."""
