"""Reading of a ranging message in SI units, or the reason for its rejection.

The file of each message converts its units (centimeters, millimeters, milliseconds, microseconds).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from typing import NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Message
from circnav_mav.mav.ranging.calibration import Calibration


class Reject(Enum):
    """Reason why a ranging message did not become a sample."""

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
"""Reasons to reject messages of other sensors. Such rejections do not indicate a fault of our
sensor."""
EXPLAINED = frozenset({Reject.AMBIGUOUS.value, Reject.NO_HEIGHT.value})
"""Reasons that are shown to the operator with their remedy while they apply."""
RATE_SIGMA = 0.3
"""Assumed standard deviation of a measured range rate, m/s, until the noise is measured in
flight."""
_MEANING = {
    Reject.GATED.value: " (outliers)",
    Reject.STAMP_JUMP.value: " (sensor clock stepped)",
    Reject.CLOCK.value: " (sensor clock stepped)",
}


def describe_rejected(rejected: Mapping[str, int]) -> str:
    """Return the number of rejected ranges by reason, human-readable."""
    counts = (f"{count} {reason}{_MEANING.get(reason, '')}" for reason, count in rejected.items())
    return ", ".join(counts) or "none"


@dataclass(frozen=True, slots=True)
class RangingSettings:
    """Selection of the ranging telemetry: keys of [ranging] in the mission, and values derived from
    other sections.

    message: mission name of the message.
    beacon_id, sensor_id, orientation, name: required values of the message's fields, None for any.
    system_id, component_id: ids of the sender, None for the first sender that fits.
    sigma_m: standard deviation of a range, m, if the message contains none.
    max_age: largest age of an accepted sample, s.
    stamp: time of a range: "sensor" for the stamp in the message, "arrival" for the arrival time.
    rate_hz: measurement rate of the sensor, Hz.
    max_sigma: largest usable standard deviation, reported or measured, m.
    rate_name: name of the NAMED_VALUE_FLOAT with the range rate, or None.
    rate_sign: "opening" if the rate is positive away from the target, "closing" if it is positive
        toward the target.
    listens: False to steer without first waiting for a second source.
    calibration: error of the radio, removed from each reading.
    apart: True if the ranges arrive on a link of their own, without the vehicle.
    """

    message: str = "distance_sensor"
    beacon_id: int | None = None
    sensor_id: int | None = None
    orientation: int | None = None
    name: str = "RANGE"
    system_id: int | None = None
    component_id: int | None = None
    sigma_m: float = 0.5
    max_age: float = 0.5
    stamp: str = "sensor"
    rate_hz: float = 10.0
    max_sigma: float = inf
    rate_name: str | None = None
    rate_sign: str = "opening"
    listens: bool = True
    calibration: Calibration = field(default_factory=Calibration)
    apart: bool = False


class Reading(NamedTuple):
    """Content of one message in SI units.

    slant: measured (slant) range, m.
    sigma: standard deviation, m, None if the message contains none.
    stamp: time of the sender's clock, s, None if the message contains no usable time.
    sequence: sequence number, None if the message contains none.
    """

    slant: float
    sigma: float | None
    stamp: float | None
    sequence: int | None = None

    def calibrated(self, calibration: Calibration) -> "Reading":
        """Return the reading with the true range instead of the reported range, m. The true range
        may be negative."""
        slant, slope = calibration.true(self.slant)
        return self._replace(slant=slant, sigma=None if self.sigma is None else self.sigma * slope)


@dataclass(frozen=True, slots=True)
class RangingMessage:
    """A message type that can carry the range.

    type: name of the message in MAVLink.
    read: returns the reading, the reason for a rejection, or None if the message is not from a
        ranging radio.
    farthest: longest plausible range, m.
    stamp_wrap: period of its time stamps, s, None if they do not wrap.
    marks: fields that select the sensor, with their mission keys.
    forwarded: True if autopilots forward it.
    for_anything: True if the message type is used for values of any kind, so that only a message
        that the mission selects is a range.
    why_never: returns the human-readable reason why the settings can select no message, or empty.
    """

    type: str
    read: Callable[[Message], Reading | Reject | None]
    farthest: float
    stamp_wrap: float | None
    marks: Mapping[str, str]
    forwarded: bool = True
    for_anything: bool = False
    why_never: Callable[[RangingSettings], str] = lambda settings: ""

    @property
    def id(self) -> int:
        """Id of the message in MAVLink."""
        return int(getattr(dialect, f"MAVLINK_MSG_ID_{self.type}"))

    def mark_values(self, message: Message) -> dict[str, int | str]:
        return {mark: getattr(message, mark) for mark in self.marks}

    def picked(self, message: Message, settings: RangingSettings) -> bool:
        """True if a message is from the sensor that the mission selects."""
        return all(
            getattr(settings, key) in (None, getattr(message, mark))
            for mark, key in self.marks.items()
        )


def boot_stamp(message: Message) -> float | None:
    """Return time_boot_ms in s, or None if it is 0."""
    return message.time_boot_ms / 1000 if message.time_boot_ms else None
