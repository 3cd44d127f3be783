"""`auto`: feedforward on range and range rate at once, the drift law as soon as the relative motion can be trusted.

While the target is searched for, the likeliest guess is tried out: flying at a wrong guess contradicts it within
seconds, where the straight approach of a law on range alone would leave all guesses alive. When even that tells nothing
apart, the approach weaves. Every change is bumpless: the difference to the command before it fades out.

For the counter-clockwise orbit. Numbers for the flight in the air, arrays (B,) for many.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import inf, pi

from circnav_mav.guidance.maths import Array, clip, exp, logical_not, minimum, sin, where
from circnav_mav.guidance.types import SAME_TIME

FIRST_GUESS = 1.0
"""Time, s, that a search needs before its likeliest guess is worth trying."""
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


WHY = {
    Flies.FEEDFORWARD: "feedforward: the target is not found yet",
    Flies.TRIAL: "trying the likeliest place of the target",
    Flies.DRIFT: "drift: target and drift are known",
}


@dataclass(frozen=True, slots=True)
class Handover:
    """flies: who steered last; -1: nobody yet. favourite: which guess was on trial. command: what was flown, rad/s.
    offset: what is left of the last change, rad/s. untrusted: s since the target was last known. closest: range since
    then, m. astray: whether trials have led away from there."""

    flies: Array = -1
    favourite: Array = -1
    command: Array = 0.0
    offset: Array = 0.0
    untrusted: Array = 0.0
    closest: Array = inf
    astray: Array = False


AT_START = Handover()


def hand_over(
    before: Handover, dt: Array, *, trusted: Array, favourite: Array, by_range: Array, by_bank: Array, limit: Array,
    r: Array, r_d: Array,
) -> Handover:  # fmt: skip
    """The command of this step. favourite: number of the likeliest guess while the target is searched for, else -1.

    by_range, by_bank: what feedforward and the drift law ask for, rad/s; by_bank counts only where it has grounds.
    r: range, r_d: desired, m.
    """
    untrusted = where(trusted, 0.0, before.untrusted + dt)
    closest = where(trusted, r, minimum(before.closest, r))
    gone = r - closest
    astray = logical_not(trusted) & ((gone > AWAY * r_d) | (before.astray & (gone > BACK * r_d)))
    trial = logical_not(trusted) & (favourite >= 0) & (untrusted >= FIRST_GUESS - SAME_TIME) & logical_not(astray)
    flies = where(trusted, Flies.DRIFT, where(trial, Flies.TRIAL, Flies.FEEDFORWARD))
    on_trial = where(trial, favourite, -1)
    weave = WEAVE_SHARE * limit * sin(2 * pi * untrusted / WEAVE_PERIOD)
    by_bank = by_bank + where(trial & (untrusted > PATIENCE + SAME_TIME), weave, 0.0)
    wanted = clip(where(flies == Flies.FEEDFORWARD, by_range, by_bank), -limit, limit)
    changed = (before.flies >= 0) & ((flies != before.flies) | (on_trial != before.favourite))
    offset = where(changed, before.command - wanted, before.offset * exp(-dt / FADE))
    return Handover(flies, on_trial, clip(wanted + offset, -limit, limit), offset, untrusted, closest, astray)
