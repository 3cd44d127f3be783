"""Finds the bank beyond which a plane does not go, as `lean_limit` finds the lean of a copter."""

from math import exp, inf, pi, remainder
from typing import NamedTuple

from circnav_mav.guidance.types import OwnMotion

SHORT = 0.95
"""Share of the commanded turn, both smoothed over a second, below which a bank counts as cut: a limit that leaves more
costs less than the lag between the two."""
STANDS, STANDS_FOR = 0.03, 1.0
"""A bank that is cut stands at its limit where it differs by less than this share from its mean over a second, for so
long, s: one that rolls does not."""
STOOD_LEAST, STOOD_MOST = 0.5, 20.0
"""Time at the limit, s, by which it is told first, and over which it is averaged: 1 % of it is .3 m of radius."""
LONGEST_FELT = 1.0
"""Most time, s, for which a bank counts from one report to the next."""


class BankLimit(NamedTuple):
    """Recognises the bank beyond which a vehicle does not go, however much is commanded: its autopilot's limit is below
    the mission's.

    time, heading: of the newest report, s, rad. since: when it last did as commanded, or still rolled, s. short:
    whether it banks less than commanded now. stood: for how long it was seen at its limit, s; banked, turned: by how
    much the coordinated turn of its bank, and the nose, turned meanwhile, rad.
    """

    time: float = inf
    heading: float = 0.0
    since: float = inf
    short: bool = False
    stood: float = 0.0
    banked: float = 0.0
    turned: float = 0.0

    @property
    def bank(self) -> float:
        """The turn that the limit asks for if it is coordinated, rad/s; inf while nothing is known."""
        return self.banked / self.stood if self.stood >= STOOD_LEAST else inf

    @property
    def turn(self) -> float:
        """Turn of the nose there, rad/s."""
        return self.turned / self.stood if self.stood >= STOOD_LEAST else inf

    def follow(self, own: OwnMotion, commanded: float, banked: float) -> "BankLimit":
        """Take in a report beside the commanded turn and that of the bank, both smoothed over a second, rad/s."""
        time, now, step = own.time, own.bank_turn or 0.0, own.time - self.time
        short = abs(banked) < SHORT * abs(commanded)
        stands = short and banked * commanded > 0 and abs(now - banked) < STANDS * abs(banked)
        since = min(self.since, time) if stands else time
        after = self._replace(time=time, heading=own.heading, since=since, short=short)
        # commands are not cut to the limit, so a bank beyond it shows that it was found too low
        if abs(banked) > (1 + STANDS) * self.bank:
            return after._replace(stood=0.0, banked=0.0, turned=0.0)
        if time - since < STANDS_FOR or not 0 < step <= LONGEST_FELT:
            return after
        kept = exp(-step / STOOD_MOST)
        turned = abs(remainder(own.heading - self.heading, 2 * pi))
        return after._replace(
            stood=kept * self.stood + step, banked=kept * self.banked + abs(now) * step,
            turned=kept * self.turned + turned,
        )  # fmt: skip
