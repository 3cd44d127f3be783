"""How much of a commanded turn rate a vehicle really turns, learnt in flight.

Real vehicles realise .70 .. 1.05 of what they are told (a plane that banks for a coordinated turn and slips: .73), and
one percent left over is .2 .. .3 m of radius. Least squares of the heading's rate on the commanded rate, with
exponential forgetting; both pass the same low-pass, so that the vehicle's lag does not bias the ratio.
"""

from dataclasses import dataclass, replace
from math import exp, pi, remainder

from circnav_mav.guidance.types import SAME_TIME, TurnRate


@dataclass(frozen=True, slots=True)
class TurnGainSettings:
    """smoothing: time constant of the low-pass, s. memory: of the least squares, s. lag: of the vehicle's turn, s.
    prior: weight of the initial gain 1, (rad/s)^2 s. lowest, highest: bounds of the answer."""

    smoothing: float = 1.0
    memory: float = 15.0
    lag: float = 0.4
    prior: float = 0.01
    lowest: float = 0.6
    highest: float = 1.25


@dataclass(frozen=True, slots=True)
class TurnGain:
    """The state of the estimate; `gain` is realised over commanded turn rate."""

    gain: float = 1.0
    time: float | None = None
    heading: float = 0.0
    smooth_rate: float = 0.0
    lagged: float = 0.0
    smooth_command: float = 0.0
    age: float = 0.0
    square: float = 0.0
    product: float = 0.0

    @property
    def followed(self) -> bool:
        """Whether the vehicle turns as it is told, at least by a third. One that does not hear us teaches nothing."""
        told = self.smooth_command
        return abs(told) < LEAST_COMMAND or self.smooth_rate / told > DEAF


DEAF = 1 / 3
"""Fraction of the commanded turn below which a vehicle does not fly what it is told (the gain's own bound is .6)."""
LEAST_COMMAND = 0.02
"""Commanded turn rate, rad/s, below which noise would hide whether it is followed."""
LONGEST_STEP = 0.5
"""Gap between two headings, s, after which the low-pass starts anew."""


def learn(state: TurnGain, settings: TurnGainSettings, *, time: float, heading: float, command: TurnRate) -> TurnGain:
    """One heading (rad) measured while the vehicle was told to turn at `command` (rad/s, same sense as the heading)."""
    if state.time is None or not 0 <= time - state.time <= LONGEST_STEP:
        return TurnGain(
            gain=state.gain, time=time, heading=heading, smooth_rate=command, lagged=command,
            smooth_command=command, square=state.square, product=state.product,
        )  # fmt: skip
    step = time - state.time
    if step == 0:
        return state
    turned = remainder(heading - state.heading, 2 * pi)
    lagged = _low_pass(state.lagged, command, step, settings.lag)
    smooth_command = _low_pass(state.smooth_command, lagged, step, settings.smoothing)
    smooth_rate = _low_pass(state.smooth_rate, turned / step, step, settings.smoothing)
    moved = replace(
        state, time=time, heading=heading, smooth_rate=smooth_rate, lagged=lagged,
        smooth_command=smooth_command, age=state.age + step,
    )  # fmt: skip
    if not moved.followed:
        return replace(moved, age=0.0)
    if moved.age < 4 * settings.smoothing - SAME_TIME:
        return moved  # the low-pass has not yet forgotten its start, or what was not followed
    forget = exp(-step / settings.memory)
    square = state.square * forget + smooth_command**2 * step
    product = state.product * forget + smooth_command * smooth_rate * step
    gain = (product + settings.prior) / (square + settings.prior)
    return replace(moved, gain=min(max(gain, settings.lowest), settings.highest), square=square, product=product)


def _low_pass(state: float, value: float, step: float, constant: float) -> float:
    return value if constant <= 0 else state + (value - state) * (1 - exp(-step / constant))
