"""The messages that can carry a range: what each says in SI units, or why it says nothing.

Units change here: centimetres, millimetres, milliseconds and microseconds end at this door.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite

from circnav_mav.mav.codec import Message

UINT32_MAX = 0xFFFFFFFF
DOWNWARD = 25
"""MAV_SENSOR_ROTATION_PITCH_270: a height sensor, never a ranging radio."""


class Reject(Enum):
    """Why a ranging message did not become a sample."""

    WRONG_SOURCE = "wrong_source"
    OTHER_SENSOR = "other_sensor"
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
    OVERHEAD = "overhead"
    NO_HEIGHT = "no_height"
    GATED = "gated"
    STALLED = "stalled"


OTHERS = frozenset({Reject.WRONG_SOURCE.value, Reject.OTHER_SENSOR.value})
"""What is not ours to take, and no fault of our sensor."""
_CLOCKS = frozenset({Reject.STAMP_JUMP.value, Reject.CLOCK.value})


def describe_rejected(rejected: Mapping[str, int]) -> str:
    """How many ranges were rejected for which reason, for people."""
    told = (
        f"{count} {reason}{' (sensor clock stepped)' if reason in _CLOCKS else ''}"
        for reason, count in rejected.items()
    )
    return ", ".join(told) or "none"


@dataclass(frozen=True, slots=True)
class RangingSettings:
    """Which ranging telemetry to believe.

    message: mission name of the message. beacon_id, sensor_id, orientation, name: its filters. system, component: the
    sender, None for the first that fits. sigma: standard deviation to assume, m, when the message carries none.
    min_range, max_range: slant range believed, m. max_age: oldest sample taken, s. sensor_stamps: whether the message's
    own time is used. rate: how often the sensor measures, Hz. resent: the sender is known to repeat values faster than
    that. max_sigma: standard deviation, said or measured, m, above which a range is of no use.
    """

    message: str = "distance_sensor"
    beacon_id: int = 0
    sensor_id: int | None = None
    orientation: int | None = None
    name: str = "RANGE"
    system: int | None = None
    component: int | None = None
    sigma: float = 0.5
    min_range: float = 0.0
    max_range: float = 10000.0
    max_age: float = 0.5
    sensor_stamps: bool = True
    rate: float = 10.0
    resent: bool = False
    max_sigma: float = inf


@dataclass(frozen=True, slots=True)
class Reading:
    """What one message says, in SI units. stamp None: no usable time. sequence None: none carried."""

    slant: float
    sigma: float | None
    stamp: float | None
    sequence: int | None = None


def _ranging_beacon(message: Message, settings: RangingSettings) -> Reading | Reject | None:
    """RANGING_BEACON (513): mm, 1 sigma in mm, sequence, status bit 0 = poor signal; development.xml."""
    if message.beacon_id != settings.beacon_id:
        return Reject.OTHER_SENSOR
    if message.range in (0, UINT32_MAX):
        return Reject.NO_RANGE
    if message.status & 1:
        return Reject.POOR_QUALITY
    accuracy = message.range_accuracy
    return Reading(
        slant=message.range / 1000,
        sigma=accuracy / 1000 if accuracy not in (0, UINT32_MAX) else None,
        stamp=message.time_usec / 1e6 if message.time_usec else None,
        sequence=message.sequence,
    )


def _distance_sensor(message: Message, settings: RangingSettings) -> Reading | Reject | None:
    """DISTANCE_SENSOR (132): cm; covariance in cm^2, of which 0 and 255 mean unknown; quality 1 means invalid.

    A downward sensor measures height. At or beyond max_distance the autopilots send what they have: no range.
    """
    wrong_id = settings.sensor_id is not None and message.id != settings.sensor_id
    wrong_way = settings.orientation is not None and message.orientation != settings.orientation
    if message.orientation == DOWNWARD:
        return None
    if wrong_id or wrong_way:
        return Reject.OTHER_SENSOR
    cm = message.current_distance
    if cm in (0, 65535) or (0 < message.max_distance <= cm):
        return Reject.NO_RANGE
    if cm < message.min_distance:
        return Reject.BELOW_MIN
    if message.signal_quality == 1:
        return Reject.POOR_QUALITY
    variance = message.covariance
    return Reading(
        slant=cm / 100,
        sigma=variance**0.5 / 100 if variance not in (0, 255) else None,
        stamp=message.time_boot_ms / 1000 if message.time_boot_ms else None,
    )


def _named_value_float(message: Message, settings: RangingSettings) -> Reading | Reject | None:
    """NAMED_VALUE_FLOAT (251): metres under an agreed name; NaN and anything not above 0 mean no range."""
    name = message.name if isinstance(message.name, str) else message.name.decode("ascii", "replace")
    if name != settings.name:
        return None
    if not isfinite(message.value):
        return Reject.NOT_FINITE
    if message.value <= 0:
        return Reject.NO_RANGE
    return Reading(message.value, None, message.time_boot_ms / 1000 if message.time_boot_ms else None)


Read = Callable[[Message, RangingSettings], Reading | Reject | None]


@dataclass(frozen=True, slots=True)
class RangingMessage:
    """A message that can carry the range: MAVLink type and id, reader, farthest range (m), wrap of its stamp (s)."""

    type: str
    id: int
    read: Read
    farthest: float
    stamp_wrap: float | None


RANGING_MESSAGES: Mapping[str, RangingMessage] = {
    "ranging_beacon": RangingMessage("RANGING_BEACON", 513, _ranging_beacon, 4_294_967.0, None),
    "distance_sensor": RangingMessage("DISTANCE_SENSOR", 132, _distance_sensor, 655.34, 2**32 / 1000),
    "named_value_float": RangingMessage("NAMED_VALUE_FLOAT", 251, _named_value_float, 1e6, 2**32 / 1000),
}
"""The messages by their mission names."""
