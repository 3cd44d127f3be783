"""The turn that is commanded but not flown yet: the Smith predictor's model of the vehicle."""

from collections import deque
from math import exp, inf
from typing import NamedTuple

from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.turn_response import Response


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
