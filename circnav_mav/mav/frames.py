"""Conversions between frames and sign conventions. Each function is named after its two frames.

Guidance: counter-clockwise positive (the paper: x east, y north, angles from x). MAVLink: clockwise
positive (NED: heading from north). No other module negates an angle or a turn rate.
"""

from collections.abc import Sequence
from math import asin, atan, atan2, cos, pi, sin, tan
from typing import NewType

from circnav_mav.guidance.types import GRAVITY, TurnRate

YawRate = NewType("YawRate", float)
"""Yaw rate in rad/s, clockwise positive seen from above (MAVLink's NED frame)."""


def yaw_rate_from_turn_rate(turn_rate: TurnRate) -> YawRate:
    """Convert counter-clockwise positive to clockwise positive, rad/s."""
    return YawRate(-turn_rate)


def turn_rate_from_yaw_rate(yaw_rate: YawRate) -> TurnRate:
    """Convert clockwise positive to counter-clockwise positive, rad/s."""
    return TurnRate(-yaw_rate)


def heading_enu_from_yaw_ned(yaw: float) -> float:
    """Convert a NED heading (clockwise from north) to the paper's psi (counter-clockwise from
    east), rad in (-pi, pi].

    Accepts arrays.
    """
    return pi - (pi / 2 + yaw) % (2 * pi)


def thrust_acceleration_from_tilt(roll: float, pitch: float) -> complex:
    """Return the horizontal acceleration (forward + j left of the nose, m/s^2) of a thrust that
    balances the weight.

    roll: right positive, rad.
    pitch: nose up positive, rad.
    """
    return complex(-GRAVITY * tan(pitch), -GRAVITY * tan(roll) / cos(pitch))


def level_from_body(
    force: tuple[float, float, float], roll: float, pitch: float
) -> tuple[float, float]:
    """Return the horizontal acceleration (forward, right of the nose, m/s^2) for a specific force
    in the body frame.

    force: forward, right, down, m/s^2. roll, pitch: rad. Gravity has no horizontal component.
    """
    x, y, z = force
    return cos(pitch) * x + sin(pitch) * (sin(roll) * y + cos(roll) * z), cos(roll) * y - sin(
        roll
    ) * z


def drag_from_body(force: tuple[float, float], roll: float, pitch: float) -> complex:
    """Return the horizontal drag (forward + j left of the nose, m/s^2) of a multicopter.

    force: specific force along the body's forward and right axes, m/s^2, which contains no thrust.
    roll, pitch: rad.
    """
    forward = force[0] / cos(pitch)
    right = (force[1] - sin(roll) * sin(pitch) * forward) / cos(roll)
    return complex(forward, -right)


def pitch_from_thrust(thrust_acceleration: float) -> float:
    """Return the pitch (nose up positive, rad) of a thrust that balances the weight and pushes
    forward by `thrust_acceleration`, m/s^2."""
    return -atan(thrust_acceleration / GRAVITY)


def roll_from_thrust(right: float, pitch: float) -> float:
    """Return the roll (right positive, rad) of a thrust that balances the weight and pushes to the
    right, m/s^2, at a pitch (rad)."""
    return atan(right * cos(pitch) / GRAVITY)


def body_from_level(
    forward: float, right: float, roll: float, pitch: float
) -> tuple[float, float, float]:
    """Return a horizontal vector (forward, right of the nose) in the body frame (forward, right,
    down).

    roll, pitch: rad. Rotation back by the whole attitude gives the horizontal vector again.
    """
    x = forward * cos(pitch)
    z = forward * sin(pitch)
    return x, right * cos(roll) + z * sin(roll), z * cos(roll) - right * sin(roll)


def vector_from_level(forward: float, right: float, psi: float) -> tuple[float, float]:
    """Return a horizontal vector (forward, right of the nose) in the paper's frame. psi: direction
    of the nose, rad."""
    return forward * cos(psi) + right * sin(psi), forward * sin(psi) - right * cos(psi)


def compass_from_vector(x: float, y: float) -> float:
    """Return the compass bearing of a vector in the paper's frame (x east, y north): rad in [0, 2
    pi), clockwise from north."""
    return atan2(x, y) % (2 * pi)


def quaternion_from_euler(
    roll: float, pitch: float, yaw: float
) -> tuple[float, float, float, float]:
    """Return MAVLink's q (w, x, y, z) for Euler angles in rad, NED, applied in the order yaw,
    pitch, roll."""
    cr = cos(roll / 2)
    sr = sin(roll / 2)
    cp = cos(pitch / 2)
    sp = sin(pitch / 2)
    cy = cos(yaw / 2)
    sy = sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler_from_quaternion(q: Sequence[float]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw in rad, NED, for MAVLink's q (w, x, y, z)."""
    w, x, y, z = q
    return (
        atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        asin(min(max(2 * (w * y - z * x), -1.0), 1.0)),
        atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
