"""The bundled vehicle's truth, to judge flights by; nothing that steers may read it."""

from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.framing import V2

NAME = "SIM_TRUTH"
"""DEBUG_FLOAT_ARRAY under this name carries the truth."""
_ID = 350
"""Message id of DEBUG_FLOAT_ARRAY."""
_NUMBERS = 16
"""Numbers of the truth in it, as the emulator sends them."""


def is_truth_frame(frame: bytes) -> bool:
    """Whether a whole frame may hold the truth, without decoding it."""
    return frame[0] == V2 and int.from_bytes(frame[7:10], "little") == _ID


def read_truth_frame(frame: bytes) -> tuple[float, ...] | None:
    """The numbers of a truth frame, None for any other: 0, 1 north and east of home, m; 7 turn rate, rad/s, clockwise;
    9, 10 the target's north and east, m; 15 simulated time, s."""
    if is_truth_frame(frame):
        for message in Decoder(wanted={_ID}).decode(frame):  # wanted: a damaged frame may have others inside
            if message.name == NAME:
                return tuple(message.data[:_NUMBERS])
    return None


def relative_truth(frame: bytes) -> tuple[float, float] | None:
    """East and north of the target, m, where a frame tells the truth."""
    numbers = read_truth_frame(frame)
    return None if numbers is None else (numbers[1] - numbers[10], numbers[0] - numbers[9])
