"""How firmware follows a command: nothing at all for the dead time, then a loop of second order that overshoots."""

import math
from dataclasses import dataclass

from ..body import Body

Line = tuple[tuple[float, float], ...]
"""Commands on their way: seconds until each arrives and its value. The first has arrived and is in force."""


def pieces(dt: float, longest: float) -> list[float]:
    """A time step cut into equal ones."""
    count = max(1, math.ceil(dt / longest - 1e-9))
    return [dt / count] * count


def through_line(line: Line, command: float, dead_time: float, h: float) -> Line:
    """The line `h` seconds later, with a command put in now; what comes out is the value of its first entry."""
    line = tuple((left - h, value) for left, value in line)
    if not line or line[-1][1] != command:
        line += ((dead_time, command),)
    while len(line) > 1 and line[1][0] < h / 2:
        line = line[1:]
    return line


def second_order(error: float, rate: float, frequency: float, damping: float, h: float) -> float:
    """The rate of change `h` seconds later of a loop that takes `error` to zero; frequency in rad/s."""
    return rate + (frequency**2 * error - 2 * damping * frequency * rate) * h


@dataclass(frozen=True)
class YawLoop:
    """A copter's turn rate: limit in rad/s, dead time in s, frequency in rad/s, acceleration limit in rad/s^2."""

    limit: float
    dead_time: float
    frequency: float
    damping: float
    most_acceleration: float = math.inf

    def limited(self, command: float) -> float:
        return max(-self.limit, min(self.limit, command))

    def turn(self, body: Body, command: float, h: float) -> Body:
        line = through_line(body.on_the_way, command, self.dead_time, h)
        error = line[0][1] - body.turn_rate
        acceleration = second_order(error, body.turn_acceleration, self.frequency, self.damping, h)
        acceleration = max(-self.most_acceleration, min(self.most_acceleration, acceleration))
        rate = body.turn_rate + acceleration * h
        return body._replace(
            heading=math.remainder(body.heading + (body.turn_rate + rate) / 2 * h, math.tau),
            turn_rate=rate,
            turn_acceleration=acceleration,
            on_the_way=line,
        )
