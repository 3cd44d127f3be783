"""Compares commanded and flown turns over a sliding window: does the vehicle follow, and does the turn swing?

Both are judged by bins of 0.2 s: the commanded turn rate, the flown one (of a plane: that of its bank), and what each
candidate of `turn_response` predicts. No range enters, so a wrong range raises nothing.

Follows: least squares of the flown on the predicted turns. A vehicle that follows turns at a third of a prediction or
more, with one of the delays that vehicles have. One that does not is explained better by a constant turn (it ignores
commands), by a negative gain (it is reversed) or by one below a fifth (it is weak).

Swings: autocorrelation of the fast part of the turns. In a limit cycle they repeat themselves after one period and are
reversed after half of it. Gusts and noise are as large, but have no period.
"""

from collections import deque
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.maths import Batch

BIN = 0.2
"""Width of a bin, s: shorter ones see the gyro's noise, longer ones lose the delay."""
LONGEST_GAP = 1.0
"""Gap between two bins, s, after which the window begins anew: what was flown meanwhile is not known."""
BEGINS = 1.6
"""Time after the first command, s, from which on turns are compared: before, the vehicle still does what it did."""

LEAST_GAIN, MOST_GAIN = 1 / 3, 1.6
"""Gains of a vehicle that follows. At a bank limit below the mission's a plane turns at down to a third."""
WEAK_GAIN, REVERSED_GAIN = 0.2, -1.6
"""Gains of one that does not. Between a fifth and a third nothing is said: neither side is sure."""
WINDOWS = 12, 20, 50
"""Bins over which it is judged: 2.4 s of hard turns are enough, small ones take 10 s."""
BETTER = 0.3
"""Share of the squared error of following that is left by not following, from which on that is believed. Gusts that
turn the nose, 0.1 rad/s on the emulated vehicles, leave more than half."""
EVIDENCE = 0.0007
"""Integral of the difference of both squared errors, rad^2/s, that is needed: 0.05 rad/s (3 deg/s) that are not flown
for 2.4 s, or 0.025 for 10 s. A bank that is 3 deg off its trim is 0.023 rad/s at 22 m/s."""
IN_A_ROW = 2
"""Bins in a row that must agree."""

SWING_WINDOW, LEAST_SWING_WINDOW = 72, 36
"""Most and least bins over which a swing is looked for: 14.4 s are four periods of the slowest cycle, 7.2 s those of
1.8 s."""
LONGEST_PERIOD = 18
"""Longest period of a cycle, bins: 3.6 s. On firmware they had 1 to 4.6 s, most below 2.5. Slower ones cannot be told
from a search, which weaves in 6 s and turns from one guess to the next in 4.4 to 5."""
PERIODS = 4.0
"""Periods that the window must hold: of the turns to and fro of an approach there are fewer, and of gusts that happen
to repeat themselves."""
LASTS = 5
"""Bins in a row in which a swing must be regular."""
LEAST_SWING = 0.25
"""Root mean square of the fast part, in units of the limit, from which on a swing matters."""
REPEATS, REVERSES = 0.8, -0.75
"""Autocorrelation after a period, at least, and half a period before it, at most. On the emulated vehicles limit cycles
have 0.9 and more of both; sound loops in gusts of 3 m/s 0.6, approaches and searches 0.71 at the most."""
LOWERED, LEAST = 0.7, 0.15
"""What a cycle leaves of the gains, and what is always left. A loop with a damping of 0.06 is quiet from a third of the
gains on, one of 0.05 at 3 rad/s from a sixth. A tenth no longer held a circle of 60 m in wind (71 m off)."""


class Swing(NamedTuple):
    """size: root mean square of the fast part, rad/s. period: s, inf without one. repeats, reverses: autocorrelation
    after a whole and half a period."""

    size: float = 0.0
    period: float = inf
    repeats: float = 0.0
    reverses: float = 0.0

    @property
    def regular(self) -> bool:
        """True if it has the rhythm of a limit cycle."""
        return self.repeats >= REPEATS and self.reverses <= REVERSES


class TurnBin(NamedTuple):
    """time: of its end, s. predicted: turn rate by each candidate, rad/s. flown, commanded: rad/s."""

    time: float
    predicted: Batch
    flown: float
    commanded: float


class TurnMonitor:
    """follows: False once the vehicle was found not to follow turn commands. since: when that was found, s. share: of
    the gains that is left after cycles. cycles: times that they were lowered. swing: of the newest bins. swings: True
    while the turn is in a limit cycle."""

    def __init__(self, limit: float) -> None:
        """limit: of the commanded turn rate, rad/s."""
        self._limit = limit
        self._bins: deque[TurnBin] = deque(maxlen=max(WINDOWS))
        self._turns: deque[tuple[float, float]] = deque(maxlen=SWING_WINDOW)
        self._in_a_row = self._regular = 0
        self.follows, self.since = True, inf
        self.share, self.cycles = 1.0, 0
        self.swing, self.swings = Swing(), False

    def take(self, new: TurnBin, begun: float) -> None:
        """Take in a bin. begun: time of the first command to this vehicle, s."""
        if self._bins and new.time - self._bins[-1].time > LONGEST_GAP:
            self._forget()
        if new.time - begun < BEGINS:
            return
        self._bins.append(new)
        self._turns.append((new.flown, new.commanded))
        self._judge_following(new.time)
        self._judge_swing()

    def reset(self) -> None:
        """Another has the vehicle now."""
        self._forget()
        self.follows, self.since = True, inf

    def _forget(self) -> None:
        self._bins.clear()
        self._turns.clear()
        self._in_a_row = self._regular = 0
        self.swings = False

    def _judge_following(self, now: float) -> None:
        judged = [_evidence(self._bins, width) for width in WINDOWS if len(self._bins) >= width]
        verdict = min(judged, default=0) if min(judged, default=0) < 0 else max(judged, default=0)
        self._in_a_row = self._in_a_row + verdict if verdict * self._in_a_row >= 0 else verdict
        if self._in_a_row <= -IN_A_ROW and self.follows:
            self.follows, self.since = False, now
        elif self._in_a_row >= IN_A_ROW and not self.follows:
            self.follows, self.since = True, inf

    def _judge_swing(self) -> None:
        if len(self._turns) < LEAST_SWING_WINDOW:
            return
        flown, commanded = (find_swing(np.array(turns)) for turns in zip(*self._turns, strict=True))
        self.swing = max(flown, commanded, key=lambda swing: (swing.regular, swing.size))
        regular = self.swing.regular and self.swing.size >= LEAST_SWING * self._limit
        self._regular = self._regular + 1 if regular else 0
        self.swings = self._regular >= LASTS
        if self.swings:
            self.share, self.cycles = max(self.share * LOWERED, LEAST), self.cycles + 1
            # what was flown with the gains of before says nothing of those of now
            self._turns.clear()
            self._regular = 0


def _evidence(bins: deque[TurnBin], width: int) -> int:
    """-1 if the newest bins show that the vehicle does not follow, +1 if they show that it does, 0 if neither. A turn
    that does not change shows the latter never: it may be the vehicle's own."""
    newest = list(bins)[-width:]
    flown = np.array([one.flown for one in newest])
    predicted = np.array([one.predicted for one in newest])
    square, product = (predicted**2).sum(0), flown @ predicted

    def errors(least: float, most: float) -> Batch:
        gain = np.clip(product / np.maximum(square, 1e-9), least, most)
        return np.asarray((flown[:, None] - gain * predicted) ** 2)

    # One bin may be wrong: an attitude that came late, a setpoint that was lost. Not following lasts.
    followed = errors(LEAST_GAIN, MOST_GAIN)
    following = float((followed.sum(0) - followed.max(0)).min())
    weak = float(errors(REVERSED_GAIN, WEAK_GAIN).sum(0).min())
    other = min(weak, float(flown @ flown) - float(flown.sum()) ** 2 / width)
    if abs(following - other) * BIN < EVIDENCE:
        return 0
    return -1 if other < BETTER * following else int(following < BETTER * other)


def find_swing(turns: Batch) -> Swing:
    """The swing of turn rates (rad/s) in bins, whose slow part is what wind and the way to the circle ask for."""
    place = np.linspace(-1.0, 1.0, turns.size)
    fast = turns - np.polyval(np.polyfit(place, turns, 2), place)
    size = sqrt(float(np.mean(fast**2)))
    longest = min(LONGEST_PERIOD + 1, int(turns.size / PERIODS))
    correlation = np.array([_correlation(fast[:-lag], fast[lag:]) for lag in range(1, longest + 1)])
    negative = np.flatnonzero(correlation < 0)
    if not negative.size:
        return Swing(size)
    peak = int(negative[0]) + int(correlation[negative[0] :].argmax())
    if peak + 1 >= longest:  # it still rises: a longer period than any cycle's
        return Swing(size)
    half = correlation[: peak + 1].min()
    return Swing(size, BIN * (peak + 1), float(correlation[peak]), float(half))


def _correlation(a: Batch, b: Batch) -> float:
    return float(a @ b / max(sqrt(float(a @ a) * float(b @ b)), 1e-9))
