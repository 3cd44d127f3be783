"""Where an airplane flies while its nose points elsewhere: side-slip, from bank, pitch and turn rate alone.

    steady:  angle = c (w - psi') - pitch tan(bank),   w = g tan(bank)/V
    else:    angle' = q w - psi' + (steady angle - angle)/T,           q = psi'/w, the mean of many seconds

angle: from the nose to the direction of flight through the air, as seen from above; w: turn rate of the coordinated
turn; counter-clockwise, the bank to the left; the pitch above the path. What a nose that turns less than its bank asks
leaves, the side force balances: c is the time in which a side-slip bends the path away. One that is banked with its
nose up points to the inside of its turn. The pitch is that of straight flight, known by its mean over many seconds, and
more in a bank, which takes more lift: what it does in a gust tells nothing. A gust turns the nose into it and leaves
the path where it was: for T the path is known by the bank, not by the nose.

ArduPilot's plane turns .75 of what its bank asks in simulation, with its nose 2.8 deg down: on a circle it flies
2.3 deg inside of its nose, in wind 1 deg less to 1 deg more as its bank changes. Source: balance of the forces across
the path, geometry of a banked vehicle; fitted to true tracks of ArduPlane 4.6.3 (calm, wind 5 and 8).

Limits: c, T and LIFTS are those of this one simulated airframe. Only q and the pitch are learned in flight. The error
on another airframe is bounded by MOST. On the emulated PX4 plane the correction changes the radius by less than 2 %.
"""

from math import exp, tan
from typing import NamedTuple

from circnav_mav.guidance.types import OwnMotion

BENDS_AWAY = 0.3
"""c, s."""
BY_BANK = 0.6
"""T, s."""
LIFTS = 0.052
"""By how much the nose is higher, rad, for each unit of the tangent of the bank."""
MEAN_TIME = 20.0
"""Time over which the pitch of straight flight, and q, are averaged, s."""
LEAST_TURN = 0.02
"""A turn from which q shows, rad/s: it is 1 before."""
MOST = 0.2
"""Most side-slip, rad: beyond it is another airplane, or a wrong bank."""
LONGEST_STEP = 0.5
"""Gap between two reports, s, after which the slip begins anew at its steady value."""


class SideSlip(NamedTuple):
    """What is known of it after a report. time: s. angle: see above, rad. level: pitch of straight flight, rad. turned,
    asked: means of psi' w and w^2, (rad/s)^2."""

    time: float = float("-inf")
    angle: float = 0.0
    level: float = 0.0
    turned: float = 0.0
    asked: float = 0.0

    def follow(self, own: OwnMotion) -> tuple["SideSlip", OwnMotion]:
        """Take in a report; answers with the motion through the air: its direction in the place of the nose's. Nothing
        changes for a vehicle that does not bank to turn."""
        if own.bank_turn is None:
            return self, own
        w, lifted, step = own.bank_turn, LIFTS * abs(tan(own.bank)), own.time - self.time
        goes_on = 0 <= step <= LONGEST_STEP

        def mean(before: float, value: float, over: float) -> float:
            return value + (exp(-step / over) * (before - value) if goes_on else 0.0)

        level = mean(self.level, own.pitch - lifted, MEAN_TIME)
        turned, asked = mean(self.turned, own.turn_rate * w, MEAN_TIME), mean(self.asked, w * w, MEAN_TIME)
        q = (turned + LEAST_TURN**2) / (asked + LEAST_TURN**2)
        steady = BENDS_AWAY * (1 - q) * w - (level + lifted) * tan(own.bank)
        angle = mean(self.angle, steady + BY_BANK * (q * w - own.turn_rate), BY_BANK)
        angle = min(max(angle, -MOST), MOST)
        return SideSlip(own.time, angle, level, turned, asked), own._replace(heading=own.heading + angle)
