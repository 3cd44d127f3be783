"""Response of a vehicle to turn commands: dead time and lag, learned from commanded and flown
turns.

Each candidate is a dead time and a response of first order (a lag) or of second order (a frequency
and a damping). The candidates cover the measured range of real firmware (ArduPilot, PX4). They are
weighted by least squares of the turned angle in short bins, with a prior centered on the mission's
`turn_lag_s`. `turn_gain` learns the gain. `turn_answer` combines response and gain.
"""

from collections import deque
from math import exp, inf, log, sqrt
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.turn_monitor import BIN, TurnBin

DEADS = np.arange(0.0, 1.01, 0.1)
"""Candidates of the dead time, s."""
FIRST_ORDER = (0.1, 0.2, 0.35, 0.6, 0.9, 1.3)
"""Candidates of a first-order response: lags, s."""
SECOND_ORDER = ((3.0, 0.3), (3.0, 0.6), (5.0, 0.3), (5.0, 0.6), (8.0, 0.4))
"""Candidates of a second-order response: frequencies (rad/s) with dampings."""
LAGS = np.array([*FIRST_ORDER, *(2 * damping / frequency for frequency, damping in SECOND_ORDER)])
"""Mean delay of each response, s."""
DELAYS = DEADS[:, None] + LAGS
LOG_DELAYS = np.log(np.maximum(DELAYS, 0.05))
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
MEMORY = 90.0
"""Forgetting time of the least squares, s. Load and airspeed change slowly, and steady circling
adds no information."""
PRIOR_SIGMA = 0.6
"""Standard deviation of the logarithm of dead time plus lag about the mission's value."""
SPLIT_SIGMA = 0.5
"""Standard deviation of lag/(dead time + lag) about its mean of 0.5."""
LEAST_NOISE = 0.01
"""Lower bound of the noise of a bin's mean turn rate, rad/s, from gusts and the gyro."""
EXPLAINED = 0.6
LEAST_SLOPE = 0.4
MOST_SLOPE = 1.6
"""Conditions for turns to count as responses: least share of their variance explained by the
commands, and bounds of their slope over the predicted turns. Vehicles that follow have a share of
0.8 and more, and slopes of 0.65 to 1.2."""
FAR_OFF = 2.0
"""Residual of a bin, in standard deviations, above which the weight of the bin decreases."""
KEPT = 4.0
"""Time for which commands are kept, s: the longest dead time and link delay."""


class Response(NamedTuple):
    """Delays of the response. dead: dead time without the link, s. lag: mean delay of the response,
    s. settles: settling rate, 1/s. link: round trip, s."""

    dead: float
    lag: float
    settles: float
    link: float = 0.0

    @property
    def delay(self) -> float:
        """Total delay from a command to its turn, s."""
        return self.dead + self.lag + self.link


class Knowledge(NamedTuple):
    """Learned state. response: delays, as used now. sums: weighted sums of 1, x, y, x^2, x y and
    y^2 over the bins. x: turn rates that the candidates predict, rad/s, an array. y: flown turn
    rate, rad/s. fit: best candidate, its slope, offset (rad/s) and noise (rad/s), or None."""

    response: Response
    sums: tuple[Array, ...] = (0.0,) * 6
    fit: tuple[Array, float, float, float] | None = None


class CandidateTurns:
    """Predicted turned angle of each candidate under the sent commands, unwrapped, rad."""

    def __init__(self) -> None:
        self.commanded: float | None = None
        """Turn rate commanded now, rad/s, or None."""
        self.begun = inf
        """Time of the first command, s."""
        self._turned: deque[tuple[float, Array]] = deque()
        self._mode = np.zeros(LAGS.size, complex)

    def command(self, time: float, rate: float) -> None:
        """Record a commanded turn rate (rad/s) and the time (s) of its start."""
        if self.commanded is None:
            self._mode = STEADY * rate
            self.begun = time
            self._turned.append((time, np.zeros(LAGS.size)))
        else:
            self._advance(time)
        self.commanded = rate

    def reset(self) -> None:
        """Forget the commands."""
        self.commanded = None
        self.begun = inf
        self._turned.clear()

    def at(self, time: float) -> Array | None:
        """Return the angles at a time, (deads, lags), or None if the commands do not cover the dead
        times yet."""
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
        while len(self._turned) > 2 and self._turned[1][0] < time - KEPT:
            self._turned.popleft()


class TurnBins:
    """Divides a flight into bins of flown and predicted turn rates."""

    def __init__(self, candidates: CandidateTurns) -> None:
        self._candidates = candidates
        self._begin: tuple[float, float, float, Array | None] | None = None
        """Time (s), turned angle, link delay and the candidates' angles at the start of this
        bin."""

    def take(self, time: float, turned: float, link: float) -> TurnBin | None:
        """Add the turned angle (rad, unwrapped, any origin) at a time (s). Return the completed
        bin, or None. link: round trip, s."""
        if self._candidates.commanded is None or (
            self._begin is not None and time - self._begin[0] < BIN
        ):
            return None
        begin = self._begin
        angles = self._candidates.at(time - link)
        self._begin = time, turned, link, angles
        if begin is None or time - begin[0] > 2 * BIN:
            return None
        began, turned_before, link_before, angles_before = begin
        if link != link_before:
            # The estimated link delay jumps with a late reply. Use one delay for both ends of a
            # bin. Otherwise the predicted turn covers a longer or shorter time than the flown one:
            # a vehicle on its circle once seemed to be commanded the other way.
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

    def __init__(self, expected: float) -> None:
        """expected: initial dead time plus lag, s."""
        prior = (LOG_DELAYS - log(max(expected, 0.05))) / PRIOR_SIGMA
        self._prior = -0.5 * (prior**2 + ((LAGS / DELAYS - 0.5) / SPLIT_SIGMA) ** 2)
        self.candidates = CandidateTurns()
        self._bins = TurnBins(self.candidates)
        self.knowledge = Knowledge(
            Response(0.5 * expected, 0.5 * expected, 2 / max(expected, 0.05))
        )

    def response(self, link: float) -> Response:
        """Return the response as learned so far. link: round trip, s."""
        return self.knowledge.response._replace(link=link)

    def reset(self) -> None:
        """Forget the commands. Call when the vehicle is no longer controlled from here."""
        self.candidates.reset()
        self._bins.reset()

    def skip(self) -> None:
        """Discard the current bin. Call while the vehicle does not follow: its turns are no
        responses."""
        self._bins.reset()

    def on_motion(self, time: float, turned: float, link: float) -> None:
        """Learn from the turned angle (rad, unwrapped, any origin) at a time (s). link: round trip,
        s."""
        if (new := self._bins.take(time, turned, link)) is not None:
            self._learn(new.predicted, new.flown, new.width)

    def _learn(self, model: Array, rate: float, width: float) -> None:
        """Update the fit with the mean turn rate of a bin and its prediction by each candidate."""
        keep = exp(-width / MEMORY)
        share = 1.0
        (response, sums, fit) = self.knowledge
        # A step that saturates the roll rate has a longer delay than any other. With full weight,
        # one such step would affect the fit for more than a minute on the circle.
        if fit is not None:
            best, slope, offset, noise = fit
            residual = float(abs(rate - slope * model[best] - offset))
            share = min(1.0, (FAR_OFF * noise / max(residual, 1e-9)) ** 2)
        now = 1.0, model, rate, model * model, model * rate, rate * rate
        sums = tuple(old * keep + share * new for old, new in zip(sums, now, strict=True))
        self.knowledge = Knowledge(response, sums, fit)
        n, m, s, mm, my, yy = sums
        if n < 10:
            return
        var = mm - m * m / n
        cov = my - m * s / n
        all_ = yy - s * s / n
        left = np.maximum(all_ - np.maximum(cov, 0.0) ** 2 / np.maximum(var, 1e-9), 0.0)
        noise = max(float(left.min() / n), LEAST_NOISE**2)
        likely = self._prior - 0.5 * left / noise
        best = np.unravel_index(likely.argmax(), likely.shape)
        slope = cov[best] / max(var[best], 1e-9)
        fit = best, slope, (s - slope * m[best]) / n, sqrt(noise)
        self.knowledge = Knowledge(response, sums, fit)
        # Reject turns that the commands do not explain: the vehicle may not receive commands, or
        # may only circle.
        if cov[best] ** 2 <= EXPLAINED * var[best] * all_ or not LEAST_SLOPE < slope < MOST_SLOPE:
            return
        weight = np.exp(likely - likely.max())
        weight /= weight.sum()
        of_dead = weight.sum(axis=1)
        of_answer = weight.sum(axis=0)
        # The sum of dead time and lag becomes observable first. Accept the response once the sum
        # has half of the prior's spread.
        middle = (weight * LOG_DELAYS).sum()
        if (weight * (LOG_DELAYS - middle) ** 2).sum() > (0.5 * PRIOR_SIGMA) ** 2:
            return
        dead = float(of_dead @ DEADS)
        lag = float(of_answer @ LAGS)
        scale = float(np.exp(middle)) / (dead + lag)
        settles = float(1 / (of_answer @ (1 / RINGING)))
        self.knowledge = Knowledge(Response(scale * dead, scale * lag, settles), sums, fit)
