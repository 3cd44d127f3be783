"""Common parts of ArduPilot's vehicles. Signs, masks and timeouts were tested on ArduPilot 4.6.3 in
its simulator."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import Firmware
from circnav_mav.mav.autopilots.parameters import (
    PASS,
    WARN,
    Context,
    Judge,
    Rule,
    Verdict,
    one_of,
    rule,
)

ARDUPILOT = Firmware(
    key="ardupilot",
    autopilot=dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
    flown="ArduPilot 4.6.3",
    streams={
        dialect.MAVLINK_MSG_ID_HEARTBEAT: (
            4.0
        ),  # more often than 1 Hz, for early detection of a takeover
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
        dialect.MAVLINK_MSG_ID_ATTITUDE: 20.0,  # plane and rover reject more than about 40 Hz
        dialect.MAVLINK_MSG_ID_VFR_HUD: 5.0,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
        dialect.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
        dialect.MAVLINK_MSG_ID_RAW_IMU: 25.0,
    },
    mode_numbers=lambda mode: (mode,),
)


def gcs_failsafe(what_follows: str) -> Judge:
    """Return a judge of FS_GCS_ENABLE. what_follows: action of the vehicle after the loss of the
    ground station."""
    lost = (
        f"without a ground station's heartbeat {what_follows}; ours does not count, so keep the"
        " station connected"
    )
    return one_of({0: (PASS, "no ground-station failsafe")}, (WARN, lost))


def ekf_action(what_follows: str) -> Judge:
    """Return a judge of FS_EKF_ACTION. what_follows: action of the vehicle after it has left
    GUIDED."""
    none = (
        "no action when the position estimate fails: the flight may continue without a speed"
        " estimate"
    )
    leaves = (
        f"when the position estimate fails, the vehicle leaves GUIDED and {what_follows}: the"
        " flight ends as a takeover"
    )
    return one_of({0: (WARN, none)}, (PASS, leaves))


def _gcs_system(value: float, context: Context) -> Verdict:
    if value == context.system:
        hides = "our heartbeat would hide the loss of the ground station"
        return WARN, f"the vehicle's system id, which circnav uses, too: {hides}"
    return (
        PASS,
        (
            "the system id of the ground station; circnav uses that of the vehicle, so the failsafe"
            " ignores our heartbeat"
        ),
    )


_FENCE_ON = (WARN, "a fence is active: if the circle reaches it, its action ends the flight")
GCS_SYSTEM = Rule((("MAV_GCS_SYSID", 1.0), ("SYSID_MYGCS", 1.0)), _gcs_system)
FENCE = rule("FENCE_ENABLE", one_of({0: (PASS, "no fence")}, _FENCE_ON), optional=True)
