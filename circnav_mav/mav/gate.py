"""The choke point: every setpoint that leaves the process passes here, and nothing else checks for it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import YawRate


class Steer(NamedTuple):
    """What the vehicle shall do: yaw rate (rad/s, clockwise positive) and forward speed (m/s)."""

    yaw_rate: YawRate
    speed: float


class UnsafeSetpointError(Exception):
    """A setpoint that must not leave. Ours to mend, so it is loud; the pilot answers with the safe setpoint."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a vehicle may be told. max_yaw_rate in rad/s, max_speed in m/s, max_yaw_acceleration in rad/s^2 or None."""

    max_yaw_rate: float
    max_speed: float
    max_yaw_acceleration: float | None = None


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

    def check_message(self, message: Message, shapes: frozenset[tuple[str, int]]) -> Message:
        """The message itself, if its type and mask stand in the adapter's table and all its numbers are finite."""
        if (message.get_type(), message.type_mask) not in shapes:
            raise UnsafeSetpointError(
                f"{message.get_type()} with mask {message.type_mask:#x} is not in the adapter's table"
            )
        if not all(map(isfinite, _numbers(message))):
            raise UnsafeSetpointError(f"not finite: {message}")
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


def _numbers(message: Message) -> Iterator[float]:
    """Every number in a message, those in its arrays too."""
    for name in message.get_fieldnames():
        value = getattr(message, name)
        if isinstance(value, list | tuple):
            yield from value
        else:
            yield value
