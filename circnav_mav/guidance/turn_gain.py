"""How much of a commanded turn rate a vehicle really turns, learnt in flight; floats for one flight, arrays for many.

Real vehicles realise .70 .. 1.05 of what is commanded (a plane that banks for a coordinated turn and slips: .73), and
one percent left over is .2 .. .3 m of radius. Least squares of the heading's rate on the commanded rate, with
exponential forgetting; both pass the same low-pass, so that the vehicle's lag does not bias the ratio.
"""

from dataclasses import dataclass
from math import inf, pi
from types import ModuleType

from circnav_mav.guidance import floats
from circnav_mav.guidance.floats import Flag, Number, magnitude
from circnav_mav.guidance.types import SAME_TIME


@dataclass(frozen=True, slots=True)
class TurnGainSettings:
    """smoothing: time constant of the low-pass, s. memory: of the least squares, s. lag: of the vehicle's turn, s.
    prior: weight of the initial gain 1, (rad/s)^2 s. lowest, highest: bounds of the answer."""

    smoothing: float = 1.0
    memory: float = 15.0
    lag: Number = 0.4
    prior: float = 0.01
    lowest: float = 0.6
    highest: float = 1.25


@dataclass(frozen=True, slots=True)
class TurnGain:
    """The state of the estimate; `gain` is realised over commanded turn rate. time: of the newest heading, s, at first
    -inf. age: for how long the low-pass has followed the vehicle, s."""

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
        """Whether the vehicle turns as commanded, at least by a third. One that does not hear us teaches nothing."""
        return _followed(self.smooth_rate, self.smooth_command)


DEAF = 1 / 3
"""Fraction of the commanded turn below which a vehicle does not fly what is commanded (the gain's own bound is .6)."""
LEAST_COMMAND = 0.02
"""Commanded turn rate, rad/s, below which noise would hide whether it is followed."""
LONGEST_STEP = 0.5
"""Gap between two headings, s, after which the low-pass starts anew."""


def learn(
    state: TurnGain, settings: TurnGainSettings, *, time: Number, heading: Number, command: Number,
    xp: ModuleType = floats,
) -> TurnGain:  # fmt: skip
    """One heading (rad) measured while `command` (rad/s, same sense as the heading) was commanded."""
    gap = time - state.time
    begins = xp.logical_not((gap >= 0) & (gap <= LONGEST_STEP))
    step = xp.where(begins, 0.0, gap)
    off = heading - state.heading
    turned = off - 2 * pi * xp.rint(off / (2 * pi))
    smooth = 1 - xp.exp(-step / settings.smoothing)
    follow = xp.where(settings.lag > 0, 1 - xp.exp(-step / xp.maximum(settings.lag, 1e-9)), 1.0)
    lagged = state.lagged + (command - state.lagged) * follow
    told = state.smooth_command + (lagged - state.smooth_command) * smooth
    rate = state.smooth_rate + (turned / xp.maximum(step, 1e-9) - state.smooth_rate) * smooth
    followed = _followed(rate, told)
    age = xp.where(followed, state.age + step, 0.0)
    # until then the low-pass has not yet forgotten its start, or what was not followed
    learns = followed & (age >= 4 * settings.smoothing - SAME_TIME)
    forget = xp.exp(-step / settings.memory)
    square = xp.where(learns, state.square * forget + told**2 * step, state.square)
    product = xp.where(learns, state.product * forget + told * rate * step, state.product)
    gain = xp.clip((product + settings.prior) / (square + settings.prior), settings.lowest, settings.highest)
    return TurnGain(
        gain=xp.where(learns, gain, state.gain),
        time=time,
        heading=xp.where(step == 0, xp.where(begins, heading, state.heading), heading),
        smooth_rate=xp.where(begins, command, rate),
        lagged=xp.where(begins, command, lagged),
        smooth_command=xp.where(begins, command, told),
        age=xp.where(begins, 0.0, age),
        square=square,
        product=product,
    )


def _followed(rate: Number, command: Number) -> Flag:
    return (magnitude(command) < LEAST_COMMAND) | (rate * command > DEAF * command**2)
