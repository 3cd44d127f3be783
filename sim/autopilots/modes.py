"""Mode names and the custom_mode numbers of HEARTBEAT."""

COPTER = {
    "STABILIZE": 0,
    "ACRO": 1,
    "ALT_HOLD": 2,
    "AUTO": 3,
    "GUIDED": 4,
    "LOITER": 5,
    "RTL": 6,
    "CIRCLE": 7,
    "LAND": 9,
    "DRIFT": 11,
    "SPORT": 13,
    "FLIP": 14,
    "AUTOTUNE": 15,
    "POSHOLD": 16,
    "BRAKE": 17,
    "THROW": 18,
    "AVOID_ADSB": 19,
    "GUIDED_NOGPS": 20,
    "SMART_RTL": 21,
}
PLANE = {
    "MANUAL": 0,
    "CIRCLE": 1,
    "STABILIZE": 2,
    "TRAINING": 3,
    "ACRO": 4,
    "FBWA": 5,
    "FBWB": 6,
    "CRUISE": 7,
    "AUTOTUNE": 8,
    "AUTO": 10,
    "RTL": 11,
    "LOITER": 12,
    "TAKEOFF": 13,
    "AVOID_ADSB": 14,
    "GUIDED": 15,
    "INITIALISING": 16,
}
ROVER = {
    "MANUAL": 0,
    "ACRO": 1,
    "STEERING": 3,
    "HOLD": 4,
    "LOITER": 5,
    "FOLLOW": 6,
    "SIMPLE": 7,
    "CIRCLE": 9,
    "AUTO": 10,
    "RTL": 11,
    "SMART_RTL": 12,
    "GUIDED": 15,
    "INITIALISING": 16,
}


def px4_mode(main: int, sub: int = 0) -> int:
    """PX4's custom_mode: main mode in byte 2, sub mode in byte 3."""
    return main << 16 | sub << 24


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
