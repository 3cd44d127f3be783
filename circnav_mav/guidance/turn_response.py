"""How a vehicle answers turn commands: gain, dead time and lag, learnt from what was commanded and how the nose turned.

A dead time, then an answer of first order (a lag) or of second order (a frequency and a damping): the candidates span
what real firmware showed (ArduPilot, PX4). The likely ones are found by least squares of the turned angle in short
bins, with a prior about the mission's `turn_lag_s`; the gain is `turn_gain`. `turn_answer` holds them together.
"""

from collections import deque
from math import exp, inf, log, sqrt
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.turn_monitor import BIN

DEADS = np.arange(0.0, 1.01, 0.1)
"""Candidates of the dead time, s."""
FIRST_ORDER = (0.1, 0.2, 0.35, 0.6, 0.9, 1.3)
"""Candidates of an answer of first order: lags, s."""
SECOND_ORDER = ((3.0, 0.3), (3.0, 0.6), (5.0, 0.3), (5.0, 0.6), (8.0, 0.4))
"""Candidates of an answer of second order: frequencies (rad/s) with dampings."""
LAGS = np.array([*FIRST_ORDER, *(2 * damping / frequency for frequency, damping in SECOND_ORDER)])
"""Mean delay of each answer, s."""
DELAYS = DEADS[:, None] + LAGS
LOG_DELAYS = np.log(np.maximum(DELAYS, 0.05))
"""Logarithm of dead time plus lag, in which the prior is Gaussian."""
RINGING = np.array([*(1 / lag for lag in FIRST_ORDER), *(damping * frequency for frequency, damping in SECOND_ORDER)])
"""How fast each answer settles, 1/s."""
_SECOND = [complex(-z * f, f * (1 - z * z) ** 0.5) for f, z in SECOND_ORDER]
POLES = np.array([*(complex(-1 / lag) for lag in FIRST_ORDER), *_SECOND])
"""Pole of each answer, 1/s; of a pair, the upper one."""
RESIDUES = np.array(
    [*(complex(0.5 / lag) for lag in FIRST_ORDER),
     *(f * f / (2j * pole.imag) for (f, _), pole in zip(SECOND_ORDER, _SECOND, strict=True))]
)  # fmt: skip
"""Each answer as twice the real part of one complex mode, q' = pole q + residue c."""
STEADY = -RESIDUES / POLES
"""Each mode, under a command of 1 that lasts."""
MEMORY = 90.0
"""Time constant of the evidence, s: load and airspeed change slowly, and steady circling teaches nothing new."""
PRIOR_SIGMA = 0.6
"""Standard deviation of the logarithm of dead time plus lag about the mission's value."""
SPLIT_SIGMA = 0.5
"""Standard deviation of the lag's share of that sum about a half."""
LEAST_NOISE = 0.01
"""Standard deviation of a bin's mean turn rate, rad/s, that gusts and the gyro make at least."""
EXPLAINED, LEAST_SLOPE, MOST_SLOPE = 0.6, 0.4, 1.6
"""Share of the turns' variance that the commands must explain, and bounds of the gain of changes, for them to count as
answers; vehicles that follow have .8 and more, and .65 .. 1.2."""
FAR_OFF = 2.0
"""Residual of a bin, in standard deviations, from which on it counts for less."""
KEPT = 4.0
"""Time for which commands are remembered, s: the longest dead time and link delay."""


class Response(NamedTuple):
    """dead: from a command to the first answer, without the link, s. lag: mean delay of the answer, s. settles: how
    fast it does, 1/s. link: there and back, s. learnt: whether flight has told, or only the mission."""

    dead: float
    lag: float
    settles: float
    link: float = 0.0
    learnt: bool = False

    @property
    def delay(self) -> float:
        """All that lies between a command and the turn it asks for, s."""
        return self.dead + self.lag + self.link


Knowledge = tuple[tuple[Array, ...], tuple[Array, float, float, float] | None, Response]
"""Sums, fit and response of a `ResponseLearner`."""


class CandidateTurns:
    """Angles by which each candidate has turned under the commands that were given, all in one sense, rad."""

    def __init__(self) -> None:
        self.commanded: float | None = None
        """Turn rate that is commanded now, rad/s; None: nothing is."""
        self.begun = inf
        """Time of the first command, s."""
        self._turned: deque[tuple[float, Array]] = deque()
        self._mode = np.zeros(LAGS.size, complex)

    def command(self, time: float, rate: float) -> None:
        """Command a turn rate (rad/s) from a time (s) on."""
        if self.commanded is None:
            self._mode, self.begun = STEADY * rate, time
            self._turned.append((time, np.zeros(LAGS.size)))
        else:
            self._advance(time)
        self.commanded = rate

    def reset(self) -> None:
        """Nothing is commanded any more."""
        self.commanded, self.begun = None, inf
        self._turned.clear()

    def at(self, time: float) -> Array | None:
        """Angles at a time, (deads, lags); None before there is any."""
        if time - DEADS[-1] < self._turned[0][0]:
            return None
        self._advance(time)
        turned = list(self._turned)
        place = np.interp(time - DEADS, [at for at, _ in turned], np.arange(len(turned)))
        before = np.minimum(place.astype(int), len(turned) - 2)
        low, high = (np.array([turned[i][1] for i in (before + step).tolist()]) for step in (0, 1))
        return np.asarray(low + (place - before)[:, None] * (high - low))

    def _advance(self, time: float) -> None:
        """Carry the answers of all lags on to a time."""
        last, angle = self._turned[-1]
        step = time - last
        if step <= 0 or self.commanded is None:
            return
        steady = STEADY * self.commanded
        mode = steady + (self._mode - steady) * np.exp(POLES * step)
        self._turned.append((time, angle + 2 * ((mode - self._mode) / POLES + steady * step).real))
        self._mode = mode
        while len(self._turned) > 2 and self._turned[1][0] < time - KEPT:
            self._turned.popleft()


class Binned(NamedTuple):
    """Turn rates over a bin, rad/s. width: s. predicted: by each candidate. turned: as flown."""

    width: float
    predicted: Array
    turned: float


class TurnBins:
    """Cuts a flight into bins in which flown and predicted turns are compared."""

    def __init__(self, candidates: CandidateTurns) -> None:
        self._candidates = candidates
        self._begin: tuple[float, float, float, Array | None] | None = None
        """Time, s, turned angle, delay of the link and the candidates' angles at the begin of this bin."""

    def take(self, time: float, turned: float, link: float) -> Binned | None:
        """Take in an angle turned (rad, from anywhere, unwrapped) by a time (s); return the bin that it completes.
        link: there and back, s."""
        if self._candidates.commanded is None or (self._begin is not None and time - self._begin[0] < BIN):
            return None
        begin, angles = self._begin, self._candidates.at(time - link)
        self._begin = time, turned, link, angles
        if begin is None or time - begin[0] > 2 * BIN:
            return None
        began, turned_before, link_before, angles_before = begin
        if link != link_before:
            # The estimate of the delay jumps with a late answer. Both ends of a bin go by one delay: else it would hold
            # commands of another length of time, and a vehicle on its circle seemed to be sent the other way.
            angles_before = self._candidates.at(began - link)
        if angles is None or angles_before is None:
            return None
        width = time - began
        return Binned(width, (angles - angles_before) / width, (turned - turned_before) / width)

    def reset(self) -> None:
        """Begin anew."""
        self._begin = None


class ResponseLearner:
    """Learns in flight how one vehicle answers."""

    def __init__(self, expected: float) -> None:
        """expected: dead time plus lag before the flight has told, s."""
        prior = (LOG_DELAYS - log(max(expected, 0.05))) / PRIOR_SIGMA
        self._prior = -0.5 * (prior**2 + ((LAGS / DELAYS - 0.5) / SPLIT_SIGMA) ** 2)
        self._sums: tuple[Array, ...] = (0.0,) * 6
        """Of 1, model, rate, model^2, model rate and rate^2, where the model is an array of all candidates."""
        self.candidates = CandidateTurns()
        self._bins = TurnBins(self.candidates)
        self._fit: tuple[Array, float, float, float] | None = None
        self._known = Response(0.5 * expected, 0.5 * expected, 2 / max(expected, 0.05))

    def response(self, link: float) -> Response:
        """As known now; link: there and back, s."""
        if link != self._known.link:
            self._known = self._known._replace(link=link)
        return self._known

    def command(self, time: float, rate: float) -> None:
        """From this time on the vehicle is told to turn at `rate`, rad/s."""
        self.candidates.command(time, rate)

    def reset(self) -> None:
        """The vehicle is not ours any more: what comes now is not our doing."""
        self.candidates.reset()
        self._bins.reset()

    @property
    def knowledge(self) -> "Knowledge":
        """What flight has taught."""
        return self._sums, self._fit, self._known

    @knowledge.setter
    def knowledge(self, before: "Knowledge") -> None:
        self._sums, self._fit, self._known = before

    def skip(self) -> None:
        """The vehicle does not obey: its turns from now on are no answers."""
        self._bins.reset()

    def feel(self, time: float, turned: float, link: float) -> None:
        """By how much the vehicle has turned (rad, from anywhere, unwrapped) by a time (s); link: there and back, s."""
        if (new := self._bins.take(time, turned, link)) is not None:
            self._learn(new.predicted, new.turned, new.width)

    def _weight(self, model: Array, rate: float) -> float:
        """Of a bin: less for one far from what the best candidate says. A step that takes the roll to its rate limit
        is answered later than any other, and one of them would count for more than a minute on the circle."""
        if self._fit is None:
            return 1.0
        best, slope, offset, noise = self._fit
        residual = float(abs(rate - slope * model[best] - offset))
        return min(1.0, (FAR_OFF * noise / max(residual, 1e-9)) ** 2)

    def _learn(self, model: Array, rate: float, width: float) -> None:
        """Take in the mean turn rate of a bin, and what the candidates say of it."""
        keep, share = exp(-width / MEMORY), self._weight(model, rate)
        now = 1.0, model, rate, model * model, model * rate, rate * rate
        self._sums = tuple(old * keep + share * new for old, new in zip(self._sums, now, strict=True))
        n, m, s, mm, my, yy = self._sums
        if n < 10:
            return
        var, cov, all_ = mm - m * m / n, my - m * s / n, yy - s * s / n
        left = np.maximum(all_ - np.maximum(cov, 0.0) ** 2 / np.maximum(var, 1e-9), 0.0)
        noise = max(float(left.min() / n), LEAST_NOISE**2)
        likely = self._prior - 0.5 * left / noise
        best = np.unravel_index(likely.argmax(), likely.shape)
        slope = cov[best] / max(var[best], 1e-9)
        self._fit = best, slope, (s - slope * m[best]) / n, sqrt(noise)
        # the turns of a vehicle that does not hear us, or only circles, are no answers to our commands
        if cov[best] ** 2 <= EXPLAINED * var[best] * all_ or not LEAST_SLOPE < slope < MOST_SLOPE:
            return
        weight = np.exp(likely - likely.max())
        weight /= weight.sum()
        of_dead, of_answer = weight.sum(axis=1), weight.sum(axis=0)
        # what flight tells first is the sum of both; half of the prior's spread is a clear word
        middle = (weight * LOG_DELAYS).sum()
        if (weight * (LOG_DELAYS - middle) ** 2).sum() > (0.5 * PRIOR_SIGMA) ** 2:
            return
        dead, lag = float(of_dead @ DEADS), float(of_answer @ LAGS)
        scale = float(np.exp(middle)) / (dead + lag)
        settles = float(1 / (of_answer @ (1 / RINGING)))
        self._known = Response(scale * dead, scale * lag, settles, learnt=True)
