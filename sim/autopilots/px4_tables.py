"""Who the PX4 vehicles say they are, what they stream, and those of their parameters that matter to a companion."""

from ..config import VehicleConfig
from ..params import INT32, Parameter, Parameters
from .contract import Ack, Identity, message_ids
from .modes import PX4 as MODES

# In pymavlink's "all" but not in PX4's dialect.
_UNKNOWN = (
    "53 150-158 160 161 163-186 191 193-195 200 201 214-224 226 420 441 513 516 517 8002-8016 10001-10008 10151 "
    "11000-11005 11010 11011 11020 11030-11044 11060 17000 17150-17158 42000 42001 50001-50005 52000 52001 60000-60053"
)
UNKNOWN_IDS = message_ids(_UNKNOWN)

# As flown, without ODOMETRY, which nobody here needs.
_RATES_HZ = {
    30: 100, 31: 50, 33: 50, 32: 30, 24: 8, 74: 10, 83: 10, 85: 10, 105: 50, 1: 5, 245: 5, 111: 10, 2: 1, 242: 0.5,
    436: 0.5, 132: 10, 147: 0.5,
}  # fmt: skip
ONBOARD_STREAMS = {number: round(1e6 / rate) for number, rate in _RATES_HZ.items()}
STREAMABLE = frozenset(ONBOARD_STREAMS) | {29, 36, 62, 65, 105, 106, 140, 141, 148, 230, 241, 331, 340}


def px4_identity(mav_type: int) -> Identity:
    """PX4 main of 2026-03, 1.17 alpha."""
    return Identity(
        mav_type=mav_type,
        autopilot=12,
        version=0x01110040,
        capabilities=1 | 2 | 4 | 8 | 16 | 64 | 128 | 256 | 2048 | 8192 | 16384 | 32768,
        modes=MODES,
        streamable=STREAMABLE,
        fastest_us=1_000,
        unknown_ids=UNKNOWN_IDS,
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
