"""RANGING_BEACON (513, development.xml), designed for ranging radios: range in mm, stamp in us,
sequence number."""

from circnav_mav.mav.codec import Message
from circnav_mav.mav.ranging.interface import RangingMessage, Reading, Reject

UNKNOWN = (0, 0xFFFFFFFF)
"""Values that mean "not measured" (0 and UINT32_MAX)."""


def _read(message: Message) -> Reading | Reject:
    """Return the reading of a message, which contains range and standard deviation in mm, and
    status bit 0 for a poor signal."""
    if message.range in UNKNOWN:
        return Reject.NO_RANGE
    if message.status & 1:
        return Reject.POOR_QUALITY
    accuracy = message.range_accuracy
    return Reading(
        slant=message.range / 1000,
        sigma=accuracy / 1000 if accuracy not in UNKNOWN else None,
        stamp=message.time_usec / 1e6 if message.time_usec else None,
        sequence=message.sequence,
    )


RANGING_BEACON = RangingMessage(
    type="RANGING_BEACON",
    read=_read,
    farthest=4_294_967.0,
    stamp_wrap=None,
    marks={"beacon_id": "beacon_id"},
    forwarded=False,
)
