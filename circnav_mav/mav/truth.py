"""True state of the bundled vehicle, for the evaluation of flights. Code that steers must not read
it."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.framing import V2

NAME = "SIM_TRUTH"
"""Name of the DEBUG_FLOAT_ARRAY that carries the truth."""
_ID = dialect.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY


def is_truth_frame(frame: bytes) -> bool:
    """True if a complete frame may hold the truth, judged without decoding."""
    return frame[0] == V2 and int.from_bytes(frame[7:10], "little") == _ID


def read_truth_frame(frame: bytes) -> tuple[float, ...] | None:
    """Return the numbers of a truth frame, or None for another frame.

    0, 1: position north and east of home, m. 7: turn rate, rad/s, clockwise positive. 9, 10: target
    north and east of home, m. 15: simulated time, s.
    """
    if is_truth_frame(frame):
        for message in Decoder(wanted={_ID}).decode(frame):  # a damaged frame may contain others
            if message.name == NAME:
                # The emulator fills the first 16 numbers of the array.
                return tuple(message.data[:16])
    return None


def relative_truth(frame: bytes) -> tuple[float, float] | None:
    """Return the position east and north of the target, m, or None if it is not a truth frame."""
    numbers = read_truth_frame(frame)
    return None if numbers is None else (numbers[1] - numbers[10], numbers[0] - numbers[9])
