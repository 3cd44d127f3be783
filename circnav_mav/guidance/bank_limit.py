"""Detection of a plane's bank limit, the counterpart of `lean_limit` for copters."""

from math import exp, inf, pi, remainder
from typing import NamedTuple

from circnav_mav.guidance.types import OwnMotion

SHORT = 0.95
"""Share of the commanded turn below which a bank counts as limited, both smoothed over 1 s. A
smaller reduction matters less than the lag between the two."""
STEADY = 0.03
STEADY_FOR = 1.0
"""Steady bank: largest difference from its mean over 1 s, as a share, and least duration, s. A
rolling vehicle has no steady bank."""
STOOD_LEAST = 0.5
STOOD_MOST = 20.0
"""Time at the limit, s, before the limit is used, and time constant of its average, s: an error of
1 % costs 0.3 m of radius."""
LONGEST_BANK_INTERVAL = 1.0
"""Longest time, s, from one report to the next for which a bank is integrated."""


class BankLimit(NamedTuple):
    """Detects an autopilot's bank limit below that of the mission: the bank stays constant below
    the commanded one.

    time, heading: of the newest report, s, rad. since: when the vehicle last followed or rolled, s.
    short: True if it banks less than commanded now. stood: time at the limit, s. banked, turned:
    turn during that time, rad: coordinated turn of the bank, and turn of the nose.
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
        """Coordinated turn rate at the limit, rad/s; inf while unknown."""
        return self.banked / self.stood if self.stood >= STOOD_LEAST else inf

    @property
    def turn(self) -> float:
        """Turn rate of the nose at the limit, rad/s; inf while unknown."""
        return self.turned / self.stood if self.stood >= STOOD_LEAST else inf

    def follow(self, own: OwnMotion, commanded: float, banked: float) -> "BankLimit":
        """Return the state after a report. commanded, banked: turn rates of the command and of the
        bank, both smoothed over 1 s, rad/s."""
        time = own.time
        now = own.bank_turn or 0.0
        step = own.time - self.time
        short = abs(banked) < SHORT * abs(commanded)
        steady = short and banked * commanded > 0 and abs(now - banked) < STEADY * abs(banked)
        since = min(self.since, time) if steady else time
        after = self._replace(time=time, heading=own.heading, since=since, short=short)
        # Commands may exceed the found limit. A bank above it shows that it was found too low:
        # discard it.
        if abs(banked) > (1 + STEADY) * self.bank:
            return after._replace(stood=0.0, banked=0.0, turned=0.0)
        if time - since < STEADY_FOR or not 0 < step <= LONGEST_BANK_INTERVAL:
            return after
        kept = exp(-step / STOOD_MOST)
        turned = abs(remainder(own.heading - self.heading, 2 * pi))
        return after._replace(
            stood=kept * self.stood + step, banked=kept * self.banked + abs(now) * step,
            turned=kept * self.turned + turned,
        )  # fmt: skip
