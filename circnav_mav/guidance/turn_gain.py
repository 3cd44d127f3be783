"""Ratio of flown to commanded turn rate, learned in flight; floats for one flight, arrays for many.

Real vehicles fly 0.70 to 1.05 of the commanded turn rate (a plane that banks for a coordinated turn
and slips: 0.73). A remaining error of 1 % is 0.2 to 0.3 m of radius. Method: least squares of the
heading's rate on the commanded rate, with exponential forgetting. Both pass the same low-pass, so
that the vehicle's lag does not bias the ratio.
"""

from math import inf, pi
from typing import NamedTuple

from circnav_mav.guidance.maths import (
    Flag,
    Number,
    clip,
    exp,
    logical_not,
    magnitude,
    maximum,
    rint,
    where,
)
from circnav_mav.guidance.types import SAME_TIME

SMOOTHING = 1.0
MEMORY = 15.0
"""Time constants of the low-pass and of the least squares, s."""
PRIOR = 0.01
"""Weight of the initial gain 1, (rad/s)^2 s."""
LOWEST, HIGHEST = 0.6, 1.25
"""Bounds of the gain."""
UNRESPONSIVE_BELOW = 1 / 3
"""Fraction of the commanded turn below which a vehicle counts as not following."""
LEAST_COMMAND = 0.02
"""Commanded turn rate, rad/s, below which noise hides whether the vehicle follows."""
LONGEST_STEP = 0.5
"""Gap between two headings, s, after which the low-pass restarts."""


class TurnGain(NamedTuple):
    """State of the estimate. gain: flown over commanded turn rate. time: of the newest heading, s;
    -inf at the start. age: time for which the vehicle has followed, s."""

    gain: Number = 1.0
    time: Number = -inf
    heading: Number = 0.0
    smooth_rate: Number = 0.0
    lagged: Number = 0.0
    smooth_command: Number = 0.0
    age: Number = 0.0
    square: Number = 0.0
    product: Number = 0.0

    @property
    def followed(self) -> Flag:
        """True if the turn is at least a third of the command, or the command is too small to
        judge."""
        return _followed(self.smooth_rate, self.smooth_command)


def learn(
    state: TurnGain, *, lag: Number, time: Number, heading: Number, command: Number
) -> TurnGain:
    """Return the state after a heading.

    lag: delay from a command to its turn, s. heading: measured, rad. command: commanded turn rate
    meanwhile, rad/s, same sense as the heading.
    """
    gap = time - state.time
    begins = logical_not((gap >= 0) & (gap <= LONGEST_STEP))
    step = where(begins, 0.0, gap)
    off = heading - state.heading
    turned = off - 2 * pi * rint(off / (2 * pi))
    smooth = 1 - exp(-step / SMOOTHING)
    follow = where(lag > 0, 1 - exp(-step / maximum(lag, 1e-9)), 1.0)
    lagged = state.lagged + (command - state.lagged) * follow
    smoothed = state.smooth_command + (lagged - state.smooth_command) * smooth
    rate = state.smooth_rate + (turned / maximum(step, 1e-9) - state.smooth_rate) * smooth
    followed = _followed(rate, smoothed)
    age = where(followed, state.age + step, 0.0)
    # Earlier, the low-pass still contains its initial value, or turns from before the vehicle
    # followed.
    learns = followed & (age >= 4 * SMOOTHING - SAME_TIME)
    forget = exp(-step / MEMORY)
    square = where(learns, state.square * forget + smoothed**2 * step, state.square)
    product = where(learns, state.product * forget + smoothed * rate * step, state.product)
    gain = clip((product + PRIOR) / (square + PRIOR), LOWEST, HIGHEST)
    return TurnGain(
        gain=where(learns, gain, state.gain),
        time=time,
        heading=where(step == 0, where(begins, heading, state.heading), heading),
        smooth_rate=where(begins, command, rate),
        lagged=where(begins, command, lagged),
        smooth_command=where(begins, command, smoothed),
        age=where(begins, 0.0, age),
        square=square,
        product=product,
    )


def _followed(rate: Number, command: Number) -> Flag:
    return (magnitude(command) < LEAST_COMMAND) | (rate * command > UNRESPONSIVE_BELOW * command**2)
