"""Response of a vehicle to turn commands: dead time and lag, learned from commanded and flown
turns.

Each candidate is a dead time and a response of first order (a lag) or of second order (a frequency
and a damping). The candidates cover the measured range of real firmware (ArduPilot, PX4). Their
weights follow from least squares of the turned angle in short bins. The prior is centered on the
mission's `turn_lag_s`. `vehicle_model` combines the response with the gain.
"""

from collections import deque
from copy import copy
from math import exp, inf, log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.recursive_least_squares import RecursiveLeastSquares

Array = NDArray[Any]
BIN = 0.2
"""Width of a bin, s: shorter bins contain too much gyro noise, longer ones do not resolve the
delay."""
DEADS = np.arange(0.0, 1.01, 0.1)
"""Candidates of the dead time, s."""
FIRST_ORDER = (0.1, 0.2, 0.35, 0.6, 0.9, 1.3)
"""Candidates of a first-order response: lags, s."""
SECOND_ORDER = (*((f, z) for f in (3.0, 5.0) for z in (0.3, 0.6)), (8.0, 0.4))
"""Candidates of a second-order response: frequencies (rad/s) with dampings."""
LAGS = np.array([*FIRST_ORDER, *(2 * damping / frequency for frequency, damping in SECOND_ORDER)])
"""Mean delay of each response, s."""
DELAYS = DEADS[:, None] + LAGS
LOG_DELAYS = np.log(DELAYS)
"""Logarithm of dead time plus lag, in which the prior is Gaussian."""
RINGING = np.array(
    [
        *(1 / lag for lag in FIRST_ORDER),
        *(damping * frequency for frequency, damping in SECOND_ORDER),
    ]
)
"""Settling rate of each response, 1/s."""
_SECOND = [complex(-z * f, f * (1 - z * z) ** 0.5) for f, z in SECOND_ORDER]
POLES = np.array([*(complex(-1 / lag) for lag in FIRST_ORDER), *_SECOND])
"""Pole of each response, 1/s. A second-order response has a complex pair: the pole with positive
imaginary part."""
RESIDUES = np.array(
    [*(complex(0.5 / lag) for lag in FIRST_ORDER),
     *(f * f / (2j * pole.imag) for (f, _), pole in zip(SECOND_ORDER, _SECOND, strict=True))]
)  # fmt: skip
"""Residue of each response, 1/s. The response is 2 Re(q) of one complex mode, q' = pole q + residue
command."""
STEADY = -RESIDUES / POLES
"""Steady state of each mode under a constant turn command of 1 rad/s."""
PRIOR_SIGMA = 0.6
"""Standard deviation of the logarithm of dead time plus lag about the mission's value."""
EXPLAINED = 0.6
"""Least share of the flown turns' variance that the commands explain. With less, the flown turns
are not used to learn the response. Vehicles that follow have a share of 0.8 and more."""
LEAST_SLOPE = 0.4
"""Lower bound of the slope of flown over predicted turns, for turns to be used. Vehicles that
follow have slopes of 0.65 to 1.2."""
MOST_SLOPE = 1.6
"""Upper bound of the slope of flown over predicted turns, for turns to be used."""


class Response(NamedTuple):
    """Delays of the response.

    dead: dead time without the link, s.
    lag: mean delay of the response after the dead time, s.
    settles: settling rate, 1/s.
    link: round-trip delay of the link, s.
    """

    dead: float
    lag: float
    settles: float
    link: float = 0.0

    @property
    def delay(self) -> float:
        """Total delay from a command to its turn, s."""
        return self.dead + self.lag + self.link


class CandidateTurns:
    """Predicted turned angle of each candidate under the sent commands, unwrapped, rad."""

    def __init__(self) -> None:
        self.commanded: float | None = None
        """Turn rate commanded now, rad/s, or None."""
        self._turned: deque[tuple[float, Array]] = deque()
        self._mode = np.zeros(LAGS.size, complex)

    def command(self, time: float, rate: float) -> None:
        """Record a commanded turn rate (rad/s) and the time (s) of its start."""
        if self.commanded is None:
            self._mode = STEADY * rate
            self._turned.append((time, np.zeros(LAGS.size)))
        else:
            self._advance(time)
        self.commanded = rate

    def reset(self) -> None:
        """Forget the commands."""
        self.commanded = None
        self._turned.clear()

    def at(self, time: float) -> Array | None:
        """Return the angles at a time (s), as an array (deads, lags), or None if the commands do
        not cover the dead times yet."""
        if time - DEADS[-1] < self._turned[0][0]:
            return None
        self._advance(time)
        turned = list(self._turned)
        place = np.interp(time - DEADS, [at for at, _ in turned], np.arange(len(turned)))
        before = np.minimum(place.astype(int), len(turned) - 2)
        low, high = (np.array([turned[i][1] for i in (before + step).tolist()]) for step in (0, 1))
        return np.asarray(low + (place - before)[:, None] * (high - low))

    def _advance(self, time: float) -> None:
        """Propagate the responses of all lags to a time."""
        last, angle = self._turned[-1]
        step = time - last
        if step <= 0 or self.commanded is None:
            return
        steady = STEADY * self.commanded
        mode = steady + (self._mode - steady) * np.exp(POLES * step)
        self._turned.append((time, angle + 2 * ((mode - self._mode) / POLES + steady * step).real))
        self._mode = mode
        # Time for which commands are stored, s: the longest dead time plus the longest link delay.
        while len(self._turned) > 2 and self._turned[1][0] < time - 4.0:
            self._turned.popleft()


class TurnBin(NamedTuple):
    """Mean turn rates over a short time.

    time: end of the bin, s.
    width: duration, s.
    predicted: turn rate predicted by each candidate, rad/s, (deads, lags).
    flown: measured turn rate, rad/s.
    """

    time: float
    width: float
    predicted: Array
    flown: float


class TurnBins:
    """Divides a flight into bins of flown and predicted turn rates."""

    def __init__(self, candidates: CandidateTurns) -> None:
        self._candidates = candidates
        self._begin: tuple[float, float, float, Array | None] | None = None
        """Time (s), turned angle, link delay and candidates' angles at the start of this bin."""

    def add(self, time: float, turned: float, link: float) -> TurnBin | None:
        """Add the turned angle (rad, unwrapped, any origin) at a time (s). Return the completed
        bin, or None. link: round-trip delay of the link, s."""
        if self._candidates.commanded is None:
            return None
        if self._begin is not None and time - self._begin[0] < BIN:
            return None
        begin = self._begin
        angles = self._candidates.at(time - link)
        self._begin = (time, turned, link, angles)
        if begin is None or time - begin[0] > 2 * BIN:
            return None
        began, turned_before, link_before, angles_before = begin
        if link != link_before:
            # The estimated link delay jumps with a late reply. Use the same delay for both ends of
            # a bin. Otherwise the predicted turn covers a longer or shorter time than the flown
            # turn. On a circle this once gave a predicted turn of the wrong sign.
            angles_before = self._candidates.at(began - link)
        if angles is None or angles_before is None:
            return None
        width = time - began
        return TurnBin(
            time, width, (angles - angles_before) / width, (turned - turned_before) / width
        )

    def reset(self) -> None:
        """Discard the current bin."""
        self._begin = None


class ResponseLearner:
    """Learns the response of a vehicle in flight."""

    MEMORY = 90.0
    """Forgetting time of the least squares, s. Load and airspeed change slowly, and steady circling
    adds no information."""

    def __init__(self, expected: float) -> None:
        """expected: initial dead time plus lag, s."""
        least = float(DELAYS.min())
        prior = (LOG_DELAYS - log(max(expected, least))) / PRIOR_SIGMA
        # Standard deviation of lag/(dead time + lag) about its mean of 0.5.
        self._prior = -0.5 * (prior**2 + ((LAGS / DELAYS - 0.5) / 0.5) ** 2)
        self._fit = RecursiveLeastSquares(self.MEMORY)
        self._best: tuple[Any, float, float, float] | None = None
        """Best candidate, its slope, offset (rad/s) and noise (rad/s)."""
        self._response = Response(0.5 * expected, 0.5 * expected, 2 / max(expected, least))

    @property
    def knowledge(self) -> tuple[Any, ...]:
        """Copy of the learned state, for `restore`."""
        return copy(self._fit), self._best, self._response

    def restore(self, knowledge: tuple[Any, ...]) -> None:
        """Return to an earlier learned state."""
        self._fit, self._best, self._response = knowledge
        self._fit = copy(self._fit)

    def response(self, link: float) -> Response:
        """Return the response as learned so far. link: round-trip delay of the link, s."""
        return self._response._replace(link=link)

    def learn(self, new: TurnBin) -> None:
        """Learn from a bin."""
        predicted = new.predicted
        share = 1.0
        # A large step in the command saturates the roll rate, and so has a longer delay than small
        # steps. With full weight, one such step would affect the fit for more than a minute on the
        # circle.
        if self._best is not None:
            best, slope, offset, noise = self._best
            residual = float(abs(new.flown - slope * predicted[best] - offset))
            # 2.0: residual of a bin, in standard deviations, above which its weight decreases.
            share = min(1.0, (2.0 * noise / max(residual, 1e-9)) ** 2)
        fit = self._fit
        fit.add(predicted, new.flown, new.width, share)
        if fit.n < 10:
            return
        spread = fit.spread()
        product = fit.product()
        variation = fit.variation()
        unexplained = variation - np.maximum(product, 0.0) ** 2 / np.maximum(spread, 1e-9)
        unexplained = np.maximum(unexplained, 0.0)
        # Lower bound of the noise of a bin's mean turn rate, rad/s, from gusts and the gyro.
        noise = max(float(unexplained.min() / fit.n), 0.01**2)
        likely = self._prior - 0.5 * unexplained / noise
        best = np.unravel_index(likely.argmax(), likely.shape)
        slope = float(product[best] / max(spread[best], 1e-9))
        offset = float((fit.y - slope * fit.x[best]) / fit.n)
        self._best = (best, slope, offset, sqrt(noise))
        # Reject turns that the commands do not explain: the vehicle may not receive commands, or
        # may only circle.
        explained = product[best] ** 2 > EXPLAINED * spread[best] * variation
        if explained and LEAST_SLOPE < slope < MOST_SLOPE:
            self._accept(likely)

    def _accept(self, likely: Array) -> None:
        """Use the weighted mean of the candidates from now on, once it is precise enough."""
        weight = np.exp(likely - likely.max())
        weight /= weight.sum()
        # The sum of dead time and lag becomes observable first. Accept the response once the sum
        # has half of the prior's spread.
        middle = (weight * LOG_DELAYS).sum()
        if (weight * (LOG_DELAYS - middle) ** 2).sum() > (0.5 * PRIOR_SIGMA) ** 2:
            return
        dead = float(weight.sum(axis=1) @ DEADS)
        by_response = weight.sum(axis=0)
        lag = float(by_response @ LAGS)
        scale = float(np.exp(middle)) / (dead + lag)
        settles = float(1 / (by_response @ (1 / RINGING)))
        self._response = Response(scale * dead, scale * lag, settles)


class Pending(NamedTuple):
    """Commanded turn that is not flown yet.

    turn: pending turn, rad.
    ahead: delay of the response, s.
    settles: settling rate of the response, 1/s.
    measurement_delay: delay of the reported turn rate, s.
    most: largest turn rate that the vehicle reaches, rad/s.
    """

    turn: float
    ahead: float
    settles: float = 10.0
    measurement_delay: float = 0.0
    most: float = inf


class PendingTurn:
    """Model of the commanded turn that is not flown yet: commands younger than the dead time, and
    the turn that the lag still adds.

    The loop is closed on the commanded heading, so that it does not contain the modeled delay.
    Source: Smith, "Closer control of loops with dead time" (1957).
    """

    def __init__(self) -> None:
        self._commands: deque[tuple[float, float]] = deque()
        self._rate: float | None = None
        """Turn rate of the model, rad/s, at the time `_at`, s."""
        self._at = 0.0

    def command(self, time: float, rate: float) -> None:
        """Record an expected turn rate (rad/s) and the time (s) of its command."""
        self._commands.append((time, rate))

    def reset(self) -> None:
        """Forget the commands."""
        self._commands.clear()
        self._rate = None

    def at(self, now: float, response: Response, turn_rate: float) -> Pending:
        """Return the pending turn. turn_rate: turn rate of the vehicle now, rad/s, from which the
        model starts after a reset."""
        dead = response.dead + response.link
        if not self._commands:
            return Pending(0.0, response.delay, response.settles)
        if self._rate is None:
            self._rate = turn_rate
            self._at = self._commands[0][0] + dead
        rate = self._rate
        at = self._at
        # Until the first command arrives, the vehicle keeps the turn of its previous controller.
        turn = turn_rate * min(max(self._commands[0][0] - (now - dead), 0.0), dead)
        ends = [*[time for time, _ in self._commands][1:], now]
        for (begin, command), end in zip(self._commands, ends, strict=True):
            arrived = min(end + dead, now)
            if arrived > at:
                rate = command + (rate - command) * exp(-(arrived - at) / max(response.lag, 1e-3))
                at = arrived
            turn += command * max(end - max(begin, now - dead), 0.0)
        while len(self._commands) > 1 and self._commands[1][0] + dead <= at:
            self._commands.popleft()
        self._rate = rate
        self._at = at
        return Pending(turn + response.lag * rate, response.delay, response.settles)
