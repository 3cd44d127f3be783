"""SET_ATTITUDE_TARGET as ArduPlane 4.6.3 reads it (GCS_Mavlink.cpp, handle_set_attitude_target).

The ignore bits only select what is forced: roll when its rate bit or the attitude bit is clear, pitch likewise,
throttle when its bit is clear. Body rates are never used, throttle alone is nothing.
"""

import math
from typing import NamedTuple

from sim.body import euler
from sim.wire import Message

ROLL_RATE, PITCH_RATE, THROTTLE, ATTITUDE = 0x01, 0x02, 0x40, 0x80


class Forced(NamedTuple):
    """What a companion forces; None is left to the autopilot."""

    roll: float | None
    pitch: float | None
    throttle: float | None


def read_attitude_target(message: Message) -> Forced | None:
    mask = message.type_mask
    q = tuple(message.q)
    size = sum(v * v for v in q)
    if not math.isfinite(size) or size <= 0 or not math.isfinite(message.thrust):
        return None
    roll, pitch, _ = euler(tuple(v / math.sqrt(size) for v in q))
    whole = not mask & ATTITUDE
    forced = Forced(
        roll=roll if whole or not mask & ROLL_RATE else None,
        pitch=pitch if whole or not mask & PITCH_RATE else None,
        throttle=message.thrust if not mask & THROTTLE else None,
    )
    return forced if forced.roll is not None or forced.pitch is not None else None
