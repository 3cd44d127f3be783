"""How a vehicle answers turn commands: gain, dead time and lag, learnt from what was commanded and how the nose turned.

A dead time, then an answer of first order (a lag) or of second order (a frequency and a damping): the candidates span
what real firmware showed (ArduPilot, PX4). The likely ones are found by least squares of the turned angle in short
bins, with a prior about the mission's `turn_lag_s`; the gain is `turn_gain`. `TurnAnswer` holds them together.
"""

from collections import deque
from math import exp, inf, log, pi, remainder, sqrt
from typing import NamedTuple

import numpy as np

from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.turn_gain import TurnGain, learn
from circnav_mav.guidance.turn_monitor import BIN, TurnBin, TurnMonitor
from circnav_mav.guidance.types import OwnMotion

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


class Pending(NamedTuple):
    """turn: commanded but not turned yet, rad. ahead: the time it takes, s. settles: how fast the vehicle's answer
    does, 1/s. told_late: how much later than it is flown a turn is known, s. most: turn rate that the vehicle reaches,
    rad/s."""

    turn: Array
    ahead: Array
    settles: Array = 10.0
    told_late: float = 0.0
    most: Array = inf


class PendingTurn:
    """What is commanded but not turned yet: the commands of the dead time, and what the lag still holds back.

    Commands (rad/s, what the vehicle is expected to turn at) are numbers, or arrays (B,) of flights that are commanded
    together. With it the loop is closed on the heading that is already commanded, so that the delay that is modelled
    leaves the loop (Smith, "Closer control of loops with dead time", 1957).
    """

    def __init__(self) -> None:
        self._commands: deque[tuple[float, Array]] = deque()
        self._rate: Array | None = None
        self._at = 0.0

    def command(self, time: float, rate: Array) -> None:
        """From this time (s) on the vehicle is told to turn at this rate."""
        self._commands.append((time, rate))

    def reset(self) -> None:
        """Nobody commands any more."""
        self._commands.clear()
        self._rate = None

    def at(self, now: float, response: Response, turn_rate: Array) -> Pending:
        """What is pending now; turn_rate: of the vehicle now, from which the model begins after a reset, rad/s."""
        dead = response.dead + response.link
        if not self._commands:
            return Pending(0.0 * turn_rate, response.delay, response.settles)
        if self._rate is None:
            self._rate, self._at = turn_rate, self._commands[0][0] + dead
        rate, at = self._rate, self._at
        # before the first command it was turned by somebody else, who goes on for as long as we are not heard
        turn = turn_rate * min(max(self._commands[0][0] - (now - dead), 0.0), dead)
        ends = [*[time for time, _ in self._commands][1:], now]
        for (begin, command), end in zip(self._commands, ends, strict=True):
            arrived = min(end + dead, now)
            if arrived > at:
                rate = command + (rate - command) * exp(-(arrived - at) / max(response.lag, 1e-3))
                at = arrived
            turn = turn + command * max(end - max(begin, now - dead), 0.0)
        while len(self._commands) > 1 and self._commands[1][0] + dead <= at:
            self._commands.popleft()
        self._rate, self._at = rate, at
        return Pending(turn + response.lag * rate, response.delay, response.settles)


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


TOLD_LATE = 0.2
"""How much later than its bank a plane's nose turns, s, as seen on ArduPlane 4.6.3: the side-slip is known no sooner.
With gains for the bank alone, LoRa-like ranges cost 2.7 instead of 1.9 m there."""
SHORT = 0.95
"""Share of the commanded turn, both smoothed over a second, below which a bank counts as cut: a limit that leaves more
costs less than the lag between the two."""
STANDS, STANDS_FOR = 0.03, 1.0
"""A bank that is cut stands at its limit where it differs by less than this share from its mean over a second, for so
long, s: one that rolls does not."""
STOOD_LEAST, STOOD_MOST = 0.5, 20.0
"""Time at the limit, s, by which it is told first, and over which it is averaged: 1 % of it is .3 m of radius."""
SILENCE = 1.0
"""Pause of the commands, s, after which vehicles do what they do without: brake, hover, loiter."""
LONGEST_FELT = 1.0
"""Most time, s, for which a bank counts from one report to the next."""
DEAF_AFTER = 1.0
"""Time of not turning as commanded, s, after which a vehicle counts as deaf: a reversed turn takes less."""
OBEYS_AFTER = 2.0
"""Time of turning as commanded, s, after which a deaf vehicle teaches again: the model of its answer has then forgotten
the commands that it never received."""
TAKEN_BACK = 4.0
"""What was learnt in so many seconds before a vehicle counts as deaf is taken back: ArduPilot flies on by the last
command for 3 s, which looks like obedience for as long as the commands do not change."""


class BankLimit(NamedTuple):
    """Recognises the bank beyond which a vehicle does not go, however much is commanded: its autopilot's limit is below
    the mission's.

    time, heading: of the newest report, s, rad. since: when it last did as commanded, or still rolled, s. short:
    whether it banks less than commanded now. stood: for how long it was seen at its limit, s; banked, turned: by how
    much the coordinated turn of its bank, and the nose, turned meanwhile, rad.
    """

    time: float = inf
    heading: float = 0.0
    since: float = inf
    short: bool = False
    stood: float = 0.0
    banked: float = 0.0
    turned: float = 0.0

    @property
    def bank(self) -> float:
        """The turn that the limit asks for if it is coordinated, rad/s; inf while nothing is known."""
        return self.banked / self.stood if self.stood >= STOOD_LEAST else inf

    @property
    def turn(self) -> float:
        """Turn of the nose there, rad/s."""
        return self.turned / self.stood if self.stood >= STOOD_LEAST else inf

    def follow(self, own: OwnMotion, commanded: float, banked: float) -> "BankLimit":
        """Take in a report beside the commanded turn and that of the bank, both smoothed over a second, rad/s."""
        time, now, step = own.time, own.bank_turn or 0.0, own.time - self.time
        short = abs(banked) < SHORT * abs(commanded)
        stands = short and banked * commanded > 0 and abs(now - banked) < STANDS * abs(banked)
        since = min(self.since, time) if stands else time
        after = self._replace(time=time, heading=own.heading, since=since, short=short)
        # commands are not cut to the limit, so a bank beyond it shows that it was found too low
        if abs(banked) > (1 + STANDS) * self.bank:
            return after._replace(stood=0.0, banked=0.0, turned=0.0)
        if time - since < STANDS_FOR or not 0 < step <= LONGEST_FELT:
            return after
        kept = exp(-step / STOOD_MOST)
        turned = abs(remainder(own.heading - self.heading, 2 * pi))
        return after._replace(
            stood=kept * self.stood + step, banked=kept * self.banked + abs(now) * step,
            turned=kept * self.turned + turned,
        )  # fmt: skip


class TurnAnswer:
    """What is known of how one vehicle answers in flight, and what it has not answered yet.

    by_command: turn rate as it was commanded and as flown. by_bank: the same of the bank that it has; None before it
    was commanded and told a bank. link: there and back, s. bank_limit: of its autopilot, as found in flight.
    """

    def __init__(self, lag: float, limit: float, *, gain: float | None = None, link: float = 0.0) -> None:
        """lag: from a command to its turn before the flight has told, s. limit: of the commands, rad/s. gain: realised
        over commanded turn rate; None: learnt."""
        self._gain, self._limit, self.link = gain, limit, link
        self.by_command = TurnGain(gain=gain or 1.0)
        self.by_bank: TurnGain | None = None
        self.bank_limit = BankLimit()
        self._learner, self._pending = ResponseLearner(lag), PendingTurn()
        self.monitor = TurnMonitor(limit)
        self._bins = TurnBins(self._learner.candidates)
        self._nose = 0.0
        self._turned, self._felt_at = 0.0, inf
        self._commanded: float | None = None
        self._followed_at = self._deaf_at = -inf
        self._lessons: deque[tuple[float, TurnGain, Knowledge]] = deque()
        """What was known at times of the last seconds."""
        self._commanded_at = -inf

    @property
    def gain(self) -> float:
        """Realised over commanded turn rate, as used now."""
        return self._gain or float((self.by_bank or self.by_command).gain)

    @property
    def most(self) -> float:
        """Turn rate that the vehicle reaches, rad/s."""
        return min(self._limit * self.gain, self.bank_limit.turn)

    @property
    def response(self) -> Response:
        """Delay and lag, as used now."""
        return self._learner.response(self.link)

    def pending(self, now: float, turn_rate: Array) -> Pending:
        """What is commanded but not turned yet; turn_rate: of the vehicle now, rad/s."""
        late = 0.0 if self.by_bank is None else TOLD_LATE
        return self._pending.at(now, self.response, turn_rate)._replace(told_late=late, most=self.most)

    def command(self, now: float, rate: float) -> None:
        """From this time (s) on the vehicle is told to turn at this rate, rad/s."""
        if self._commanded is not None and now - self._commanded_at > SILENCE:
            self.monitor.reset()
        self._commanded, self._commanded_at, most = rate, now, self.bank_limit.bank
        reached = min(max(rate, -most), most)
        self._learner.command(now, reached)
        self._pending.command(now, reached * self.gain)

    def watch(self, nose: OwnMotion) -> None:
        """Compare the turn of the nose, or the bank, with the commanded turn. nose: motion as the autopilot reports it,
        not as the path through the air that is worked out from it."""
        self._nose += remainder(nose.heading - self._nose, 2 * pi)
        turned = self._nose if nose.bank_turn is None else self._turned
        new, commanded = self._bins.take(nose.time, turned, self.link), self._commanded
        if new is not None and commanded is not None:
            begun = self._learner.candidates.begun
            self.monitor.take(TurnBin(nose.time, new.predicted.ravel(), new.turned, commanded), begun)

    def feel(self, own: OwnMotion) -> bool:
        """Learn from the vehicle's heading, or bank; tells whether it was commanded."""
        if own.bank_turn is None:
            self._turned += remainder(own.heading - self._turned, 2 * pi)
        else:
            self._turned += own.bank_turn * min(max(own.time - self._felt_at, 0.0), LONGEST_FELT)
            self._felt_at = own.time
        if self._commanded is None:
            return False
        if own.time - self._deaf_at > OBEYS_AFTER:
            self._learner.feel(own.time, self._turned, self.link)
        else:
            self._learner.skip()
        if own.bank_turn is not None:
            # of the bank it has, not of the commanded one: an autopilot with a lower bank limit turns no worse for it
            before = self.by_bank or TurnGain()
            self.by_bank = learn(before, lag=0.0, time=own.time, heading=own.heading, command=own.bank_turn)
        # with the lag that the mission states, a copter that answers sooner seemed not to do as it was told
        lag = self.response.delay
        self.by_command = learn(self.by_command, lag=lag, time=own.time, heading=own.heading, command=self._commanded)
        if self.by_bank is not None and own.bank_turn is not None:
            commanded, banked = float(self.by_command.smooth_command), float(self.by_bank.smooth_command)
            self.bank_limit = self.bank_limit.follow(own, commanded, banked)
        self._watch_obedience(own.time)
        return True

    def _watch_obedience(self, now: float) -> None:
        """Take back what a vehicle taught that soon proved to be deaf: over a dead uplink its turns are no answers."""
        lessons, followed = self._lessons, bool(self.by_command.followed)
        self._followed_at = now if followed or self._followed_at == -inf else self._followed_at
        if now - self._followed_at > DEAF_AFTER:
            if lessons:
                _, gain, knowledge = lessons[0]
                self.by_command = self.by_command._replace(gain=gain.gain, square=gain.square, product=gain.product)
                self._learner.knowledge = knowledge
                lessons.clear()
            self._deaf_at = now
        elif followed and now - self._deaf_at > OBEYS_AFTER and (not lessons or now - lessons[-1][0] >= 1.0):
            lessons.append((now, self.by_command, self._learner.knowledge))
            while now - lessons[0][0] > TAKEN_BACK + 1.0:
                lessons.popleft()

    def reset(self) -> None:
        """The vehicle is not ours any more: what it does now is not our doing, and teaches nothing."""
        self._commanded = None
        self._followed_at = self._deaf_at = -inf
        self._lessons.clear()
        self._learner.reset()
        self._bins.reset()
        self.monitor.reset()
        self._pending.reset()
