"""The choke point: every setpoint that leaves the process passes here, and nothing else checks for it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import YawRate, euler_from_quaternion


class Steer(NamedTuple):
    """What the vehicle shall do: yaw rate (rad/s, clockwise positive) and forward speed (m/s)."""

    yaw_rate: YawRate
    speed: float


class UnsafeSetpointError(Exception):
    """A setpoint that must not leave. Ours to mend, so it is loud; the pilot answers with the safe setpoint."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a vehicle may be told. max_yaw_rate in rad/s, max_speed in m/s, max_yaw_acceleration in rad/s^2 or None,
    max_bank and max_pitch (of attitude setpoints) in rad, max_climb (of velocity setpoints) in m/s."""

    max_yaw_rate: float
    max_speed: float
    max_yaw_acceleration: float | None = None
    max_bank: float = 0.0
    max_pitch: float = 0.0
    max_climb: float = 0.0


class SetpointGate:
    """Lets finite setpoints within limits through, slewed where the mission asks for it."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._last: tuple[float, YawRate] | None = None

    def admit(self, steer: Steer, now: float) -> Steer:
        """The steer as it may be flown. Raises UnsafeSetpointError for a number that no vehicle must see."""
        limits = self._limits
        if not (isfinite(steer.yaw_rate) and isfinite(steer.speed)):
            raise UnsafeSetpointError(f"not finite: {steer}")
        if abs(steer.yaw_rate) > limits.max_yaw_rate * (1 + 1e-9) or not 0 <= steer.speed <= limits.max_speed:
            raise UnsafeSetpointError(f"outside the limits {limits}: {steer}")
        yaw_rate = self._slewed(steer.yaw_rate, now)
        self._last = (now, yaw_rate)
        return Steer(yaw_rate, steer.speed)

    def check_message(self, message: Message, shapes: frozenset[tuple[str, int | None]]) -> Message:
        """The message as it will leave, if its type and mask stand in the adapter's table, all its numbers are finite,
        and what it makes the vehicle do is within the limits. Raises UnsafeSetpointError."""
        shape = (message.get_type(), getattr(message, "type_mask", None))
        if shape not in shapes:
            raise UnsafeSetpointError(f"{shape[0]} with mask {shape[1]} is not in the adapter's table")
        if not all(map(isfinite, _numbers(message))):
            raise UnsafeSetpointError(f"not finite: {message}")
        if not _within(message, self._limits):
            raise UnsafeSetpointError(f"outside the limits {self._limits}: {message}")
        return message

    def reset(self) -> None:
        """Forget the last setpoint: the next one starts a stream."""
        self._last = None

    def _slewed(self, wanted: YawRate, now: float) -> YawRate:
        limit = self._limits.max_yaw_acceleration
        if limit is None or self._last is None:
            return wanted
        then, before = self._last
        reach = limit * max(now - then, 0.0)
        return YawRate(min(max(wanted, before - reach), before + reach))


def _within(message: Message, limits: Limits) -> bool:
    """Whether the speeds, rates and angles that a message commands are within the limits."""
    slack = 1 + 1e-6  # single precision
    if message.get_type() == "SET_ATTITUDE_TARGET":
        roll, pitch, _ = euler_from_quaternion(message.q)
        level = abs(roll) <= limits.max_bank * slack + 1e-6 and abs(pitch) <= limits.max_pitch * slack + 1e-6
        return bool(level and 0 <= message.thrust <= 1)
    if message.get_type() == "MANUAL_CONTROL":
        return bool(abs(message.y) <= 1000 and message.x == 0 and message.r == 0 and 0 <= message.z <= 1000)
    fast = abs(message.vx) <= limits.max_speed * slack and message.vy == 0 and abs(message.vz) <= limits.max_climb
    return bool(fast and abs(message.yaw_rate) <= limits.max_yaw_rate * slack)


def _numbers(message: Message) -> Iterator[float]:
    """Every number in a message, those in its arrays too."""
    for name in message.get_fieldnames():
        value = getattr(message, name)
        if isinstance(value, list | tuple):
            yield from value
        else:
            yield value
