"""The choke point: every setpoint that leaves the process passes here, and nothing else checks for it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import hypot, isfinite, radians
from typing import NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import MOST_FED
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import YawRate, euler_from_quaternion

SLACK = 1 + 1e-6
"""Single precision."""
MOST_DAMPED = 1.25
"""Acceleration to the side, in units of speed times turn rate, for a loop that damps what comes of it."""
MAX_PITCH, MAX_CLIMB = radians(15), 1.0
"""Pitch of an attitude setpoint, rad, and climb rate of a velocity setpoint, m/s: height is held, not changed."""
EVERYBODY = 0
"""Target id of a broadcast (MAVLink), which no setpoint may have."""
BODY_NED = dialect.MAV_FRAME_BODY_NED


class Steer(NamedTuple):
    """What the vehicle shall do: yaw rate (rad/s, clockwise positive) and forward speed (m/s)."""

    yaw_rate: YawRate
    speed: float


class UnsafeSetpointError(Exception):
    """A setpoint that must not leave. Ours to mend, so it is loud; the pilot answers with the safe setpoint."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What may be commanded. max_yaw_rate in rad/s, max_speed in m/s, max_bank in rad (of attitude setpoints),
    max_stick in thousandths (of MANUAL_CONTROL)."""

    max_yaw_rate: float
    max_speed: float
    max_bank: float = 0.0
    max_stick: float = 1000.0


class SetpointGuard:
    """The one exit for setpoints: finite, and within the limits."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits

    def admit(self, steer: Steer, now: float) -> Steer:
        """The steer as it may be flown. Raises UnsafeSetpointError for a number that no vehicle must see."""
        limits, rate = self._limits, steer.yaw_rate
        if not (isfinite(rate) and isfinite(steer.speed)):
            raise UnsafeSetpointError(f"not finite: {steer}")
        if abs(rate) > limits.max_yaw_rate * (1 + 1e-9) or not 0 <= steer.speed <= limits.max_speed:
            raise UnsafeSetpointError(f"outside the limits {limits}: {steer}")
        return steer

    def check_message(self, message: Message, shapes: frozenset[tuple[str, int | None]]) -> Message:
        """The message as it will leave, if its type and mask stand in the adapter's table, all its numbers are finite,
        it speaks to one vehicle, and what it makes that one do is within the limits. Raises UnsafeSetpointError."""
        shape = (message.get_type(), getattr(message, "type_mask", None))
        if shape not in shapes:
            raise UnsafeSetpointError(f"{shape[0]} with mask {shape[1]} is not in the adapter's table")
        values = [getattr(message, name) for name in message.get_fieldnames()]
        if not all(isfinite(value if isinstance(value, float | int) else sum(value)) for value in values):
            raise UnsafeSetpointError(f"not finite: {message}")
        within, address = _CHECKS[message.get_type()]
        if getattr(message, address) == EVERYBODY or not within(message, self._limits):
            raise UnsafeSetpointError(f"outside the limits {self._limits}: {message}")
        return message


# --- whether the speeds, rates and angles that a message commands are within the limits: all that its mask lets through


def _velocity_within(message: Message, limits: Limits) -> bool:
    forward = abs(message.vx) <= limits.max_speed * SLACK and message.vy == 0 and message.coordinate_frame == BODY_NED
    across = MOST_DAMPED * limits.max_speed * limits.max_yaw_rate
    fed = hypot(message.afx, message.afy, message.afz) <= hypot(MOST_FED, across) * SLACK and message.afx >= 0
    level = abs(message.vz) <= MAX_CLIMB
    turning = abs(message.yaw_rate) <= limits.max_yaw_rate * SLACK
    return bool(forward and fed and level and turning)


def _attitude_within(message: Message, limits: Limits) -> bool:
    roll, pitch, _ = euler_from_quaternion(message.q)
    level = abs(roll) <= limits.max_bank * SLACK + 1e-6 and abs(pitch) <= MAX_PITCH * SLACK + 1e-6
    turns_only = abs(sum(part**2 for part in message.q) - 1) < 1e-3
    return bool(level and turns_only and 0 <= message.thrust <= 1)


def _stick_within(message: Message, limits: Limits) -> bool:
    untouched = message.x == message.r == message.buttons == message.enabled_extensions == 0
    return bool(untouched and abs(message.y) <= limits.max_stick and 0 <= message.z <= 1000)


_CHECKS: Mapping[str, tuple[Callable[[Message, Limits], bool], str]] = {
    "SET_POSITION_TARGET_LOCAL_NED": (_velocity_within, "target_system"),
    "SET_ATTITUDE_TARGET": (_attitude_within, "target_system"),
    "MANUAL_CONTROL": (_stick_within, "target"),
}
"""By message type: its check, and the field that says whom it is for."""
