"""Recognises a turn command that swings from limit to limit, and lowers the gains until it stops.

A loop that is too quick for its vehicle does not diverge: the limit holds it in a cycle. On firmware such cycles had
periods of 1 .. 4.6 s; what wind, noise or a search ask for is slower or smaller.
"""

from dataclasses import dataclass, replace

SWING = 0.8
"""A reversal counts where the command has come back by this many times the limit since its last turning point."""
PERIOD = 5.2
"""Longest time from a reversal to the one after the next, s: the slowest cycle seen, and a little. A search weaves in
6 s."""
REVERSALS = 8
"""Reversals in a row that make a cycle: four periods, which no manoeuvre has."""
LOWERED, LEAST = 0.7, 0.3
"""What a cycle leaves of the gains, and what is always left: the rule has a gain margin of 6 dB, so at .3 of it a
vehicle that still swings would have to turn more than six times as hard as it was learnt to."""


@dataclass(frozen=True, slots=True)
class CommandWatch:
    """share: of the gains that is left. cycles: how often they were lowered. extreme: the last turning point of the
    command, in units of the limit; rising: where it goes from there. reversals: in a row, the last two at `reversed_at`
    (s)."""

    share: float = 1.0
    cycles: int = 0
    extreme: float = 0.0
    rising: bool = True
    reversals: int = 0
    reversed_at: tuple[float, float] = (float("-inf"), float("-inf"))

    def watch(self, time: float, command: float, limit: float) -> "CommandWatch":
        """Take in a command (rad/s) of a time (s) to a vehicle with this limit (rad/s)."""
        size = command / limit
        if (size > self.extreme) == self.rising:
            return replace(self, extreme=size)
        if abs(size - self.extreme) < SWING:
            return self
        # of two reversals, for a cycle about a turn spends longer on one side
        before, last = self.reversed_at
        count = self.reversals + 1 if time - before <= PERIOD else min(self.reversals, 1) + 1
        after = replace(self, extreme=size, rising=not self.rising, reversals=count, reversed_at=(last, time))
        if count < REVERSALS:
            return after
        return replace(after, share=max(self.share * LOWERED, LEAST), cycles=self.cycles + 1, reversals=0)
