"""What a ranging message says in SI units, or why it says nothing.

Units change in the messages' files: centimetres, millimetres, milliseconds and microseconds end at that door.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import NamedTuple

from circnav_mav.mav.codec import Message


class Reject(Enum):
    """Why a ranging message did not become a sample."""

    WRONG_SOURCE = "wrong_source"
    OTHER_SENSOR = "other_sensor"
    AMBIGUOUS = "ambiguous"
    NOT_FINITE = "not_finite"
    NO_RANGE = "no_range"
    BELOW_MIN = "below_min"
    ABOVE_MAX = "above_max"
    POOR_QUALITY = "poor_quality"
    REPEAT = "repeat"
    OLDER = "older"
    STAMP_JUMP = "stamp_jump"
    CLOCK = "clock"
    TOO_OLD = "too_old"
    TOO_NOISY = "too_noisy"
    FROZEN = "frozen"
    OVERHEAD = "overhead"
    NO_HEIGHT = "no_height"
    GATED = "gated"
    STALLED = "stalled"


OTHERS = frozenset({Reject.WRONG_SOURCE.value, Reject.OTHER_SENSOR.value})
"""What is not ours to take, and no fault of our sensor."""
EXPLAINED = frozenset({Reject.AMBIGUOUS.value, Reject.NO_HEIGHT.value})
"""Reasons that the operator is shown with their remedy as long as they hold."""
_CLOCK = frozenset({Reject.STAMP_JUMP.value, Reject.CLOCK.value})


def describe_rejected(rejected: Mapping[str, int]) -> str:
    """How many ranges were rejected for which reason, for people."""
    counts = (
        f"{count} {reason}{' (sensor clock stepped)' if reason in _CLOCK else ''}" for reason, count in rejected.items()
    )
    return ", ".join(counts) or "none"


@dataclass(frozen=True, slots=True)
class RangingSettings:
    """Which ranging telemetry to use: [ranging] of the mission under its own names, and what the rest tells.

    message: mission name of the message. beacon_id, sensor_id, orientation, name: its filters. system_id, component_id:
    the sender, None for the first that fits. sigma_m: standard deviation to assume when the message carries none.
    max_range_m: largest slant range accepted. max_age: oldest sample taken, s. stamp: whose time is used, the
    message's own ("sensor") or ours ("arrival"). rate_hz: how often the sensor measures. resent: the sender is known to
    repeat values faster than that. max_sigma: standard deviation, reported or measured, m, above which a range is of no
    use. rate_name: the NAMED_VALUE_FLOAT that carries the range rate, None for none. rate_sign: "opening" where it is
    positive away from the target, "closing" where it is positive towards it. rate_sigma_mps: standard deviation to
    assume. listens: False to steer without having listened for a second source.
    """

    message: str = "distance_sensor"
    beacon_id: int | None = None
    sensor_id: int | None = None
    orientation: int | None = None
    name: str = "RANGE"
    system_id: int | None = None
    component_id: int | None = None
    sigma_m: float = 0.5
    max_range_m: float = 10000.0
    max_age: float = 0.5
    stamp: str = "sensor"
    rate_hz: float = 10.0
    resent: bool = False
    max_sigma: float = inf
    rate_name: str | None = None
    rate_sign: str = "opening"
    rate_sigma_mps: float = 0.3
    listens: bool = True


class Reading(NamedTuple):
    """What one message says, in SI units. stamp None: no usable time. sequence None: none carried."""

    slant: float
    sigma: float | None
    stamp: float | None
    sequence: int | None = None


@dataclass(frozen=True, slots=True)
class RangingMessage:
    """A message that can carry the range.

    type, id: in MAVLink. read: what one says; None: it is none of a ranging radio. farthest: longest range, m.
    stamp_wrap: of its own time, s, None where that does not wrap. marks: its fields by which a mission picks the
    sensor, and the mission's keys for them. forwarded: whether autopilots forward it. for_anything: it carries values
    of any kind, and one that was not picked is no range at all. why_never: why settings pick nothing, for people.
    """

    type: str
    id: int
    read: Callable[[Message], Reading | Reject | None]
    farthest: float
    stamp_wrap: float | None
    marks: Mapping[str, str]
    forwarded: bool = True
    for_anything: bool = False
    why_never: Callable[[RangingSettings], str] = lambda settings: ""

    def mark_values(self, message: Message) -> dict[str, int | str]:
        return {mark: getattr(message, mark) for mark in self.marks}

    def picked(self, message: Message, settings: RangingSettings) -> bool:
        """Whether a message is of the sensor that the mission picks."""
        return all(getattr(settings, key) in (None, getattr(message, mark)) for mark, key in self.marks.items())


def boot_stamp(message: Message) -> float | None:
    """time_boot_ms in s; 0 means none."""
    return message.time_boot_ms / 1000 if message.time_boot_ms else None
