"""Mode names and the custom_mode numbers of HEARTBEAT."""


def numbered(names: str) -> dict[str, int]:
    """Number the modes from 0; a dash is a number without a mode."""
    return {name: number for number, name in enumerate(names.split()) if name != "-"}


COPTER = numbered(
    "STABILIZE ACRO ALT_HOLD AUTO GUIDED LOITER RTL CIRCLE - LAND - DRIFT - SPORT FLIP AUTOTUNE"
    " POSHOLD BRAKE THROW AVOID_ADSB GUIDED_NOGPS SMART_RTL"
)
PLANE = numbered(
    "MANUAL CIRCLE STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE - AUTO RTL LOITER TAKEOFF"
    " AVOID_ADSB GUIDED INITIALISING"
)
ROVER = numbered(
    "MANUAL ACRO - STEERING HOLD LOITER FOLLOW SIMPLE - CIRCLE AUTO RTL SMART_RTL - - GUIDED"
    " INITIALISING"
)
# PX4's custom_mode has the main mode in byte 2 and, for AUTO (4), the sub mode in byte 3
_MAIN = numbered("- MANUAL ALTCTL POSCTL - ACRO OFFBOARD STABILIZED - - - ALT_CRUISE")
_AUTO = numbered("- - TAKEOFF LOITER MISSION RTL LAND")
PX4 = {name: main << 16 for name, main in _MAIN.items()} | {
    name: 4 << 16 | sub << 24 for name, sub in _AUTO.items()
}
MODES = {
    "arducopter": COPTER,
    "arducopter_nogps": COPTER,
    "arduplane": PLANE,
    "ardurover": ROVER,
    "px4_copter": PX4,
    "px4_plane": PX4,
}
PROFILES = tuple(MODES)
