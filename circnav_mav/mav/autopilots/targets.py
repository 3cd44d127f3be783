"""The setpoint messages, filled in one place: what the masks leave out is sent as zero."""

from dataclasses import dataclass
from math import atan

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import GRAVITY, quaternion_from_euler
from circnav_mav.mav.own_motion import Motion

VELOCITY_AND_YAW_RATE = 0x5C7
"""SET_POSITION_TARGET_LOCAL_NED: ignore position (bits 0..2), acceleration (6..8) and yaw (10); use all three
velocities (3..5: masking any one masks all on Copter and PX4) and yaw rate (11)."""
COPTER_TYPES = frozenset(
    getattr(dialect, f"MAV_TYPE_{kind}")
    for kind in ("QUADROTOR", "COAXIAL", "HELICOPTER", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "DODECAROTOR")
)
PLANE_TYPES = frozenset((dialect.MAV_TYPE_FIXED_WING,))


@dataclass(frozen=True, slots=True)
class Addressee:
    """Whom a setpoint is for, and what may be used beside the command.

    target_system, target_component: its ids. motion: what is known of the vehicle's own motion. height: altitude to
    hold, m above sea level, None when the vehicle holds it or nothing is known. drag: of a copter, 1/s, as learnt.
    """

    target_system: int
    target_component: int
    motion: Motion
    height: float | None
    drag: float = 0.0


def body_velocity(
    mask: int,
    to: Addressee,
    now: float,
    *,
    forward: float,
    down: float = 0.0,
    yaw_rate: float,
    fed: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED in BODY_NED: forward and down speed (m/s), yaw rate (rad/s, clockwise positive),
    fed acceleration forward, right and down in the body frame (m/s^2)."""
    return dialect.MAVLink_set_position_target_local_ned_message(
        our_boot_ms(now),
        to.target_system,
        to.target_component,
        dialect.MAV_FRAME_BODY_NED,
        mask,
        *(0.0, 0.0, 0.0),
        *(forward, 0.0, down),
        *fed,
        0.0,
        yaw_rate,
    )


def attitude(mask: int, to: Addressee, now: float, *, roll: float, pitch: float = 0.0, thrust: float = 0.0) -> Message:
    """SET_ATTITUDE_TARGET: roll and pitch in rad (right and nose-up positive), thrust 0..1, no rates, yaw 0."""
    return dialect.MAVLink_set_attitude_target_message(
        our_boot_ms(now),
        to.target_system,
        to.target_component,
        mask,
        quaternion_from_euler(roll, pitch, 0.0),
        *(0.0, 0.0, 0.0),
        thrust,
    )


def coordinated_bank(yaw_rate: float, airspeed: float, max_bank: float) -> float:
    """Bank of a coordinated turn, rad, right positive: atan(w V/g), cut to +-max_bank."""
    return min(max(atan(yaw_rate * airspeed / GRAVITY), -max_bank), max_bank)
