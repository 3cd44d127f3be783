"""DISTANCE_SENSOR (132), forwarded by ArduPilot and PX4: range in cm, stamp in ms since boot."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.clocks import BOOT_WRAP
from circnav_mav.mav.codec import Message
from circnav_mav.mav.ranging.interface import (
    RangingMessage,
    RangingSettings,
    Reading,
    Reject,
    boot_stamp,
)

DOWNWARD = dialect.MAV_SENSOR_ROTATION_PITCH_270
"""Orientation of a height sensor, which is never a ranging radio."""
UNKNOWN_VARIANCE = (0, 255)
"""Covariances that mean "unknown": 255 by the message definition, and 0, which ArduPilot always
sends."""


def _read(message: Message) -> Reading | Reject | None:
    """Return the reading of a message, which contains a distance in cm, a covariance in cm^2, and
    signal quality 1 for an invalid range.

    Without a measurement, autopilots send a placeholder at or beyond max_distance.
    """
    if message.orientation == DOWNWARD:
        return None
    cm = message.current_distance
    if cm in (0, 65535) or (0 < message.max_distance <= cm):
        return Reject.NO_RANGE
    if cm < message.min_distance:
        return Reject.BELOW_MIN
    if message.signal_quality == 1:
        return Reject.POOR_QUALITY
    variance = message.covariance
    sigma = variance**0.5 / 100 if variance not in UNKNOWN_VARIANCE else None
    return Reading(cm / 100, sigma, boot_stamp(message))


def _why_never(settings: RangingSettings) -> str:
    if settings.orientation != DOWNWARD:
        return ""
    return (
        f"orientation {DOWNWARD} is downward, a height sensor, which is never used: choose 24 (up)"
    )


DISTANCE_SENSOR = RangingMessage(
    type="DISTANCE_SENSOR",
    read=_read,
    farthest=655.34,
    stamp_wrap=BOOT_WRAP,
    marks={"id": "sensor_id", "orientation": "orientation"},
    why_never=_why_never,
)
