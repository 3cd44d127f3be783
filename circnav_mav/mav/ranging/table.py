"""The messages that can carry a range, by their mission names."""

from collections.abc import Mapping
from math import isfinite

from circnav_mav.mav.clocks import BOOT_WRAP
from circnav_mav.mav.codec import Message
from circnav_mav.mav.ranging.interface import RangingMessage, RangingSettings, Reading, Reject, boot_stamp

DOWNWARD = 25
"""MAV_SENSOR_ROTATION_PITCH_270: a height sensor, never a ranging radio."""
UNKNOWN_VARIANCE = (0, 255)
"""255 by the definition; ArduPilot fills in 0 always."""
UNKNOWN = (0, 0xFFFFFFFF)


def _distance_sensor(message: Message) -> Reading | Reject | None:
    """What ArduPilot and PX4 forward; cm, covariance in cm^2, ms since boot; quality 1 means invalid. At or beyond
    max_distance the autopilots send what they have: no range."""
    if message.orientation == DOWNWARD:
        return None
    cm, variance = message.current_distance, message.covariance
    if cm in (0, 65535) or (0 < message.max_distance <= cm):
        return Reject.NO_RANGE
    if cm < message.min_distance:
        return Reject.BELOW_MIN
    if message.signal_quality == 1:
        return Reject.POOR_QUALITY
    sigma = variance**0.5 / 100 if variance not in UNKNOWN_VARIANCE else None
    return Reading(cm / 100, sigma, boot_stamp(message))


def _why_downward_is_never_taken(settings: RangingSettings) -> str:
    if settings.orientation != DOWNWARD:
        return ""
    return f"orientation {DOWNWARD} is downward, a height sensor: it is never taken, choose 24 (up)"


def _named_value_float(message: Message) -> Reading | Reject | None:
    """Metres under an agreed name, ms since boot. NaN and anything not above 0 mean no range."""
    if not isfinite(message.value):
        return Reject.NOT_FINITE
    if message.value <= 0:
        return Reject.NO_RANGE
    return Reading(message.value, None, boot_stamp(message))


def _ranging_beacon(message: Message) -> Reading | Reject | None:
    """Made for ranging radios (development.xml): mm, 1 sigma in mm, us, sequence, status bit 0 = poor signal."""
    if message.range in UNKNOWN:
        return Reject.NO_RANGE
    if message.status & 1:
        return Reject.POOR_QUALITY
    accuracy = message.range_accuracy
    sigma = accuracy / 1000 if accuracy not in UNKNOWN else None
    stamp = message.time_usec / 1e6 if message.time_usec else None
    return Reading(message.range / 1000, sigma, stamp, message.sequence)


RANGING_MESSAGES: Mapping[str, RangingMessage] = {
    "ranging_beacon": RangingMessage(
        type="RANGING_BEACON",
        id=513,
        read=_ranging_beacon,
        farthest=4_294_967.0,
        stamp_wrap=None,
        marks={"beacon_id": "beacon_id"},
        forwarded=False,
    ),
    "distance_sensor": RangingMessage(
        type="DISTANCE_SENSOR",
        id=132,
        read=_distance_sensor,
        farthest=655.34,
        stamp_wrap=BOOT_WRAP,
        marks={"id": "sensor_id", "orientation": "orientation"},
        why_never=_why_downward_is_never_taken,
    ),
    "named_value_float": RangingMessage(
        type="NAMED_VALUE_FLOAT",
        id=251,
        read=_named_value_float,
        farthest=1e6,
        stamp_wrap=BOOT_WRAP,
        marks={"name": "name"},
        for_anything=True,
    ),
}
