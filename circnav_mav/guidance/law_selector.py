"""`auto`: feedforward on range and range rate at once, the drift law as soon as the bank can be trusted.

While the bank searches, its favourite guess is tried out: flying at a wrong guess contradicts it within seconds, where
the straight approach of a law on range alone would leave all guesses alive. When even that tells nothing apart, the
approach weaves. Whatever steers, every change is bumpless: the difference to the command before it fades out.

For the counter-clockwise orbit. Arrays of shape (B,) over flights; of the one in the air, plain numbers.
"""

from dataclasses import astuple, dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from circnav_mav.guidance.types import SAME_TIME

Array = Any
FIRST_GUESS = 1.0
"""Time, s, that a search needs before its favourite is worth trying."""
PATIENCE = 6.0
"""Time, s, of trying after which the approach weaves."""
WEAVE_SHARE, WEAVE_PERIOD = 0.7, 6.0
"""Amplitude in units of the turn-rate limit, and period, s: some 30 deg to either side."""
FADE = 0.2
"""Time constant of a handover, s."""
AWAY, BACK = 0.5, 0.1
"""By how many radii a trial may lead away before feedforward flies instead, and how near that has to come to the
closest range of the search again before a guess is worth another try."""


class Flies(IntEnum):
    """Who steers."""

    FEEDFORWARD = 0
    TRIAL = 1
    DRIFT = 2

    @property
    def why(self) -> str:
        """For people."""
        return _WHY[self]


_WHY = {
    Flies.FEEDFORWARD: "feedforward: the target is not found yet",
    Flies.TRIAL: "trying the likeliest place of the target",
    Flies.DRIFT: "drift: target and drift are known",
}


@dataclass(frozen=True, slots=True)
class Handover:
    """flies (B,): who steered last. favourite (B,): which guess was on trial. command (B,): what was flown, rad/s.
    offset (B,): what is left of the last change, rad/s. untrusted (B,): s since the bank was last trusted. closest
    (B,): range since then, m. astray (B,): whether trials have led away from there."""

    flies: Array
    favourite: Array
    command: Array
    offset: Array
    untrusted: Array
    closest: Array
    astray: Array


ONE_AT_START = Handover(-1, -1, 0.0, 0.0, 0.0, np.inf, False)
"""Before the first command of one flight."""


def at_start(flights: int = 1) -> Handover:
    """The same of B flights."""
    return Handover(*(np.full(flights, value) for value in astuple(ONE_AT_START)))


def hand_over(
    before: Handover, dt: Array, *, trusted: Array, favourite: Array, by_range: Array, by_bank: Array, limit: Array,
    r: Array, r_d: Array, xp: Any = np,
) -> Handover:  # fmt: skip
    """The command of this step. favourite (B,): number of the bank's guess while it searches, else -1.

    by_range, by_bank (B,): what feedforward and the drift law ask for, rad/s; by_bank counts only where it has grounds.
    r: range, r_d: desired, m.
    xp: numpy, or `floats` for one flight.
    """
    untrusted = xp.where(trusted, 0.0, before.untrusted + dt)
    closest = xp.where(trusted, r, xp.minimum(before.closest, r))
    gone = r - closest
    astray = xp.logical_not(trusted) & ((gone > AWAY * r_d) | (before.astray & (gone > BACK * r_d)))
    trial = xp.logical_not(trusted) & (favourite >= 0) & (untrusted >= FIRST_GUESS - SAME_TIME) & xp.logical_not(astray)
    flies = xp.where(trusted, Flies.DRIFT, xp.where(trial, Flies.TRIAL, Flies.FEEDFORWARD))
    on_trial = xp.where(trial, favourite, -1)
    weave = WEAVE_SHARE * limit * xp.sin(2 * np.pi * untrusted / WEAVE_PERIOD)
    by_bank = by_bank + xp.where(trial & (untrusted > PATIENCE + SAME_TIME), weave, 0.0)
    wanted = xp.clip(xp.where(flies == Flies.FEEDFORWARD, by_range, by_bank), -limit, limit)
    changed = (before.flies >= 0) & ((flies != before.flies) | (on_trial != before.favourite))
    offset = xp.where(changed, before.command - wanted, before.offset * xp.exp(-dt / FADE))
    return Handover(flies, on_trial, xp.clip(wanted + offset, -limit, limit), offset, untrusted, closest, astray)
