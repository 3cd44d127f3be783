"""Common parts of ArduPilot's vehicles. Signs, masks and timeouts were tested on ArduPilot 4.6.3 in
its simulator."""

from collections.abc import Mapping

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import Firmware
from circnav_mav.mav.autopilots.parameters import (
    PASS,
    WARN,
    Context,
    Judge,
    Name,
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
        dialect.MAVLINK_MSG_ID_RAW_IMU: 25.0,
    },
    mode_numbers=lambda mode: (mode,),
)


def mode_names(enum: str) -> Mapping[int, str]:
    """Return custom_mode -> name for a MAVLink enum of modes. Pilots write FBWA, not
    FLY_BY_WIRE_A."""
    *modes, _ = dialect.enums[enum].items()  # the last entry is the end of the enum
    return {
        number: entry.name.removeprefix(f"{enum}_").replace("FLY_BY_WIRE_", "FBW")
        for number, entry in modes
    }


def gcs_failsafe(what_follows: str) -> Judge:
    """Return a judge of FS_GCS_ENABLE. what_follows: action of the vehicle after the loss of the
    ground station."""
    lost = (
        f"without a ground station's heartbeat {what_follows}; ours does not count, so keep the"
        " station connected"
    )
    return one_of({0: (PASS, "no ground-station failsafe")}, (WARN, lost))


def ekf_action(what_follows: str) -> Judge:
    """Return a judge of FS_EKF_ACTION. what_follows: action of the vehicle, which leaves GUIDED."""
    none = (
        "no action when the position estimate fails: the flight may continue without a speed"
        " estimate"
    )
    leaves = (
        f"if the position estimate fails in GUIDED, the vehicle {what_follows}: the flight ends as"
        " a takeover"
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


COMPASSES = ("COMPASS_USE", "COMPASS_USE2", "COMPASS_USE3")
"""Parameters that let the heading use the first, second and third compass."""
_DRIFTS = "so the heading drifts without GPS, and the flight may end early"


def _compass(value: float, context: Context) -> Verdict:
    """Judge COMPASS_USE. The heading needs one of three compasses."""
    used = [name for name in COMPASSES if context.values.get(name)]
    if context.values.get("COMPASS_ENABLE") == 0:
        return WARN, f"COMPASS_ENABLE = 0, {_DRIFTS}: set that to 1, and calibrate the compass"
    if used:
        return PASS, f"the heading may use a compass ({', '.join(used)})"
    return WARN, f"no compass is used, {_DRIFTS}: set it to 1, and calibrate the compass"


_HEADING_SOURCES = {
    1: (PASS, "heading by compass"),
    2: (WARN, f"heading by GPS alone, {_DRIFTS}: set 3 (GPS, else compass)"),
    3: (PASS, "heading by GPS, and by compass without GPS"),
    6: (PASS, "heading by external navigation"),
}
HEADING = (
    Rule((Name("COMPASS_USE"),), _compass, optional=True, also=("COMPASS_ENABLE", *COMPASSES[1:])),
    rule(
        "EK3_SRC1_YAW",
        one_of(_HEADING_SOURCES, (WARN, f"heading without a compass, {_DRIFTS}: set 1")),
        optional=True,
    ),
)
"""Rules for the source of the heading."""
_FENCE_ON = (WARN, "a fence is active: if the circle reaches it, its action ends the flight")
GCS_SYSTEM = Rule(
    (Name("MAV_GCS_SYSID", since="4.7"), Name("SYSID_MYGCS", until="4.6")), _gcs_system
)
FENCE = rule("FENCE_ENABLE", one_of({0: (PASS, "no fence")}, _FENCE_ON), optional=True)
