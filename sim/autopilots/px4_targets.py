"""SET_POSITION_TARGET_LOCAL_NED and SET_ATTITUDE_TARGET as PX4 reads them (mavlink_receiver.cpp of
2026-03).

In LOCAL_NED each axis is used or ignored separately. In BODY_NED positions are ignored, and a
velocity needs all axes.
"""

import math
from typing import NamedTuple

from ..body import Body, euler, to_earth
from ..demands import Spin, Tilt
from ..links import Message

LOCAL_NED = 1
BODY_NED = 8
ACCELERATION = 0x1C0
FORCE = 0x200
YAW = 0x400
YAW_RATE = 0x800
ROLL_RATE = 0x01
PITCH_RATE = 0x02
BODY_YAW_RATE = 0x04
THROTTLE = 0x40
ATTITUDE = 0x80

Axis = float | None


class Rejected(NamedTuple):
    """A rejected setpoint and the text that is sent to ground stations."""

    text: str


class Trajectory(NamedTuple):
    """Setpoint per axis: NED, m, m/s and m/s^2, rad and rad/s. None: not controlled."""

    position: tuple[Axis, Axis, Axis]
    velocity: tuple[Axis, Axis, Axis]
    acceleration: tuple[Axis, Axis, Axis]
    heading: Axis
    yaw_rate: Axis
    along_nose: tuple[float, float] | None = None  # a BODY_NED velocity before its rotation


NOTHING: tuple[Axis, Axis, Axis] = (None, None, None)


def read_setpoint(message: Message, body: Body) -> Trajectory | Tilt | Spin | Rejected | None:
    """Return the setpoint of a message; None if it has no effect."""
    kind = message.get_type()
    if kind == "SET_POSITION_TARGET_LOCAL_NED":
        return read_local_target(message, body)
    return read_attitude_target(message) if kind == "SET_ATTITUDE_TARGET" else None


def read_local_target(message: Message, body: Body) -> Trajectory | Rejected:
    frame = message.coordinate_frame
    mask = message.type_mask
    along_nose = None
    if frame == LOCAL_NED:
        position = _axes(mask, 0, message.x, message.y, message.z)
        velocity = _axes(mask, 3, message.vx, message.vy, message.vz)
        acceleration = _axes(mask, 6, message.afx, message.afy, message.afz)
    elif frame == BODY_NED:
        position = NOTHING
        velocity = _rotated(_axes(mask, 3, message.vx, message.vy, message.vz), body.heading)
        acceleration = _by_attitude(_axes(mask, 6, message.afx, message.afy, message.afz), body)
        along_nose = (message.vx, message.vy) if velocity[0] is not None else None
    else:
        return Rejected(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported")
    if acceleration != NOTHING and mask & FORCE:
        return Rejected("SET_POSITION_TARGET_LOCAL_NED force not supported")
    if position == velocity == acceleration == NOTHING and not _masked_in(mask, frame):
        return Rejected(
            "SET_POSITION_TARGET_LOCAL_NED invalid, missing position, velocity or acceleration"
        )
    heading = None if mask & YAW else _finite(message.yaw)
    yaw_rate = None if mask & YAW_RATE else _finite(message.yaw_rate)
    return Trajectory(position, velocity, acceleration, heading, yaw_rate, along_nose)


def _masked_in(mask: int, frame: int) -> bool:
    """True if the mask selects at least one axis, even one with a value that is not finite. Such a
    setpoint is accepted but not flown."""
    if frame == BODY_NED:
        return not mask & 0x038 or not mask & ACCELERATION
    return mask & 0x1FF != 0x1FF


def _axes(mask: int, first: int, *values: float) -> tuple[Axis, Axis, Axis]:
    axes = [None if mask >> (first + i) & 1 else _finite(v) for i, v in enumerate(values)]
    return axes[0], axes[1], axes[2]


def _rotated(vector: tuple[Axis, Axis, Axis], heading: float) -> tuple[Axis, Axis, Axis]:
    forward, right, down = vector
    if forward is None or right is None or down is None:
        return NOTHING
    return *to_earth(forward, right, heading), down


def _by_attitude(vector: tuple[Axis, Axis, Axis], body: Body) -> tuple[Axis, Axis, Axis]:
    """Return an acceleration rotated by the whole attitude. (Velocities are rotated by the heading
    only.)"""
    x, y, z = vector
    if x is None or y is None or z is None:
        return NOTHING
    across = y * math.cos(body.roll) - z * math.sin(body.roll)
    below = y * math.sin(body.roll) + z * math.cos(body.roll)
    ahead = x * math.cos(body.pitch) + below * math.sin(body.pitch)
    return _rotated(
        (ahead, across, below * math.cos(body.pitch) - x * math.sin(body.pitch)), body.heading
    )


def _finite(value: float) -> Axis:
    return value if math.isfinite(value) else None


def read_attitude_target(message: Message) -> Tilt | Spin | None:
    """Return the attitude or, if the attitude is masked, the body rates. Roll and pitch rate are
    then required. A masked throttle gives thrust 0."""
    mask = message.type_mask
    none = mask & THROTTLE or not math.isfinite(message.thrust)
    thrust = 0.0 if none else max(0.0, min(1.0, message.thrust))
    rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    q = tuple(message.q)
    size = math.sqrt(sum(v * v for v in q))
    if not mask & ATTITUDE:
        if not (math.isfinite(size) and size > 0.1):
            return None
        roll, pitch, heading = euler(tuple(v / size for v in q))
        yaw_rate = 0.0 if mask & BODY_YAW_RATE or not math.isfinite(rates[2]) else rates[2]
        return Tilt(roll, pitch, heading, yaw_rate, thrust=thrust)
    if mask & (ROLL_RATE | PITCH_RATE) or not all(map(math.isfinite, rates)):
        return None
    return Spin(rates[0], rates[1], 0.0 if mask & BODY_YAW_RATE else rates[2], thrust=thrust)
