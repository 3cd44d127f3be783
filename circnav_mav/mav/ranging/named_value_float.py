"""NAMED_VALUE_FLOAT (251): range in meters under the name `ranging.name`, stamp in ms since
boot."""

from math import isfinite

from circnav_mav.mav.clocks import BOOT_WRAP
from circnav_mav.mav.codec import Message
from circnav_mav.mav.ranging.interface import RangingMessage, Reading, Reject, boot_stamp


def _read(message: Message) -> Reading | Reject:
    """Return the reading of a message. A NaN or a value not above 0 is not a range."""
    if not isfinite(message.value):
        return Reject.NOT_FINITE
    if message.value <= 0:
        return Reject.NO_RANGE
    return Reading(message.value, None, boot_stamp(message))


NAMED_VALUE_FLOAT = RangingMessage(
    type="NAMED_VALUE_FLOAT",
    read=_read,
    farthest=1e6,
    stamp_wrap=BOOT_WRAP,
    marks={"name": "name"},
    for_anything=True,
)
