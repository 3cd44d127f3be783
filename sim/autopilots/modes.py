"""Mode names and the custom_mode numbers of HEARTBEAT."""


def numbered(names: str) -> dict[str, int]:
    """ArduPilot's modes in the order of their numbers, from 0; a dash is a number without a mode."""
    return {name: number for number, name in enumerate(names.split()) if name != "-"}


def px4_mode(main: int, sub: int = 0) -> int:
    """PX4's custom_mode: main mode in byte 2, sub mode in byte 3."""
    return main << 16 | sub << 24


COPTER = numbered(
    "STABILIZE ACRO ALT_HOLD AUTO GUIDED LOITER RTL CIRCLE - LAND - DRIFT - SPORT FLIP AUTOTUNE POSHOLD BRAKE THROW "
    "AVOID_ADSB GUIDED_NOGPS SMART_RTL"
)
PLANE = numbered(
    "MANUAL CIRCLE STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE - AUTO RTL LOITER TAKEOFF AVOID_ADSB GUIDED "
    "INITIALISING"
)
ROVER = numbered("MANUAL ACRO - STEERING HOLD LOITER FOLLOW SIMPLE - CIRCLE AUTO RTL SMART_RTL - - GUIDED INITIALISING")
PX4 = {
    "MANUAL": px4_mode(1),
    "ALTCTL": px4_mode(2),
    "POSCTL": px4_mode(3),
    "TAKEOFF": px4_mode(4, 2),
    "LOITER": px4_mode(4, 3),
    "MISSION": px4_mode(4, 4),
    "RTL": px4_mode(4, 5),
    "LAND": px4_mode(4, 6),
    "ACRO": px4_mode(5),
    "OFFBOARD": px4_mode(6),
    "STABILIZED": px4_mode(7),
    "ALT_CRUISE": px4_mode(11),
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
