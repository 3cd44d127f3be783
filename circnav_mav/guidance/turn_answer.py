"""Vehicle response to turn commands, learned in flight: gain, delay, bank limit and pending
turn."""

from collections import deque
from math import inf, pi, remainder

from circnav_mav.guidance.bank_limit import LONGEST_BANK_INTERVAL, BankLimit
from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.pending_turn import Pending, PendingTurn
from circnav_mav.guidance.turn_gain import TurnGain, learn
from circnav_mav.guidance.turn_monitor import TurnMonitor
from circnav_mav.guidance.turn_response import Knowledge, Response, ResponseLearner, TurnBins
from circnav_mav.guidance.types import OwnMotion

MEASUREMENT_DELAY = 0.2
"""Delay of a plane's reported turn rate behind its bank, s, as seen on ArduPlane 4.6.3; the
side-slip estimate has the same delay. With gains tuned for the delay of the bank alone, the radius
error with LoRa-like ranges was 2.7 m instead of 1.9 m there."""
SILENCE = 1.0
"""Pause of the commands, s, after which vehicles change to their default: brake, hover, loiter."""
UNRESPONSIVE_AFTER = 1.0
"""Time without turning as commanded, s, after which a vehicle counts as unresponsive. Reversing a
turn takes less time."""
OBEYS_AFTER = 2.0
"""Time of turning as commanded, s, after which learning resumes. After this time the response model
no longer contains commands that the vehicle did not receive."""
TAKEN_BACK = 4.0
"""Time span, s, that ends when a vehicle is found unresponsive. What was learned in it is
discarded. After a loss of the uplink, ArduPilot keeps flying the last command for 3 s. While the
commands do not change, this looks like following."""


class LearnedResponse:
    """Learned response of a vehicle, and the commanded turn that it has not flown yet.

    command_gain: flown over commanded turn rate. bank_gain: flown turn rate over the coordinated
    turn rate of the bank; None until a commanded vehicle has reported a bank. link: round-trip
    delay, s. bank_limit: bank limit of the autopilot, as measured in flight.
    """

    def __init__(
        self, lag: float, limit: float, *, gain: float | None = None, link: float = 0.0
    ) -> None:
        """lag: initial delay from a command to its turn, s. limit: limit of the commanded turn
        rate, rad/s. gain: flown over commanded turn rate; None if it is learned."""
        self._gain = gain
        self._limit = limit
        self.link = link
        self.command_gain = TurnGain(gain=gain or 1.0)
        self.bank_gain: TurnGain | None = None
        self.bank_limit = BankLimit()
        self._learner = ResponseLearner(lag)
        self._pending = PendingTurn()
        self.monitor = TurnMonitor(limit)
        self._bins = TurnBins(self._learner.candidates)
        self._nose = 0.0
        self._turned = 0.0
        self._bank_at = inf
        self._commanded: float | None = None
        self._followed_at = self._unresponsive_at = -inf
        self._lessons: deque[tuple[float, TurnGain, Knowledge]] = deque()
        """Snapshots of the learned state over the last seconds."""
        self._commanded_at = -inf

    @property
    def gain(self) -> float:
        """Flown over commanded turn rate, as used now."""
        return self._gain or float((self.bank_gain or self.command_gain).gain)

    @property
    def most(self) -> float:
        """Turn rate that the vehicle reaches, rad/s."""
        return min(self._limit * self.gain, self.bank_limit.turn)

    @property
    def response(self) -> Response:
        """Delay and lag, as used now."""
        return self._learner.response(self.link)

    def pending(self, now: float, turn_rate: Array) -> Pending:
        """Return the commanded turn that is not flown yet. turn_rate: turn rate of the vehicle now,
        rad/s."""
        late = 0.0 if self.bank_gain is None else MEASUREMENT_DELAY
        return self._pending.at(now, self.response, turn_rate)._replace(
            measurement_delay=late, most=self.most
        )

    def command(self, now: float, rate: float) -> None:
        """Record a commanded turn rate (rad/s) and the time (s) of its start."""
        if self._commanded is not None and now - self._commanded_at > SILENCE:
            self.monitor.reset()
        self._commanded = rate
        self._commanded_at = now
        most = self.bank_limit.bank
        reached = min(max(rate, -most), most)
        self._learner.candidates.command(now, reached)
        self._pending.command(now, reached * self.gain)

    def on_motion(self, own: OwnMotion, nose: OwnMotion) -> bool:
        """Update the learned gains, delay and bank limit from the vehicle's heading or bank, and
        monitor its turns.

        own: motion with the heading corrected to the direction of the path through the air, by the
        side-slip or the model of a copter's velocity. nose: motion as the autopilot reports it.
        Return True if a turn command was recorded since the last `reset`. Otherwise circnav does
        not steer the vehicle, and only the turn is summed up.
        """
        if own.bank_turn is None:
            self._turned += remainder(own.heading - self._turned, 2 * pi)
        else:
            self._turned += own.bank_turn * min(
                max(own.time - self._bank_at, 0.0), LONGEST_BANK_INTERVAL
            )
            self._bank_at = own.time
        if self._commanded is None:
            return False
        if own.time - self._unresponsive_at > OBEYS_AFTER:
            self._learner.on_motion(own.time, self._turned, self.link)
        else:
            self._learner.skip()
        if own.bank_turn is not None:
            # Use the reported bank, not the commanded one: a lower bank limit of the autopilot must
            # not lower the gain.
            before = self.bank_gain or TurnGain()
            self.bank_gain = learn(
                before, lag=0.0, time=own.time, heading=own.heading, command=own.bank_turn
            )
        # Use the learned delay. With the lag of the mission, a copter with a faster response looked
        # unresponsive.
        lag = self.response.delay
        self.command_gain = learn(
            self.command_gain, lag=lag, time=own.time, heading=own.heading, command=self._commanded
        )
        if self.bank_gain is not None and own.bank_turn is not None:
            commanded = float(self.command_gain.smooth_command)
            banked = float(self.bank_gain.smooth_command)
            self.bank_limit = self.bank_limit.follow(own, commanded, banked)
        self._watch_obedience(own.time)
        self._nose += remainder(nose.heading - self._nose, 2 * pi)
        turned = self._nose if nose.bank_turn is None else self._turned
        if (new := self._bins.take(nose.time, turned, self.link)) is not None:
            self.monitor.take(new, self._commanded, self._learner.candidates.begun)
        return True

    def _watch_obedience(self, now: float) -> None:
        """Discard recent learning if the vehicle turned out unresponsive: over a dead uplink its
        turns mean nothing."""
        lessons = self._lessons
        followed = bool(self.command_gain.followed)
        self._followed_at = now if followed or self._followed_at == -inf else self._followed_at
        if now - self._followed_at > UNRESPONSIVE_AFTER:
            if lessons:
                # Restore the oldest snapshot, from before the vehicle stopped following.
                _, gain, knowledge = lessons[0]
                self.command_gain = self.command_gain._replace(
                    gain=gain.gain, square=gain.square, product=gain.product
                )
                self._learner.knowledge = knowledge
                lessons.clear()
            self._unresponsive_at = now
        elif (
            followed
            and now - self._unresponsive_at > OBEYS_AFTER
            and (not lessons or now - lessons[-1][0] >= 1.0)
        ):
            lessons.append((now, self.command_gain, self._learner.knowledge))
            while now - lessons[0][0] > TAKEN_BACK + 1.0:
                lessons.popleft()

    def reset(self) -> None:
        """Stop learning and forget the commands. Call when the vehicle is no longer controlled from
        here."""
        self._commanded = None
        self._followed_at = self._unresponsive_at = -inf
        self._lessons.clear()
        self._learner.reset()
        self._bins.reset()
        self.monitor.reset()
        self._pending.reset()
