"""Identities of the autopilots, their streams, and the parameters that a companion computer
uses."""

from dataclasses import replace

from ..airframes.copter import ARDUPILOT_LEAN_DEG
from ..config import VehicleConfig
from ..params import INT8, INT16, INT32, Parameter, Parameters
from . import modes
from .contract import Ack, Identity, message_ids

VERSION_4_6_3 = 0x040603FF

# Mission float and int, param float, command int, attitude target, flight termination, compass
# calibration, MAVLink 2, fence and rally. FTP is left out because it is not supported here.
CAPABILITIES = 1 | 2 | 4 | 8 | 64 | 2048 | 4096 | 8192 | 16384 | 32768
SET_LOCAL_POSITION = 128 | 256

# Message ids that are not in ArduPilot 4.6's dialect. Its parser drops these messages, so they are
# neither obeyed nor forwarded.
UNKNOWN_IDS = message_ids(
    "53 220-224 420 435-437 441 513 516 517 8002-8016 17000 17150-17158 60000-60053"
)

# Message ids that SET_MESSAGE_INTERVAL accepts (mavlink_id_to_ap_message_id in GCS_Common.cpp),
# even if this vehicle lacks them.
STREAMABLE = message_ids(
    "0 1 2 24 26 27 29 30 31 32 33 35 36 42 46 49 62 65 74 83 85 87 110 111 116 124 125 128 129 132"
    " 136 137 143 147 148 152 158 163 164 165 168 173 178 182 191 192 193 226 230 241 242 245 246"
    " 251 259 11020 11039"
)
TIMESYNC_EVERY = {111: 10_000_000}

# Interval, us, of messages that plane and rover send without a request. A copter sends only
# TIMESYNC.
UNASKED = (
    dict.fromkeys((1, 2, 24, 27, 30, 33, 62, 65, 74, 116, 147, 193), 1_000_000) | TIMESYNC_EVERY
)

COPTER = Identity(
    mav_type=2,
    autopilot=3,
    version=VERSION_4_6_3,
    capabilities=CAPABILITIES | SET_LOCAL_POSITION,
    modes=modes.COPTER,
    streamable=STREAMABLE,
    fastest_us=3_125,  # loop rate 400 Hz
    unknown_ids=UNKNOWN_IDS,
    default_streams=TIMESYNC_EVERY,
)
SLOWER = replace(COPTER, fastest_us=25_000, default_streams=UNASKED)  # loop rate 50 Hz
PLANE = replace(
    SLOWER, mav_type=1, capabilities=CAPABILITIES, modes=modes.PLANE
)  # does not accept local position targets
ROVER = replace(SLOWER, mav_type=10, modes=modes.ROVER, mode_refusal="Flight mode change failed")


def copter_parameters(config: VehicleConfig) -> Parameters:
    return _parameters(
        config,
        "FS_GCS_ENABLE",
        Parameter(
            "ANGLE_MAX", round(100 * (config.vehicle.max_lean_deg or ARDUPILOT_LEAN_DEG)), INT16
        ),
        Parameter("FS_EKF_ACTION", 1, INT8),
        Parameter("GUID_OPTIONS", 0, INT16),
        Parameter("GUID_TIMEOUT", config.vehicle.setpoint_timeout_s or 3.0),
        Parameter("LAND_SPEED", 50, INT16),
        Parameter("PILOT_SPEED_UP", 250, INT16),
        Parameter("DISARM_DELAY", 10, INT8),
        Parameter("DEV_OPTIONS", 0, INT32),
        Parameter("RTL_ALT", 1500, INT16),
        Parameter("WPNAV_SPEED", 1000.0),
        Parameter("WPNAV_SPEED_UP", 250.0),
        Parameter("WPNAV_SPEED_DN", 150.0),
        Parameter("WPNAV_ACCEL", 250.0),
    )


def plane_parameters(config: VehicleConfig) -> Parameters:
    cruise = config.vehicle.cruise_speed_mps or 22.0
    return _parameters(
        config,
        "FS_GCS_ENABL",
        Parameter("FS_LONG_ACTN", 0, INT8),
        Parameter("ROLL_LIMIT_DEG", config.vehicle.max_bank_deg or 65.0),
        Parameter("AIRSPEED_CRUISE", cruise),
        Parameter("AIRSPEED_MIN", round(cruise * 0.6)),
        Parameter("AIRSPEED_MAX", round(cruise * 1.4)),
        Parameter("WP_LOITER_RAD", 60.0, INT16),
        Parameter("ARSPD_USE", 1, INT8),
        Parameter("TKOFF_ALT", 50.0),
        Parameter("TKOFF_DIST", 200.0),
        Parameter("RC_OVERRIDE_TIME", 3.0),
    )


def rover_parameters(config: VehicleConfig) -> Parameters:
    cruise = config.vehicle.cruise_speed_mps or 5.0
    return _parameters(
        config,
        "FS_GCS_ENABLE",
        Parameter("FS_TIMEOUT", 1.5),
        Parameter("FS_EKF_ACTION", 1, INT8),
        Parameter("CRUISE_SPEED", cruise),
        Parameter("WP_SPEED", cruise),
    )


def _parameters(config: VehicleConfig, gcs_switch: str, *own: Parameter) -> Parameters:
    table = (
        Parameter("SYSID_THISMAV", config.vehicle.system_id, INT16),
        Parameter("SYSID_MYGCS", 255, INT16),
        Parameter("ARMING_CHECK", 1, INT16),
        Parameter("COMPASS_USE", int(config.sensors.compass), INT8),
        Parameter("EK3_SRC1_YAW", int(config.sensors.compass), INT8),
        Parameter("FENCE_ENABLE", 0, INT8),
        Parameter(gcs_switch, 0, INT8),
        Parameter("FS_GCS_TIMEOUT", 5.0),
        *own,
    )
    return Parameters(table, bytewise=False)


# Message ids that are in pymavlink's dialect "all" but not in PX4's dialect.
_UNKNOWN = (
    "53 150-158 160 161 163-186 191 193-195 200 201 214-224 226 420 441 513 516 517 8002-8016"
    " 10001-10008 10151 11000-11005 11010 11011 11020 11030-11044 11060 17000 17150-17158 42000"
    " 42001 50001-50005 52000 52001 60000-60053"
)
PX4_UNKNOWN_IDS = message_ids(_UNKNOWN)

# Rate of PX4's default streams by message id, Hz, as measured. ODOMETRY is left out, because it is
# not used here.
_RATES_HZ = {
    30: 100,
    31: 50,
    33: 50,
    32: 30,
    24: 8,
    74: 10,
    83: 10,
    85: 10,
    105: 50,
    1: 5,
    245: 5,
    111: 10,
    2: 1,
    242: 0.5,
    436: 0.5,
    132: 10,
    147: 0.5,
}
ONBOARD_STREAMS = {number: round(1e6 / rate) for number, rate in _RATES_HZ.items()}
PX4_STREAMABLE = frozenset(ONBOARD_STREAMS) | {
    29,
    36,
    62,
    65,
    105,
    106,
    140,
    141,
    148,
    230,
    241,
    331,
    340,
}


def px4_identity(mav_type: int) -> Identity:
    """Return the identity of PX4 main of 2026-03, 1.17 alpha."""
    return Identity(
        mav_type=mav_type,
        autopilot=12,
        version=0x01110040,
        capabilities=1 | 2 | 4 | 8 | 16 | 64 | 128 | 256 | 2048 | 8192 | 16384 | 32768,
        modes=modes.PX4,
        streamable=PX4_STREAMABLE,
        fastest_us=1_000,
        unknown_ids=PX4_UNKNOWN_IDS,
        default_streams=ONBOARD_STREAMS,
        interval_refusal=Ack.FAILED,
        adopts_strays=False,
        texts_for_gcs_only=True,
        ranges_on_update=True,
    )


def px4_parameters(config: VehicleConfig, *own: Parameter) -> Parameters:
    table = (
        Parameter("MAV_SYS_ID", config.vehicle.system_id, INT32),
        Parameter("MAV_FWDEXTSP", 1, INT32),
        Parameter("COM_OF_LOSS_T", config.vehicle.setpoint_timeout_s or 1.0),
        Parameter("COM_OBL_RC_ACT", 0, INT32),
        Parameter("COM_RC_IN_MODE", 1, INT32),
        Parameter("COM_RC_LOSS_T", 0.5),
        Parameter("COM_RCL_EXCEPT", 0, INT32),
        Parameter("COM_RC_OVERRIDE", 1, INT32),
        Parameter("COM_FAIL_ACT_T", 5.0),
        Parameter("NAV_RCL_ACT", 2, INT32),
        Parameter("NAV_DLL_ACT", 0, INT32),
        Parameter("SYS_AUTOSTART", 4001, INT32),
        *own,
    )
    return Parameters(table, bytewise=True)
