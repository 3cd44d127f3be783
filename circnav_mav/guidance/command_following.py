"""Two verdicts on a vehicle's turns: does the vehicle follow turn commands, and is the loop in a
limit cycle?

Both verdicts use bins of 0.2 s with the commanded turn rate, the flown turn rate, and the
prediction of each candidate of `turn_response`. For a plane, the flown turn rate is that of its
bank. Ranges are not used, so a wrong range raises no alarm.

Following: least squares of the flown on the predicted turns. A vehicle that follows has a gain of a
third or more at one of the candidate delays. Otherwise the flown turns fit better to a constant
turn (commands are ignored), a negative gain (reversed) or a gain below a third (weak).

Limit cycle: autocorrelation of the fast part of the turns. In a limit cycle the turns repeat after
one period and are reversed after half a period. Gusts and noise may be as large, but have no
period.
"""

from collections import deque
from functools import cache
from math import inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.turn_response import BIN, TurnBin

Array = NDArray[Any]
LONGEST_GAP = 1.0
"""Gap between two bins, s, after which the window restarts: the turns in between are unknown."""
LEAST_GAIN = 1 / 3
"""Lowest gain (flown over predicted turns) of a vehicle that follows, and highest gain of a vehicle
that does not. A plane with a bank limit below the mission's limit has such a low gain. Near this
gain both models fit alike, so there is no verdict."""
WINDOWS = 10, 50
"""Lengths of the windows, bins. Hard turns are judged within 2 s, small turns need 10 s."""
BETTER = 1 / 3
"""A model is chosen if its squared error is below a third of the other model's squared error.
Gusts that turn the nose at 0.1 rad/s left a ratio above 0.5 on the emulated vehicles."""
IN_A_ROW = 2
"""Consecutive bins that must agree before the verdict changes."""

PERIODS = 4
"""Least number of periods in a window for a limit cycle. The alternating turns of an approach, and
gusts that repeat by chance, have fewer periods."""
QUICK_PERIOD = 18
"""Longest period of a limit cycle while the target is not located, bins (3.6 s). Limit cycles on
firmware had periods of 1 to 4.6 s, most of them below 2.5 s. Longer periods also occur during the
acquisition of the target. Its excitation has a period of 6 s, and turns from one hypothesis to the
next take 4.4 to 5 s."""
SLOWEST_PERIOD = 40
"""Longest period of a limit cycle while the law uses the estimated target position, bins (8 s). A
copter at its acceleration limit oscillated with periods of 5 to 6 s."""
REPEATS = 0.8
"""Least magnitude of the autocorrelation of a limit cycle: positive after one period, negative
after half a period. On the emulated vehicles, limit cycles reach magnitudes of 0.9 and more. Stable
loops in gusts of 3 m/s reach 0.6, approaches and acquisition at most 0.71."""
LOWERED = 0.7
"""Factor on the gains after each limit cycle."""
LEAST = 0.15
"""Lower bound of the factor on the gains after several limit cycles. If the vehicle's own turn loop
has a damping of 0.06, the oscillation stops at a third of the gains. With a damping of 0.05 at 3
rad/s it stops at a sixth. With a tenth of the gains, a vehicle in wind was 71 m away from its
circle of 60 m radius."""


class CommandFollowing:
    """Judges whether the vehicle follows turn commands.

    follows: False while the vehicle does not follow turn commands.
    since: time at which the vehicle was found not to follow, s; inf if the vehicle follows.
    """

    def __init__(self) -> None:
        self._bins: deque[TurnBin] = deque(maxlen=max(WINDOWS))
        self._in_a_row = 0
        self.follows = True
        self.since = inf

    def judge(self, new: TurnBin) -> None:
        """Add a bin, and judge again."""
        if self._bins and new.time - self._bins[-1].time > LONGEST_GAP:
            self._restart()
        self._bins.append(new)
        flown = np.array([one.flown for one in self._bins])
        predicted = np.concatenate([one.predicted for one in self._bins])
        predicted = predicted.reshape(len(self._bins), -1)
        windows = [width for width in WINDOWS if len(self._bins) >= width]
        found = [_evidence(flown[-width:], predicted[-width:]) for width in windows] or [0]
        # One window that shows a vehicle not following outweighs all windows that show following.
        verdict = min(found) if min(found) < 0 else max(found)
        if verdict * self._in_a_row < 0:
            self._in_a_row = 0
        self._in_a_row += verdict
        if self._in_a_row <= -IN_A_ROW and self.follows:
            self.follows = False
            self.since = new.time
        elif self._in_a_row >= IN_A_ROW:
            self.follows = True
            self.since = inf

    def reset(self) -> None:
        """Restart. Call when another controller has the vehicle."""
        self._restart()
        self.follows = True
        self.since = inf

    def _restart(self) -> None:
        self._bins.clear()
        self._in_a_row = 0


class LimitCycle:
    """Detects limit cycles, and lowers the gains of the law in each.

    share: factor on the gains.
    lap: duration of a lap while the law flies on the estimated target position, s, else 0.
    """

    def __init__(self, limit: float) -> None:
        """limit: limit of the commanded turn rate, rad/s."""
        # Least RMS of the fast part of an oscillation that counts as a limit cycle, in units of the
        # turn-rate limit.
        self._least_rms = 0.25 * limit
        self._turns: deque[tuple[float, float]] = deque(maxlen=PERIODS * SLOWEST_PERIOD)
        self._newest = inf
        self._regular = 0
        self._located = 0
        self.share = 1.0
        self.lap = 0.0

    def judge(self, time: float, flown: float, commanded: float) -> None:
        """Add the turn rates of a bin that ends at a time (s), rad/s, and judge again."""
        if time - self._newest > LONGEST_GAP:
            self.reset()
        self._newest = time
        self._turns.append((flown, commanded))
        self._located = self._located + 1 if self.lap else 0
        window = PERIODS * QUICK_PERIOD
        # The shortest window contains as many periods of half this duration.
        if len(self._turns) < window // 2:
            return
        turns = np.array(tuple(zip(*self._turns, strict=True)))
        swings = self._swings(turns[:, -window:], QUICK_PERIOD)
        # Use all turns since the target was located: a longer window can show a longer period.
        size = min(len(self._turns), self._located)
        if size > window and not swings:
            # 0.4: longest period of a limit cycle as a share of the lap. In wind, turns without a
            # limit cycle repeat once or twice per lap.
            longest = min(SLOWEST_PERIOD, int(0.4 * self.lap / BIN))
            swings = self._swings(turns[:, -size:], longest)
        self._regular = self._regular + 1 if swings else 0
        if self._regular >= IN_A_ROW:
            self.share = max(self.share * LOWERED, LEAST)
            # Turns flown with the previous gains do not show the effect of the new ones.
            self._turns.clear()
            self._regular = 0

    def reset(self) -> None:
        """Restart. Call when another controller has the vehicle. The gains stay lowered."""
        self._turns.clear()
        self._regular = 0
        self._located = 0

    def _swings(self, turns: Array, longest: int) -> bool:
        return any(_swings(one, self._least_rms, longest) for one in turns)


def _evidence(flown: Array, predicted: Array) -> int:
    """Return the evidence of a window of N bins. -1: the vehicle does not follow. +1: the vehicle
    follows. 0: undecided.

    flown: turn rates of the vehicle, (N,), rad/s.
    predicted: turn rates that each candidate predicts, (N, candidates), rad/s.

    A constant turn never gives +1, because the vehicle may turn independently of the commands. If
    the commands have the same direction and are larger, a constant turn gives 0, because the
    vehicle may turn at a limit of its own.
    """
    square = (predicted**2).sum(0)
    product = flown @ predicted
    energy = float(flown @ flown)
    gains = product / np.maximum(square, 1e-9)
    followed_gain = np.maximum(gains, LEAST_GAIN)
    # Ignore the worst bin. A late attitude or a lost setpoint makes one bin wrong. A vehicle that
    # does not follow makes many bins wrong.
    following = _without_worst((flown[:, None] - followed_gain * predicted) ** 2)
    weak_gain = np.minimum(gains, LEAST_GAIN)
    weak = energy + float((weak_gain * (weak_gain * square - 2 * product)).min())
    other = min(weak, energy - float(flown.sum()) ** 2 / flown.size)
    # Least difference of both models' squared errors, integrated over time, rad^2/s, for a verdict.
    # A model that follows may fly a third of the command. So the bound is reached if the vehicle
    # does not fly a command of 0.06 rad/s (3 deg/s) for 2 s, or of 0.025 rad/s for 10 s. For
    # comparison, a bank error of 3 deg at 22 m/s is 0.023 rad/s.
    if abs(following - other) * BIN < 0.0007:
        return 0
    if other < BETTER * following and other < BETTER * _limited(flown, predicted):
        return -1
    return int(following < BETTER * other)


def _limited(flown: Array, predicted: Array) -> float:
    """Return the squared error of a model that flies the command up to a limit of its own, such as
    a bank limit. The limit is a quantile of the flown turns, because a bank overshoots at first.
    The limit is at least a third of the largest command."""
    least = LEAST_GAIN * np.abs(predicted).max(0)
    limits = (np.maximum(limit, least) for limit in np.quantile(np.abs(flown), (0.5, 1.0)))
    return min(
        _without_worst((flown[:, None] - np.clip(predicted, -limit, limit)) ** 2)
        for limit in limits
    )


def _without_worst(errors: Array) -> float:
    """Return the summed errors of the best candidate, without its worst bin."""
    return float((errors.sum(0) - errors.max(0)).min())


def _swings(turns: Array, least: float, longest: int) -> bool:
    """Return True if binned turn rates (rad/s) repeat as in a limit cycle.

    least: least RMS of the fast part of the turn rates, rad/s. The slow part (wind and approach) is
        removed by a parabola.
    longest: longest period, bins.
    """
    parabolas = _parabolas(turns.size)
    fast = turns - parabolas @ (parabolas.T @ turns)
    if sqrt(fast @ fast / turns.size) < least:
        return False
    longest = min(longest + 1, turns.size // PERIODS)
    correlation = _correlations(fast, longest)
    if correlation.min() > -REPEATS:
        return False
    negative = int((correlation < 0).argmax())
    peak = negative + int(correlation[negative:].argmax())
    if peak + 1 >= longest:  # still rising: the period is longer
        return False
    return bool(correlation[peak] >= REPEATS and correlation[: peak + 1].min() <= -REPEATS)


@cache
def _parabolas(size: int) -> Array:
    """Return an orthonormal basis of the parabolas with this number of values, (size, 3)."""
    return np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 3)).Q


def _correlations(values: Array, longest: int) -> Array:
    """Return the autocorrelation of N values at lags of 1 to `longest`, (longest,). Each is
    normalized by the energies of its two overlapping parts."""
    count = values.size
    products = np.correlate(values, values, "full")[count : count + longest]
    energy = np.cumsum(values**2)
    without_last = energy[-1 - longest : -1][::-1]
    without_first = energy[-1] - energy[:longest]
    return np.asarray(products / np.maximum(np.sqrt(without_last * without_first), 1e-9))
