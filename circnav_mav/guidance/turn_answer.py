"""The answer of one vehicle to turn commands, as learned in flight: gain, delay, bank limit and pending turn."""

from collections import deque
from math import inf, pi, remainder

from circnav_mav.guidance.bank_limit import LONGEST_FELT, BankLimit
from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.pending_turn import Pending, PendingTurn
from circnav_mav.guidance.turn_gain import TurnGain, learn
from circnav_mav.guidance.turn_monitor import TurnBin, TurnMonitor
from circnav_mav.guidance.turn_response import Knowledge, Response, ResponseLearner, TurnBins
from circnav_mav.guidance.types import OwnMotion

TOLD_LATE = 0.2
"""How much later than its bank a plane's nose turns, s, as seen on ArduPlane 4.6.3: the side-slip is known no sooner.
With gains for the bank alone, LoRa-like ranges cost 2.7 instead of 1.9 m there."""
SILENCE = 1.0
"""Pause of the commands, s, after which vehicles do what they do without: brake, hover, loiter."""
DEAF_AFTER = 1.0
"""Time of not turning as commanded, s, after which a vehicle counts as deaf: a reversed turn takes less."""
OBEYS_AFTER = 2.0
"""Time of turning as commanded, s, after which a deaf vehicle teaches again: the model of its answer has then forgotten
the commands that it never received."""
TAKEN_BACK = 4.0
"""What was learnt in so many seconds before a vehicle counts as deaf is taken back: ArduPilot flies on by the last
command for 3 s, which looks like obedience for as long as the commands do not change."""


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
