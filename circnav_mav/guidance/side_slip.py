"""Where an airplane flies while its nose points elsewhere: side-slip, from bank and turn rate alone.

    V (psi' + beta') = g tan(roll) - (V/c) beta

beta: from the nose to the direction of flight through the air, c: time in which a side-slip bends the path away. An
airplane whose nose turns as its bank asks does not slip. ArduPilot's turns .75 of that in simulation: on a circle it
flies 2 deg inside of its nose, and not in straight flight. Source: balance of the forces across the path; c fitted to
true tracks of ArduPilot (.5 .. .75 s, calm, wind 8, target) and PX4 (.42 s) in simulation.
"""

from math import exp
from typing import NamedTuple

from circnav_mav.guidance.types import OwnMotion

BENDS_AWAY = 0.6
"""c, s."""
MOST = 0.2
"""Most side-slip, rad: beyond it is another airplane, or a wrong bank."""
LONGEST_STEP = 0.5
"""Gap between two reports, s, after which the slip begins anew at its steady value."""


class SideSlip(NamedTuple):
    """What is known of it after a report. time: s. angle: counter-clockwise from the nose, rad."""

    time: float = float("-inf")
    angle: float = 0.0

    def follow(self, own: OwnMotion) -> tuple["SideSlip", OwnMotion]:
        """Take in a report; answers with the motion through the air: its direction in the place of the nose's. Nothing
        changes for a vehicle that does not bank to turn."""
        if own.bank_turn is None:
            return self, own
        steady = min(max(BENDS_AWAY * (own.bank_turn - own.turn_rate), -MOST), MOST)
        step = own.time - self.time
        kept = exp(-step / BENDS_AWAY) if 0 <= step <= LONGEST_STEP else 0.0
        slip = SideSlip(own.time, steady + kept * (self.angle - steady))
        return slip, own._replace(heading=own.heading + slip.angle)
