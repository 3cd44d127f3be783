"""Commanded turn that is not flown yet: the vehicle model of a Smith predictor."""

from collections import deque
from math import exp, inf
from typing import NamedTuple

from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.turn_response import Response


class Pending(NamedTuple):
    """Commanded turn that is not flown yet. turn: rad. ahead: delay of the response, s. settles:
    its settling rate, 1/s. measurement_delay: delay of the reported turn rate, s. most: turn rate
    that the vehicle reaches, rad/s."""

    turn: Array
    ahead: Array
    settles: Array = 10.0
    measurement_delay: float = 0.0
    most: Array = inf


class PendingTurn:
    """Model of the commanded turn that is not flown yet: commands younger than the dead time, and
    the turn that the lag still adds.

    Commands are the expected turn rates of the vehicle, rad/s: numbers, or arrays (B,) of flights
    commanded together. The loop is closed on the commanded heading, so that it does not contain the
    modeled delay (Smith, "Closer control of loops with dead time", 1957).
    """

    def __init__(self) -> None:
        self._commands: deque[tuple[float, Array]] = deque()
        self._rate: Array | None = None
        self._at = 0.0

    def command(self, time: float, rate: Array) -> None:
        """Record an expected turn rate (rad/s) and the time (s) of its command."""
        self._commands.append((time, rate))

    def reset(self) -> None:
        """Forget the commands."""
        self._commands.clear()
        self._rate = None

    def at(self, now: float, response: Response, turn_rate: Array) -> Pending:
        """Return the pending turn. turn_rate: of the vehicle now, rad/s; the model starts from it
        after a reset."""
        dead = response.dead + response.link
        if not self._commands:
            return Pending(0.0 * turn_rate, response.delay, response.settles)
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
            turn = turn + command * max(end - max(begin, now - dead), 0.0)
        while len(self._commands) > 1 and self._commands[1][0] + dead <= at:
            self._commands.popleft()
        self._rate = rate
        self._at = at
        return Pending(turn + response.lag * rate, response.delay, response.settles)
