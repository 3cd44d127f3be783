"""Side-slip of an airplane from bank, pitch and turn rate alone: the angle from its nose to its
path.

    steady:  angle = c (w - psi') - pitch tan(bank),   w = g tan(bank)/V
    else:    angle' = q w - psi' + (steady angle - angle)/T,   q = mean of psi'/w

angle: from the nose to the direction of motion through the air, seen from above. w: turn rate of
the coordinated turn. psi': turn rate of the nose. All counter-clockwise positive; bank to the left,
pitch above the path.

First term: if the nose turns less than its bank requires, the side force balances the rest. In the
time c a side-slip turns the path by its angle. Second term: with bank and the nose up, the nose
points to the inside of the turn. The pitch is the mean of straight flight over many seconds, plus
the rise for the extra lift in a bank. The momentary pitch is not used: gusts disturb it. A gust
turns the nose into the wind and leaves the path unchanged. Within T the path follows the bank, not
the nose.

ArduPilot's simulated plane flies 0.75 of its coordinated turn rate, with its nose 2.8 deg down. On
a circle its path points 2.3 deg inside of its nose; in wind this varies by +-1 deg with the bank.
Source: balance of the forces across the path, geometry of a banked vehicle; fitted to true tracks
of ArduPlane 4.6.3 (calm, wind of 5 and 8 m/s).

Limits: c, T and LIFTS are those of this one simulated airframe. Only q and the pitch are learned in
flight. The error on another airframe is bounded by MOST. On the emulated PX4 plane the correction
changes the radius by less than 2 %.
"""

from math import exp, tan
from typing import NamedTuple

from circnav_mav.guidance.types import OwnMotion

BENDS_AWAY = 0.3
"""Time c in which a side-slip turns the path by its angle, s."""
BY_BANK = 0.6
"""Time constant T within which the path follows the bank, s."""
LIFTS = 0.052
"""Rise of the nose, rad, per unit of tan(bank)."""
MEAN_TIME = 20.0
"""Time constant of the means of straight-flight pitch and of q (flown over coordinated turn rate),
s."""
LEAST_TURN = 0.02
"""Turn rate from which q is observable, rad/s. Below, q tends to 1."""
MOST = 0.2
"""Bound of the side-slip, rad: more means another airplane, or a wrong bank."""
LONGEST_STEP = 0.5
"""Gap between two reports, s, after which the side-slip restarts at its steady value."""


class SideSlip(NamedTuple):
    """Estimate after a report. time: s. angle: see above, rad. level: pitch of straight flight,
    rad. turned, asked: means of psi' w and w^2, (rad/s)^2."""

    time: float = float("-inf")
    angle: float = 0.0
    level: float = 0.0
    turned: float = 0.0
    asked: float = 0.0

    def follow(self, own: OwnMotion) -> tuple["SideSlip", OwnMotion]:
        """Return the state after a report, and the motion with the direction through the air as
        heading. Both are unchanged for a vehicle that does not bank to turn."""
        if own.bank_turn is None:
            return self, own
        w = own.bank_turn
        lifted = LIFTS * abs(tan(own.bank))
        step = own.time - self.time
        goes_on = 0 <= step <= LONGEST_STEP

        def mean(before: float, value: float, over: float) -> float:
            return value + (exp(-step / over) * (before - value) if goes_on else 0.0)

        level = mean(self.level, own.pitch - lifted, MEAN_TIME)
        turned = mean(self.turned, own.turn_rate * w, MEAN_TIME)
        asked = mean(self.asked, w * w, MEAN_TIME)
        q = (turned + LEAST_TURN**2) / (asked + LEAST_TURN**2)
        steady = BENDS_AWAY * (1 - q) * w - (level + lifted) * tan(own.bank)
        angle = mean(self.angle, steady + BY_BANK * (q * w - own.turn_rate), BY_BANK)
        angle = min(max(angle, -MOST), MOST)
        return SideSlip(own.time, angle, level, turned, asked), own._replace(
            heading=own.heading + angle
        )
