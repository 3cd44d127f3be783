"""Final check that every setpoint passes before it is sent. No other module repeats it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import cos, hypot, isfinite
from typing import NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.velocity_loop import MOST_FED
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import YawRate, euler_from_quaternion

SLACK = 1 + 1e-6
"""Factor on limits for the rounding of single precision."""
MAX_CLIMB = 1.0
"""Limit of the climb rate of a velocity setpoint, m/s. circnav holds the height, so it needs only
small climb rates."""
BODY_NED = dialect.MAV_FRAME_BODY_NED


class Steer(NamedTuple):
    """Command to the vehicle: yaw rate (rad/s, clockwise positive) and forward speed (m/s)."""

    yaw_rate: YawRate
    speed: float


class UnsafeSetpointError(Exception):
    """A setpoint that must not be sent. It indicates a fault in circnav or in a user-defined law.
    The flight then ends with the safe setpoint."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of commands.

    max_yaw_rate: rad/s.
    max_speed: m/s.
    max_bank: total tilt of attitude setpoints, rad.
    max_stick: roll stick of MANUAL_CONTROL, thousandths.
    max_pitch_stick, max_yaw_stick: pitch and yaw sticks, thousandths; 0 for vehicles that are not
        pitched or yawed by stick.
    """

    max_yaw_rate: float
    max_speed: float
    max_bank: float = 0.0
    max_stick: float = 1000.0
    max_pitch_stick: float = 0.0
    max_yaw_stick: float = 0.0


class SetpointGuard:
    """Check of setpoints: finite, and within the limits."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits

    def admit(self, steer: Steer, now: float) -> Steer:
        """Return the command unchanged. Raises UnsafeSetpointError for a value that is not finite
        or not in limits."""
        limits = self._limits
        rate = steer.yaw_rate
        if not (isfinite(rate) and isfinite(steer.speed)):
            raise UnsafeSetpointError(f"not finite: {steer}")
        if abs(rate) > limits.max_yaw_rate * (1 + 1e-9) or not 0 <= steer.speed <= limits.max_speed:
            raise UnsafeSetpointError(f"outside the limits {limits}: {steer}")
        return steer

    def check_message(self, message: Message, shapes: frozenset[tuple[str, int | None]]) -> Message:
        """Return the message unchanged if it may be sent. Raises UnsafeSetpointError otherwise.

        Its type and mask must be in the adapter's table, all numbers finite, and the target a
        single vehicle. The commanded speeds, rates and angles must be within the limits.
        """
        shape = (message.get_type(), getattr(message, "type_mask", None))
        if shape not in shapes:
            raise UnsafeSetpointError(
                f"{shape[0]} with mask {shape[1]} is not in the adapter's table"
            )
        values = [getattr(message, name) for name in message.get_fieldnames()]
        if not all(
            isfinite(value if isinstance(value, float | int) else sum(value)) for value in values
        ):
            raise UnsafeSetpointError(f"not finite: {message}")
        within, address = _CHECKS[message.get_type()]
        # A target id of 0 is a broadcast (MAVLink), not permitted in a setpoint.
        if getattr(message, address) == 0 or not within(message, self._limits):
            raise UnsafeSetpointError(f"outside the limits {self._limits}: {message}")
        return message


# --- checks of the speeds, rates and angles that the mask of a message does not ignore


def _velocity_within(message: Message, limits: Limits) -> bool:
    forward = (
        abs(message.vx) <= limits.max_speed * SLACK
        and message.vy == 0
        and message.coordinate_frame == BODY_NED
    )
    # The lateral feedforward is (1 + D) times speed times turn rate. 1.25 permits a derivative gain
    # D of the velocity loop up to 0.25.
    across = 1.25 * limits.max_speed * limits.max_yaw_rate
    fed = (
        hypot(message.afx, message.afy, message.afz) <= hypot(MOST_FED, across) * SLACK
        and message.afx >= 0
    )
    level = abs(message.vz) <= MAX_CLIMB
    turning = abs(message.yaw_rate) <= limits.max_yaw_rate * SLACK
    return bool(forward and fed and level and turning)


def _attitude_within(message: Message, limits: Limits) -> bool:
    roll, pitch, _ = euler_from_quaternion(message.q)
    level = cos(roll) * cos(pitch) >= cos(limits.max_bank * SLACK + 1e-6)
    turns_only = abs(sum(part**2 for part in message.q) - 1) < 1e-3
    return bool(level and turns_only and 0 <= message.thrust <= 1)


def _stick_within(message: Message, limits: Limits) -> bool:
    untouched = message.buttons == message.enabled_extensions == 0
    pitched = abs(message.x) <= limits.max_pitch_stick
    # Both sticks are rounded, so their total may exceed the limit by 1.
    rolled = hypot(message.x, message.y) <= limits.max_stick + (1 if message.x else 0)
    yawed = abs(message.r) <= limits.max_yaw_stick
    return bool(untouched and pitched and rolled and yawed and 0 <= message.z <= 1000)


_CHECKS: Mapping[str, tuple[Callable[[Message, Limits], bool], str]] = {
    "SET_POSITION_TARGET_LOCAL_NED": (_velocity_within, "target_system"),
    "SET_ATTITUDE_TARGET": (_attitude_within, "target_system"),
    "MANUAL_CONTROL": (_stick_within, "target"),
}
"""Check and name of the target field, by message type."""
