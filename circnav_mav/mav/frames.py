"""The one place where signs and frames change. Each function is named by the frames it joins.

Guidance turns counter-clockwise positive (the paper: x east, y north, angles from x). MAVLink yaws clockwise positive
(NED: heading from north). No other module negates an angle or a turn rate.
"""

from math import pi
from typing import NewType

from circnav_mav.core.values import TurnRate

YawRate = NewType("YawRate", float)
"""Yaw rate in rad/s, clockwise positive seen from above (MAVLink's NED frame)."""


def yaw_rate_from_turn_rate(turn_rate: TurnRate) -> YawRate:
    """Counter-clockwise positive to clockwise positive, rad/s."""
    return YawRate(-turn_rate)


def turn_rate_from_yaw_rate(yaw_rate: YawRate) -> TurnRate:
    """Clockwise positive to counter-clockwise positive, rad/s."""
    return TurnRate(-yaw_rate)


def course_from_yaw(yaw: float) -> float:
    """NED heading (clockwise from north) to the paper's psi (counter-clockwise from east), rad in (-pi, pi]."""
    return pi - (pi / 2 + yaw) % (2 * pi)
