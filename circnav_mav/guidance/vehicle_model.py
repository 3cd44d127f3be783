"""Model of one vehicle's response to turn commands, learned in flight.

`VehicleModel` contains all that is learned of the vehicle's turns: gain and delay from a command to
its turn, the commanded turn that is not flown yet, and limits of bank and lean. It also judges
whether the vehicle follows its commands, and whether the loop is in a limit cycle.
"""

from collections import deque
from copy import copy
from math import exp, inf, pi, remainder
from typing import Any, NamedTuple

from circnav_mav.guidance.command_following import CommandFollowing, LimitCycle
from circnav_mav.guidance.limits import SHORT, BankLimit
from circnav_mav.guidance.recursive_least_squares import RecursiveLeastSquares
from circnav_mav.guidance.turn_response import (
    CandidateTurns,
    Pending,
    PendingTurn,
    Response,
    ResponseLearner,
    TurnBins,
)
from circnav_mav.guidance.types import SAME_TIME, OwnMotion

MEASUREMENT_DELAY = 0.4
"""Delay of the turn of a plane's nose behind its bank, s. The reported turn rate is that of the
nose, and a plane that begins to turn slips first. With a delay of 0.2 s, ArduPlane 4.6.3 flew a
limit cycle in a wind of 8 m/s."""
OBEYS_AFTER = 2.0
"""Time, s, for which an unresponsive vehicle must turn as commanded before learning resumes. After
this time the response model no longer contains commands that the vehicle did not receive."""
OFF_BANK = 1 - SHORT
"""Largest difference of a plane's gain by its commands from its gain by its bank, as a share. A
plane with a larger difference counts as limited."""
PAUSE = 1.0
"""Pause of the commands, or gap between two reports of own motion, s, after which the vehicle may
have stopped. Without commands, autopilots brake, hover or loiter."""


class TurnGain:
    """Ratio of flown to commanded turn rate, learned in flight.

    Real vehicles fly 0.70 to 1.05 of the commanded turn rate. A plane that banks for a coordinated
    turn and slips flies 0.73. A remaining error of 1 % causes 0.2 to 0.3 m of radius error. Method:
    least squares of the heading's rate on the commanded rate. The commanded rate is delayed like
    the vehicle's turn, and both rates pass the same low-pass. So the lag does not bias the ratio.

    gain: flown over commanded turn rate.
    time: time of the newest heading, s; -inf at the start.
    heading: newest heading, rad.
    rate: flown turn rate after the low-pass, rad/s.
    command: commanded turn rate after the low-pass, rad/s.
    """

    SMOOTHING = 1.0
    """Time constant of the low-pass, s."""
    MEMORY = 15.0
    """Time constant of the least squares, s."""
    PRIOR = 0.003
    """Weight of the prior, a gain of 1, in the least squares, (rad/s)^2 s."""
    LOWEST = 0.6
    """Lower bound of the learned gain."""
    HIGHEST = 1.25
    """Upper bound of the learned gain."""

    def __init__(self, gain: float = 1.0) -> None:
        self.gain = gain
        self.time = -inf
        self.rate = 0.0
        self.command = 0.0
        self.heading = 0.0
        self._lagged = 0.0
        self._follows_for = 0.0
        self._fit = RecursiveLeastSquares(self.MEMORY)

    @property
    def followed(self) -> bool:
        """True if the turn is at least a third of the command, or the command is too small to judge
        in noise (0.02 rad/s)."""
        return abs(self.command) < 0.02 or self.rate * self.command > self.command**2 / 3

    @property
    def knowledge(self) -> tuple[Any, ...]:
        """Copy of the learned state, for `restore`."""
        return self.gain, copy(self._fit)

    def restore(self, knowledge: tuple[Any, ...]) -> None:
        """Return to an earlier learned state."""
        self.gain, fit = knowledge
        self._fit = copy(fit)

    def learn(self, time: float, heading: float, command: float, lag: float = 0.0) -> None:
        """Learn from a heading.

        heading: measured, rad.
        command: commanded turn rate meanwhile, rad/s, same sense as the heading.
        lag: delay from a command to its turn, s.
        """
        step = time - self.time
        turned = remainder(heading - self.heading, 2 * pi)
        if step == 0:
            return
        self.time = time
        self.heading = heading
        # 2.0: longest gap between two reports, s: a vehicle that refuses stream requests sends one
        # per second.
        if not 0 < step <= 2.0:
            self.rate = command
            self._lagged = command
            self.command = command
            self._follows_for = 0.0
            return
        smooth = 1 - exp(-step / self.SMOOTHING)
        follow = 1 - exp(-step / lag) if lag > 0 else 1.0
        self._lagged += (command - self._lagged) * follow
        self.command += (self._lagged - self.command) * smooth
        self.rate += (turned / step - self.rate) * smooth
        self._follows_for = self._follows_for + step if self.followed else 0.0
        # Before this time, the low-pass still contains its initial value, or turns from before the
        # vehicle followed.
        if self._follows_for >= 4 * self.SMOOTHING - SAME_TIME:
            fit = self._fit
            fit.add(self.command, self.rate, step, step)
            gain = (fit.xy + self.PRIOR) / (fit.xx + self.PRIOR)
            self.gain = min(max(gain, self.LOWEST), self.HIGHEST)


class Snapshot(NamedTuple):
    """Learned state of gain and response at a time (s)."""

    time: float
    gain: tuple[Any, ...]
    response: tuple[Any, ...]


class VehicleModel:
    """Learned response of a vehicle, and the commanded turn that it has not flown yet.

    link: round-trip delay of the link, s.
    command_gain: flown over commanded turn rate.
    bank_gain: flown turn rate over the coordinated turn rate of the bank; None until a commanded
        vehicle has reported a bank.
    bank_limit: bank limit of the autopilot, as found in flight.
    command_following: verdict whether the vehicle follows turn commands.
    limit_cycle: detection of limit cycles, and the factor on the law's gains.
    """

    def __init__(
        self, lag: float, limit: float, *, gain: float | None = None, link: float = 0.0
    ) -> None:
        """lag: initial delay from a command to its turn, s.
        limit: limit of the commanded turn rate, rad/s.
        gain: flown over commanded turn rate; None if it is learned.
        """
        self._given_gain = gain
        self._limit = limit
        self.link = link
        self.command_gain = TurnGain(gain or 1.0)
        self.bank_gain: TurnGain | None = None
        self.bank_limit = BankLimit()
        self.command_following = CommandFollowing()
        self.limit_cycle = LimitCycle(limit)
        self._learner = ResponseLearner(lag)
        self._pending = PendingTurn()
        self._candidates = CandidateTurns()
        self._path_bins = TurnBins(self._candidates)
        self._nose_bins = TurnBins(self._candidates)
        self._turned = 0.0
        """Angle turned by the path, or by a plane's bank, unwrapped, rad."""
        self._nose = 0.0
        """Heading of the nose, unwrapped, rad."""
        self._bank_at = inf
        self._commanded: float | None = None
        self._commanded_at = -inf
        self._started_at = -inf
        """Time of the first report, or of the first report after a gap, s."""
        self._followed_at = -inf
        self._unresponsive_at = -inf
        self._snapshots: deque[Snapshot] = deque()
        """Learned states of the last 4 s, one per second."""

    @property
    def gain(self) -> float:
        """Flown over commanded turn rate, as used now."""
        if self._given_gain is not None or self.bank_gain is None:
            return self._given_gain or self.command_gain.gain
        # ArduPlane 4.6.3 holds 26.6 deg of 26.8 deg of commanded bank: 0.7 % less turn, 0.2 m more
        # radius. So the gain is that of the commands. A plane at a bank limit that has not been
        # found yet flies far less than commanded, which must not raise the commands.
        bank = self.bank_gain.gain
        return min(max(self.command_gain.gain, bank * (1 - OFF_BANK)), bank * (1 + OFF_BANK))

    @property
    def most(self) -> float:
        """Turn rate that the vehicle reaches, rad/s."""
        return min(self._limit * self.gain, self.bank_limit.turn)

    @property
    def response(self) -> Response:
        """Response of the vehicle, as used now."""
        return self._learner.response(self.link)

    @property
    def followed(self) -> bool:
        """True if the vehicle turns as commanded now."""
        return self.command_gain.followed

    @property
    def at_speed(self) -> bool:
        """True if the vehicle has followed its commands for long enough to have the commanded
        speed."""
        now = self.command_gain.time
        slow_at = max(self._started_at, self._unresponsive_at)
        # A vehicle without airspeed sensor is assumed to have the commanded speed. The estimators
        # would mistake a lower speed for a drift, so they receive its motion only at this speed.
        # 0.5: longest time, s, without turning as commanded. When a turn is reversed, commanded and
        # flown turn differ for this time.
        # 2.5: time, s, of turning as commanded after which the vehicle has the commanded speed. A
        # multicopter needs this time to accelerate from 0 to 5 m/s.
        return now - self._followed_at <= 0.5 and now - slow_at >= 2.5 - SAME_TIME

    def pending(self, now: float, turn_rate: float) -> Pending:
        """Return the commanded turn that is not flown yet. turn_rate: turn rate of the vehicle now,
        rad/s."""
        pending = self._pending.at(now, self.response, turn_rate)
        late = 0.0 if self.bank_gain is None else MEASUREMENT_DELAY
        return pending._replace(measurement_delay=late, most=self.most)

    def command(self, now: float, rate: float) -> None:
        """Record a commanded turn rate (rad/s) and the time (s) of its start."""
        if self._commanded is not None and now - self._commanded_at > PAUSE:
            self.judge_again()
        self._commanded = rate
        self._commanded_at = now
        most = self.bank_limit.bank
        reached = min(max(rate, -most), most)
        self._candidates.command(now, reached)
        self._pending.command(now, reached * self.gain)

    def on_motion(self, own: OwnMotion, nose: OwnMotion) -> None:
        """Learn from a report of own motion, and judge the vehicle's turns.

        own: motion along the path through the air, by the model of a copter's velocity.
        nose: motion as the autopilot reports it.

        While circnav does not command the vehicle, only the turned angle is summed up.
        """
        self._sum_up(own)
        if self._commanded is None:
            return
        self._learn(own)
        self._watch(own)
        self._nose += remainder(nose.heading - self._nose, 2 * pi)
        turned = self._nose if nose.bank_turn is None else self._turned
        new = self._nose_bins.add(nose.time, turned, self.link)
        if new is not None:
            self.limit_cycle.judge(new.time, new.flown, self._commanded)
            self.command_following.judge(new)

    def _sum_up(self, own: OwnMotion) -> None:
        if own.bank_turn is None:
            self._turned += remainder(own.heading - self._turned, 2 * pi)
        else:
            step = min(max(own.time - self._bank_at, 0.0), 1.0)
            self._turned += own.bank_turn * step
            self._bank_at = own.time

    def _learn(self, own: OwnMotion) -> None:
        """Update gains, delay and bank limit."""
        assert self._commanded is not None
        if own.time - self._unresponsive_at > OBEYS_AFTER:
            new = self._path_bins.add(own.time, self._turned, self.link)
            if new is not None:
                self._learner.learn(new)
        else:
            self._path_bins.reset()
        if own.time - self.command_gain.time > PAUSE:
            self._started_at = own.time
            self._followed_at = own.time
        if own.bank_turn is not None:
            # Use the reported bank, not the commanded bank: a bank limit of the autopilot below the
            # command must not lower the gain.
            self.bank_gain = self.bank_gain or TurnGain()
            self.bank_gain.learn(own.time, own.heading, own.bank_turn)
        # Use the learned delay. With the lag of the mission, a copter with a faster response looked
        # unresponsive.
        lag = self.response.delay
        self.command_gain.learn(own.time, own.heading, self._commanded, lag)
        if self.bank_gain is not None and own.bank_turn is not None:
            self.bank_limit.follow(own, self.command_gain.command, self.bank_gain.command)

    def _watch(self, own: OwnMotion) -> None:
        """Discard recent learning if the vehicle turned out unresponsive: if the uplink is dead,
        its turns are no response to commands."""
        now = own.time
        if self.followed or self._followed_at == -inf:
            self._followed_at = now
        # Time without turning as commanded, s, after which a vehicle counts as unresponsive.
        # Reversing a turn takes less time.
        if now - self._followed_at > 1.0:
            if self._snapshots:
                # Restore the oldest snapshot, from before the vehicle stopped following.
                before = self._snapshots[0]
                self.command_gain.restore(before.gain)
                self._learner.restore(before.response)
                self._snapshots.clear()
            self._unresponsive_at = now
        elif self.followed and now - self._unresponsive_at > OBEYS_AFTER:
            if not self._snapshots or now - self._snapshots[-1].time >= 1.0:
                gain = self.command_gain.knowledge
                self._snapshots.append(Snapshot(now, gain, self._learner.knowledge))
            # Span of the snapshots, s. If the vehicle is found unresponsive, all that was learned
            # in this span is discarded. After a loss of the uplink, ArduPilot flies the last
            # command for another 3 s, and is found 1 s later. While the commands do not change,
            # this looks like following.
            while now - self._snapshots[0].time > 4.0:
                self._snapshots.popleft()

    def reset(self) -> None:
        """Stop learning and forget the commands. Call when circnav no longer controls the
        vehicle."""
        self._commanded = None
        self._followed_at = -inf
        self._unresponsive_at = -inf
        self._snapshots.clear()
        self._candidates.reset()
        self._path_bins.reset()
        self._nose_bins.reset()
        self._pending.reset()
        self.judge_again()

    def judge_again(self) -> None:
        """Restart the judgement of the turns. Learned and lowered gains do not change."""
        self.command_following.reset()
        self.limit_cycle.reset()
